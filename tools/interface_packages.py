"""List the message packages in interfaces/, or only the packages that a sourced ROS installation does not have.

python3 tools/interface_packages.py            # all
python3 tools/interface_packages.py --missing  # those to build in a ROS workspace
"""

import os
import re
import sys
from pathlib import Path

from places import INTERFACES

KINDS = ("msg", "srv", "action")


def definitions(package: str) -> list[Path]:
    """Return the .msg, .srv and .action files of a package."""
    return sorted(path for kind in KINDS for path in (INTERFACES / package / kind).glob(f"*.{kind}"))


def needed_packages(package: str) -> set[str]:
    """Return the other packages in interfaces/ whose types this package contains."""
    text = (INTERFACES / package / "package.xml").read_text()
    return {name for name in re.findall(r"<depend>(\w+)</depend>", text) if (INTERFACES / name).is_dir()}


def packages() -> list[str]:
    """Return the packages in build order.

    Packages that other packages need come first. After that, the largest packages come first, so that a build on
    several cores finishes sooner.
    """
    names = [path.parent.name for path in INTERFACES.glob("*/package.xml")]
    needed = set().union(*(needed_packages(name) for name in names))
    return sorted(names, key=lambda name: (name not in needed, -len(definitions(name)), name))


def provided_by_ros(package: str) -> bool:
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return any(prefix and (Path(prefix) / "share" / package / "package.xml").exists() for prefix in prefixes)


if __name__ == "__main__":
    wanted = [name for name in packages() if "--missing" not in sys.argv or not provided_by_ros(name)]
    print(" ".join(wanted))
