"""The message definitions of a recording: those of ROS 2 Jazzy, and the few in ``msg/`` that Jazzy does not have."""

from functools import cache
from pathlib import Path

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

MSG = Path(__file__).parent / "msg"
BUS_TRAFFIC, CYCLE, GOAL_RESULT = (f"servoloop_msgs/msg/{name}" for name in ("BusTraffic", "Cycle", "GoalResult"))
CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
JOINT_STATE = "sensor_msgs/msg/JointState"
STRING = "std_msgs/msg/String"
TF = "tf2_msgs/msg/TFMessage"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
MESSAGE_TYPES = (BUS_TRAFFIC, CYCLE, GOAL_RESULT, CONTROLLER_STATE, DIAGNOSTICS, JOINT_STATE, STRING, TF, TRAJECTORY)
"""The types of all messages in a recording."""


@cache
def typestore() -> Typestore:
    """All types by their name (``sensor_msgs/msg/JointState``); it takes a fifth of a second, once.

    The functions that encode them are made here, by Python's compiler: while that runs, no other thread does, and a
    loop under way would be late.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    for path in sorted(MSG.glob("*/*.msg")):
        store.register(get_types_from_msg(path.read_text(), f"{path.parent.name}/msg/{path.stem}"))
    for kind in MESSAGE_TYPES:
        store.get_msgdef(kind)
    return store


def definition(name: str) -> str:
    """The text of a type with those of all types in it, as a schema of the encoding ros2msg has it."""
    return typestore().generate_msgdef(name, ros_version=2)[0]
