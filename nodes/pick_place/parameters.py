"""Declare the node's ROS parameters with the default settings, and read them once."""

from collections.abc import Sequence
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from pick_place.pose_settings import PickObject, PoseSettings
from pick_place.settings import SECONDS, ArmSettings, JobSettings, normal_grade

AUTO_GOAL = "auto_goal_from_vision"
ACTION_NAME = "pick_place_action_name"
JOINTS = "joints"
POSES = "poses"


def declare(node: Node) -> JobSettings | PoseSettings:
    """Declare all parameters for the configured type of motion, and read the settings.

    Raises:
        ValueError: A parameter is invalid. The message lists all errors.
    """
    # This parameter is read for every vision message, so it can be changed at run time.
    node.declare_parameter(AUTO_GOAL, True)
    motion = _fixed(node, "motion", JOINTS)
    if motion not in (JOINTS, POSES):
        raise ValueError(f"motion is {motion!r}: choose {JOINTS} or {POSES}")
    grades = [str(grade) for grade in _fixed(node, "grades", list(JobSettings().bins_rad))]
    return _pose_settings(node, grades) if motion == POSES else _job_settings(node, grades)


def _job_settings(node: Node, grades: Sequence[str]) -> JobSettings:
    default = JobSettings()
    return JobSettings(
        **_common(node, default),
        pick_rad=_pose(node, "poses.pick", default.pick_rad),
        bins_rad={normal_grade(grade): _pose(node, f"bins.{grade}", default.bins_rad.get(grade)) for grade in grades},
    )


def _pose_settings(node: Node, grades: Sequence[str]) -> PoseSettings:
    default = PoseSettings()
    bins = {grade: _pose(node, f"bins.{grade}.pose", default.bins.get(grade)) for grade in grades}
    return PoseSettings(
        **_common(node, default),
        pick=_pose(node, "pick.pose", default.pick),
        bins={normal_grade(grade): pose for grade, pose in bins.items()},
        frame=_fixed(node, "planning.frame", default.frame),
        group=_fixed(node, "planning.group", default.group),
        tool_link=_fixed(node, "planning.tool_link", default.tool_link),
        approach_m=_fixed(node, "planning.approach_m", default.approach_m),
        speed=_fixed(node, "planning.speed", default.speed),
        planning_time_s=_fixed(node, "planning.time_s", default.planning_time_s),
        hand_time_s=_fixed(node, "hand_time_s", default.hand_time_s),
        target=_object(node, default.target),
    )


def _object(node: Node, default: PickObject) -> PickObject:
    return PickObject(
        name=_fixed(node, "object.name", default.name),
        size_m=_pose(node, "object.size", default.size_m),
        position_m=_pose(node, "object.position", default.position_m),
        touch_links=tuple(_fixed(node, "object.touch_links", list(default.touch_links))),
    )


def _common(node: Node, default: ArmSettings) -> dict[str, Any]:
    """Read the settings that both types of motion share."""
    return {
        "joints": tuple(_fixed(node, "joints", list(default.joints))),
        "ready_rad": _pose(node, "poses.ready", default.ready_rad),
        "arm_controller": _fixed(node, "arm_controller", default.arm_controller),
        "hand_controller": _fixed(node, "hand_controller", default.hand_controller),
        "hand_open_m": _fixed(node, "hand_open_m", default.hand_open_m),
        "hand_closed_m": _fixed(node, "hand_closed_m", default.hand_closed_m),
        **{name: _fixed(node, name, getattr(default, name)) for name in SECONDS},
    }


def action_name(node: Node) -> str:
    """Return the name of the pick-and-place action."""
    return str(_fixed(node, ACTION_NAME, "sorting/arm/pick_place"))


def _fixed(node: Node, name: str, default: Any) -> Any:
    """Declare and read a read-only parameter, so that a change at run time is rejected instead of ignored."""
    value = node.declare_parameter(name, default, ParameterDescriptor(read_only=True)).value
    if value is None:
        raise ValueError(f"parameter '{name}' is missing or empty: set it in the parameters file")
    return value


def _pose(node: Node, name: str, default: Sequence[float] | None) -> tuple[float, ...]:
    """Read a pose. The poses of additional grades have a type but no default value."""
    known = Parameter.Type.DOUBLE_ARRAY if default is None else list(default)
    return tuple(_fixed(node, name, known))
