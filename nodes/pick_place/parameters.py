"""Declare the ROS parameters of the node with the defaults of ``JobSettings``, and read them once."""

from collections.abc import Iterator, Sequence
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from controller.manager.node_parameters import files_in
from nodes.pick_place.settings import JobSettings, normal_grade

AUTO_GOAL = "auto_goal_from_vision"
ACTION_NAME = "pick_place_action_name"
_SECONDS = ("move_time_s", "server_timeout_s", "goal_timeout_s", "result_timeout_s",
            "cancel_timeout_s", "vision_max_age_s")  # fmt: skip
_OF_RCLPY = ("use_sim_time", "start_type_description_service", "qos_overrides.")


def undeclare_overrides(node: Node) -> set[str]:
    """Undeclare the parameters set by files and arguments, and return their names. ``declare`` declares them again.

    The node must be created with ``automatically_declare_parameters_from_overrides``. rclpy offers no other way to list
    the overrides.
    """
    given = {name for name in node.get_parameters_by_prefix("") if not name.startswith(_OF_RCLPY)}
    for name in given:
        node.undeclare_parameter(name)
    return given


def unused(node: Node, given: set[str], arguments: Sequence[str]) -> Iterator[str]:
    """Yield warnings about unknown parameters and about files without parameters for this node."""
    for name in sorted(name for name in given if not node.has_parameter(name)):
        yield f"parameter '{name}' is ignored: this node has no parameter with that name"
    files = files_in(arguments)
    if files and not given:
        listed = ", ".join(map(str, files))
        yield f"{listed} contains no parameters for {node.get_fully_qualified_name()}: using the defaults"


def declare(node: Node) -> JobSettings:
    """Declare all parameters and read the settings.

    Raises:
        ValueError: A parameter is invalid. The message lists all mistakes.
    """
    # This parameter is read at every vision message, so it can be changed at run time.
    node.declare_parameter(AUTO_GOAL, True)
    default = JobSettings()
    grades = _fixed(node, "grades", list(default.bins_rad))
    return JobSettings(
        joints=tuple(_fixed(node, "joints", list(default.joints))),
        ready_rad=_pose(node, "poses.ready", default.ready_rad),
        pick_rad=_pose(node, "poses.pick", default.pick_rad),
        bins_rad={normal_grade(grade): _pose(node, f"bins.{grade}", default.bins_rad.get(grade)) for grade in grades},
        hand_open_m=_fixed(node, "hand_open_m", default.hand_open_m),
        hand_closed_m=_fixed(node, "hand_closed_m", default.hand_closed_m),
        **{name: _fixed(node, name, getattr(default, name)) for name in _SECONDS},
    )


def action_name(node: Node) -> str:
    """Return the name of the pick-and-place action."""
    return str(_fixed(node, ACTION_NAME, "/sorting/arm/pick_place"))


def _fixed(node: Node, name: str, default: Any) -> Any:
    """Declare and read a read-only parameter, so that a change at run time is rejected and not ignored."""
    value = node.declare_parameter(name, default, ParameterDescriptor(read_only=True)).value
    if value is None:
        raise ValueError(f"parameter '{name}' is missing or empty: set it in the parameters file")
    return value


def _pose(node: Node, name: str, default: Sequence[float] | None) -> tuple[float, ...]:
    """Read a pose. The poses of additional grades have a type but no default."""
    known = Parameter.Type.DOUBLE_ARRAY if default is None else list(default)
    return tuple(_fixed(node, name, known))
