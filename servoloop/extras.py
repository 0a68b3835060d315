"""Commands that install the optional parts (extras) of servoloop."""

import importlib.util
import json
import shlex
import sys
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from drivers.errors import DriverError


def install_command(extra: str) -> str:
    """Return the command that installs an extra in the environment of this program.

    servoloop is not on a package index, so the command contains the folder or the URL of the installation.
    """
    return f"{shlex.quote(sys.executable)} -m pip install {shlex.quote(f'{_source()}[{extra}]')}"


def _source() -> str:
    root = Path(__file__).parents[1]
    if (root / "pyproject.toml").is_file():
        return str(root)
    try:
        installed = json.loads(distribution("servoloop").read_text("direct_url.json") or "{}")
    except (PackageNotFoundError, ValueError):
        installed = {}
    url = str(installed.get("url", ""))
    if version_control := installed.get("vcs_info", {}).get("vcs"):
        url = f"{version_control}+{url}"
    return f"servoloop @ {url}".replace("servoloop @ file://", "") if url else "servoloop"


def require_view(what: str = "the view", library: str = "viser") -> None:
    """Raise DriverError, with the command that installs the library, if the library is missing."""
    if importlib.util.find_spec(library) is None:
        raise DriverError(f"{what} needs {library}; install it with: {install_command('view')}")
