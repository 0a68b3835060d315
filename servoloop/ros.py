"""A check that Python finds the ROS 2 on which nodes/ is built."""

from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
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


class RosError(Exception):
    """ROS 2 is missing, or another one is there. The text says what to do."""


def require_ros() -> None:
    """Check for ROS 2 before nodes/ is imported. Raises RosError."""
    if missing := [name for name in PACKAGES if find_spec(name) is None]:
        raise RosError(
            f"this needs ROS 2 Jazzy, and Python finds no {missing[0]}: run 'make setup' and use .venv/bin/servoloop, "
            "or source the workspace in which it is built"
        )
    try:
        found = version("rclpy")
    except PackageNotFoundError:  # a build of one's own says nothing of itself
        return
    if not found.startswith(RCLPY):
        raise RosError(
            f"this needs ROS 2 Jazzy (rclpy {RCLPY}x), and Python finds rclpy {found}: open a shell in which no other "
            "ROS 2 is sourced"
        )
