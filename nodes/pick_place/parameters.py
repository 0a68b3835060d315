"""The node's ROS parameters: declared with the defaults of ``Settings``, read once."""

from collections.abc import Sequence
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from nodes.pick_place.settings import Settings, normal_grade

AUTO_GOAL = "auto_goal_from_vision"
ACTION_NAME = "pick_place_action_name"
_SECONDS = ("move_time_s", "server_timeout_s", "goal_timeout_s", "result_timeout_s",
            "cancel_timeout_s", "vision_max_age_s")  # fmt: skip


def declare(node: Node) -> Settings:
    """Declare everything and read the settings. Raises ValueError with all that is wrong."""
    # looked at with every vision message, so it may be changed while the node runs
    node.declare_parameter(AUTO_GOAL, True)
    default = Settings()
    grades = _fixed(node, "grades", list(default.bins_rad))
    return Settings(
        joints=tuple(_fixed(node, "joints", list(default.joints))),
        ready_rad=_pose(node, "poses.ready", default.ready_rad),
        pick_rad=_pose(node, "poses.pick", default.pick_rad),
        bins_rad={normal_grade(grade): _pose(node, f"bins.{grade}", default.bins_rad.get(grade)) for grade in grades},
        hand_open_m=_fixed(node, "hand_open_m", default.hand_open_m),
        hand_closed_m=_fixed(node, "hand_closed_m", default.hand_closed_m),
        **{name: _fixed(node, name, getattr(default, name)) for name in _SECONDS},
    )


def action_name(node: Node) -> str:
    """The name of the pick-and-place action."""
    return str(_fixed(node, ACTION_NAME, "/sorting/arm/pick_place"))


def _fixed(node: Node, name: str, default: Any) -> Any:
    """Read once: a change at run time is refused instead of being accepted and ignored."""
    value = node.declare_parameter(name, default, ParameterDescriptor(read_only=True)).value
    if value is None:
        raise ValueError(f"{name} is missing or empty")
    return value


def _pose(node: Node, name: str, default: Sequence[float] | None) -> tuple[float, ...]:
    """The pose of a grade that is not the course's has no default, only a type."""
    known = Parameter.Type.DOUBLE_ARRAY if default is None else list(default)
    return tuple(_fixed(node, name, known))
