"""The optional parts of servoloop, and the commands that install them."""

import json
import shlex
import sys
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path


def install_command(extra: str) -> str:
    """Return the command that installs an extra into the environment of this program.

    servoloop is not in a package index: the command names the folder or the address that it was installed from.
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
