"""Check the ROS 2 installation and its environment variables before rclpy is imported.

rclpy, rcl and Fast DDS respond to a missing or wrong setting with a traceback, or terminate the process.
"""

import os
from collections.abc import Mapping, Sequence
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Final

RCLPY: Final = "7.1."
"""Version prefix of rclpy in ROS 2 Jazzy. The patches in nodes/rclpy_patches/ replace code that differs in other
versions."""
PACKAGES: Final = (
    "rclpy",
    "apple_quality_msgs",
    "control_msgs",
    "controller_manager_msgs",
    "mujoco_ros2_control_msgs",
    "sorting_arm_interfaces",
    "tf2_msgs",
)
"""Required Python packages: the client library and the message packages of interfaces/."""
PLANNING_PACKAGES: Final = ("moveit_msgs", "object_recognition_msgs", "octomap_msgs", "shape_msgs")
"""Additional packages that the planning server requires."""
INSTALL: Final = "run 'make setup' and use .venv/bin/servoloop, or source the workspace that contains the package"
"""What to do if a package is missing."""
LAST_DOMAIN: Final = 232
"""Highest domain ID for which UDP ports exist (DDSI-RTPS, 9.6.1.1)."""


class RosError(Exception):
    """Error if ROS 2 is missing, comes from another distribution, or has invalid settings. The message states the
    remedy."""


class RosMissing(RosError):
    """rclpy is not installed. Programs that can work without ROS catch this error and continue."""


def require_ros(further: Sequence[str] = ()) -> None:
    """Check ROS 2 and the environment of this process before nodes/ is imported.

    Args:
        further: Packages that are required in addition to ``PACKAGES``.

    Raises:
        RosMissing: rclpy is not installed.
        RosError: A part of ROS 2 is missing, comes from another distribution, or has invalid settings.
    """
    if missing := [name for name in (*PACKAGES, *further) if find_spec(name) is None]:
        raise (RosMissing if missing[0] == PACKAGES[0] else RosError)(
            f"ROS 2 Jazzy is required, but Python cannot find {missing[0]}: {INSTALL}"
        )
    _check_distribution()
    _check_domain(os.environ)
    _check_middleware(os.environ)
    _check_log_folder(os.environ)
    if os.environ.get("NO_COLOR"):
        os.environ.setdefault("RCUTILS_COLORIZED_OUTPUT", "0")  # The loggers of rcl read only this variable.
    _import_rclpy()


def _check_distribution() -> None:
    try:
        found = version("rclpy")
    except PackageNotFoundError:  # An rclpy that was built from source has no package metadata.
        return
    if not found.startswith(RCLPY):
        raise RosError(
            f"ROS 2 Jazzy (rclpy {RCLPY}x) is required, but Python finds rclpy {found}: open a shell in which no other "
            "ROS 2 distribution is sourced"
        )


def _check_domain(environment: Mapping[str, str]) -> None:
    text = environment.get("ROS_DOMAIN_ID", "")
    if text and not (text.isascii() and text.isdigit() and int(text) <= LAST_DOMAIN):
        raise RosError(f"ROS_DOMAIN_ID must be 0 to {LAST_DOMAIN}, not '{text}': correct or unset it")


def _check_middleware(environment: Mapping[str, str]) -> None:
    name = environment.get("RMW_IMPLEMENTATION", "")
    folders = [Path(folder) for folder in environment.get("LD_LIBRARY_PATH", "").split(os.pathsep) if folder]
    folders += [Path(prefix) / "lib" for prefix in environment.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    packaged = name.isidentifier() and find_spec(name) is not None
    if name and not packaged and not any((folder / f"lib{name}.so").exists() for folder in folders):
        raise RosError(f"RMW_IMPLEMENTATION is {name}, which is not installed: unset it, or install {name}")


def _check_log_folder(environment: Mapping[str, str]) -> None:
    """Check the folder in which rcl creates its log file, because rcl does not start without a writable folder."""
    if text := environment.get("ROS_LOG_DIR"):
        variable, folder = "ROS_LOG_DIR", Path(text).expanduser()
    elif text := environment.get("ROS_HOME"):
        variable, folder = "ROS_HOME", Path(text).expanduser() / "log"
    elif text := environment.get("HOME"):
        variable, folder = "HOME", Path(text) / ".ros" / "log"
    else:
        raise RosError("HOME is not set, but ROS 2 needs a folder for its logs: set ROS_LOG_DIR to a writable folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        writable, reason = os.access(folder, os.W_OK), "no permission to write"
    except OSError as error:
        writable, reason = False, error.strerror or str(error)
    if not writable:
        raise RosError(
            f"ROS 2 cannot write its logs to {folder}, the folder that {variable} selects ({reason}): set ROS_LOG_DIR "
            "to a writable folder"
        )


def _import_rclpy() -> None:
    try:
        import_module("rclpy")
    except ImportError as error:
        spec = find_spec("rclpy")
        place = spec.origin if spec is not None else "rclpy"
        raise RosError(
            f"{place} does not work with this Python ({error}): open a shell in which no other ROS 2 distribution is "
            "sourced, or remove its folder from PYTHONPATH"
        ) from error
