"""The node's ROS parameters: declared with the defaults of ``Settings``, read once."""

from collections.abc import Iterator, Sequence
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from controller.manager.node_parameters import files_in
from nodes.pick_place.settings import Settings, normal_grade

AUTO_GOAL = "auto_goal_from_vision"
ACTION_NAME = "pick_place_action_name"
_SECONDS = ("move_time_s", "server_timeout_s", "goal_timeout_s", "result_timeout_s",
            "cancel_timeout_s", "vision_max_age_s")  # fmt: skip
_OF_RCLPY = ("use_sim_time", "start_type_description_service", "qos_overrides.")


def take_given(node: Node) -> set[str]:
    """The names of the parameters that files and arguments give the node; ``declare`` declares those of this node.

    The node was created with ``automatically_declare_parameters_from_overrides``: rclpy shows them in no other way.
    """
    given = {name for name in node.get_parameters_by_prefix("") if not name.startswith(_OF_RCLPY)}
    for name in given:
        node.undeclare_parameter(name)
    return given


def unused(node: Node, given: set[str], arguments: Sequence[str]) -> Iterator[str]:
    """Warnings about parameters that this node does not have, and about files without parameters for it."""
    for name in sorted(name for name in given if not node.has_parameter(name)):
        yield f"the parameter '{name}' is not used: this node has no parameter of that name"
    files = files_in(arguments)
    if files and not given:
        listed = ", ".join(map(str, files))
        yield f"{listed} has no parameters for {node.get_fully_qualified_name()}: all have their defaults"


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
