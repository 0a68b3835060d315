"""Build the plugin for LeRobot, and install it into a folder."""

import subprocess
import sys
import zipfile
from pathlib import Path

from tests.integrations.lerobot.conftest import PLUGIN


def install_plugin(folder: Path) -> Path:
    """Build the wheel of the plugin and unpack it. A program finds the plugin if ``PYTHONPATH`` contains the returned
    folder."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder / "wheel")]
    subprocess.run(command, cwd=PLUGIN, check=True, capture_output=True)
    (wheel,) = (folder / "wheel").glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "plugin")
    return folder / "plugin"
