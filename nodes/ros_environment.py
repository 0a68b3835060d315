"""Checks of the ROS 2 on which nodes/ is built, and of the environment that it reads, before rclpy is imported.

rclpy, rcl and Fast DDS report a missing or wrong setting in a traceback, or end the process.
"""

import os
from collections.abc import Mapping
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Final

RCLPY: Final = "7.1."
"""Of ROS 2 Jazzy. nodes/rclpy_patches/ stands in for parts of it that another one has otherwise."""
PACKAGES: Final = (
    "rclpy",
    "apple_quality_msgs",
    "control_msgs",
    "controller_manager_msgs",
    "mujoco_ros2_control_msgs",
    "sorting_arm_interfaces",
    "tf2_msgs",
)
"""The client library, and the messages of interfaces/."""
LAST_DOMAIN: Final = 232
"""Domain IDs above it have no UDP ports (DDSI-RTPS, 9.6.1.1)."""


class RosError(Exception):
    """ROS 2 is missing, of another distribution, or has settings that cannot work. The text has the remedy."""


def require_ros() -> None:
    """Check ROS 2 and this process' environment before nodes/ is imported. Raises RosError."""
    if missing := [name for name in PACKAGES if find_spec(name) is None]:
        raise RosError(
            f"this needs ROS 2 Jazzy, and Python finds no {missing[0]}: run 'make setup' and use .venv/bin/servoloop, "
            "or source the workspace in which it is built"
        )
    _check_distribution()
    _check_domain(os.environ)
    _check_middleware(os.environ)
    _check_log_folder(os.environ)
    if os.environ.get("NO_COLOR"):
        os.environ.setdefault("RCUTILS_COLORIZED_OUTPUT", "0")  # rcl's logs know that variable alone
    _import_rclpy()


def _check_distribution() -> None:
    try:
        found = version("rclpy")
    except PackageNotFoundError:  # built from source, it has no metadata
        return
    if not found.startswith(RCLPY):
        raise RosError(
            f"this needs ROS 2 Jazzy (rclpy {RCLPY}x), and Python finds rclpy {found}: open a shell in which no other "
            "ROS 2 is sourced"
        )


def _check_domain(environment: Mapping[str, str]) -> None:
    text = environment.get("ROS_DOMAIN_ID", "")
    if text and not (text.isascii() and text.isdigit() and int(text) <= LAST_DOMAIN):
        raise RosError(f"ROS_DOMAIN_ID is '{text}': set it to a whole number from 0 to {LAST_DOMAIN}, or unset it")


def _check_middleware(environment: Mapping[str, str]) -> None:
    name = environment.get("RMW_IMPLEMENTATION", "")
    folders = [Path(folder) for folder in environment.get("LD_LIBRARY_PATH", "").split(os.pathsep) if folder]
    folders += [Path(prefix) / "lib" for prefix in environment.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    packaged = name.isidentifier() and find_spec(name) is not None
    if name and not packaged and not any((folder / f"lib{name}.so").exists() for folder in folders):
        raise RosError(f"RMW_IMPLEMENTATION is {name}, which is not installed: unset it, or install {name}")


def _check_log_folder(environment: Mapping[str, str]) -> None:
    """The folder in which rcl opens a log file: it does not start without one."""
    if text := environment.get("ROS_LOG_DIR"):
        variable, folder = "ROS_LOG_DIR", Path(text).expanduser()
    elif text := environment.get("ROS_HOME"):
        variable, folder = "ROS_HOME", Path(text).expanduser() / "log"
    elif text := environment.get("HOME"):
        variable, folder = "HOME", Path(text) / ".ros" / "log"
    else:
        raise RosError("HOME is not set, and ROS 2 needs a folder for its logs: set ROS_LOG_DIR to a folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        writable, reason = os.access(folder, os.W_OK), "no permission to write"
    except OSError as error:
        writable, reason = False, error.strerror or str(error)
    if not writable:
        raise RosError(
            f"{variable} makes ROS 2 write its logs to {folder}, which it cannot ({reason}): set ROS_LOG_DIR to a "
            "folder that can be written"
        )


def _import_rclpy() -> None:
    try:
        import_module("rclpy")
    except ImportError as error:
        spec = find_spec("rclpy")
        place = spec.origin if spec is not None else "rclpy"
        raise RosError(
            f"{place} is not for this Python ({error}): open a shell in which no other ROS 2 is sourced, or take its "
            "folder out of PYTHONPATH"
        ) from error
