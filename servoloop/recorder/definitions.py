"""The message definitions of a recording: those of ROS 2 Jazzy, and the few in ``msg/`` that Jazzy does not have."""

from functools import cache
from pathlib import Path

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

MSG = Path(__file__).parent / "msg"


@cache
def typestore() -> Typestore:
    """All types by their name (``sensor_msgs/msg/JointState``); it takes a tenth of a second, once."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for path in sorted(MSG.glob("*/*.msg")):
        store.register(get_types_from_msg(path.read_text(), f"{path.parent.name}/msg/{path.stem}"))
    return store


def definition(name: str) -> str:
    """The text of a type with those of all types in it, as a schema of the encoding ros2msg has it."""
    return typestore().generate_msgdef(name, ros_version=2)[0]
