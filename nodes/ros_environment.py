"""The settings of ROS 2 in a process's environment that would end in an error deep within rcl. No ROS."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from drivers.errors import DriverError

LARGEST_DOMAIN: Final = 232
"""The largest domain whose ports exist: they begin at 7400 + 250 times the domain."""


def check_environment(environment: Mapping[str, str]) -> None:
    """Check the domain and the folder of ROS's logs. Raises DriverError with the variable and its range."""
    domain = environment.get("ROS_DOMAIN_ID", "")
    if domain and not (domain.isascii() and domain.isdigit() and int(domain) <= LARGEST_DOMAIN):
        raise DriverError(f"ROS_DOMAIN_ID is {domain[:40]!r}: set it to a whole number from 0 to {LARGEST_DOMAIN}")
    folder = _log_folder(environment)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        writable = os.access(folder, os.W_OK | os.X_OK)
    except OSError:
        writable = False
    if not writable:
        raise DriverError(
            f"ROS cannot write its logs into {folder}: set ROS_LOG_DIR to a folder that this user can write into"
        )


def _log_folder(environment: Mapping[str, str]) -> Path:
    """The folder that rcl takes: ROS_LOG_DIR, ROS_HOME/log or ~/.ros/log."""
    if folder := environment.get("ROS_LOG_DIR"):
        return _at_home(folder, environment)
    if folder := environment.get("ROS_HOME"):
        return _at_home(folder, environment) / "log"
    return _at_home("~/.ros/log", environment)


def _at_home(folder: str, environment: Mapping[str, str]) -> Path:
    """A folder as rcl reads it: ``~`` is HOME. Raises DriverError if HOME is needed and not set."""
    if not folder.startswith("~"):
        return Path(folder)
    if not (home := environment.get("HOME")):
        raise DriverError("HOME is not set, and ROS writes its logs below it: set HOME or ROS_LOG_DIR to a folder")
    return Path(home) / folder[1:].lstrip("/")
