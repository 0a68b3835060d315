"""Load the message definitions of a recording, from ROS 2 Jazzy and, for types that Jazzy lacks, from ``msg/``."""

from functools import cache
from pathlib import Path

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

MSG = Path(__file__).parent / "msg"
BUS_TRAFFIC, CYCLE, GOAL_RESULT = (f"servoloop_msgs/msg/{name}" for name in ("BusTraffic", "Cycle", "GoalResult"))
CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
JOINT_STATE = "sensor_msgs/msg/JointState"
PICTURE = "sensor_msgs/msg/CompressedImage"
STRING = "std_msgs/msg/String"
TF = "tf2_msgs/msg/TFMessage"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
MESSAGE_TYPES = (BUS_TRAFFIC, CYCLE, GOAL_RESULT, CONTROLLER_STATE, DIAGNOSTICS, JOINT_STATE, STRING, TF, TRAJECTORY)
"""Types of all messages in a recording."""


@cache
def typestore() -> Typestore:
    """Return all message types, keyed by name, such as ``sensor_msgs/msg/JointState``. The first call takes 0.2 s.

    The first call also compiles the functions that encode the messages. The compiler blocks all other threads, so the
    first call must be made before the control loop starts.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    for path in sorted(MSG.glob("*/*.msg")):
        store.register(get_types_from_msg(path.read_text(), f"{path.parent.name}/msg/{path.stem}"))
    for kind in MESSAGE_TYPES:
        store.get_msgdef(kind)
    return store


def definition(name: str) -> str:
    """Return the definition of a type and of all types it contains, as an MCAP schema with the encoding ros2msg."""
    return typestore().generate_msgdef(name, ros_version=2)[0]
