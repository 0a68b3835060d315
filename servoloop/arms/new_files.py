"""Generate the robot file, the controllers file and ``arm.yaml`` of a new arm."""

from collections.abc import Mapping, Sequence
from math import pi
from typing import Any, Final

import yaml

from drivers.servos.catalog import series_of
from drivers.servos.register import ServoModel
from hal.robot_description.urdf import UrdfJoint
from servoloop.arms.new_urdf import NewDescription, metres_per_radian

ROBOT: Final = """\
# The servo of each joint. docs/hardware.md describes the fields. Correct servo_id, model and sign (-1 if the servo is
# mounted mirrored). `servoloop calibrate` measures sign and zero_counts.
"""
EXIT: Final = """\
# What happens when the program exits. hold keeps the torque enabled. relax moves to the pose under park and disables
# the torque. Before you use relax, add a pose in which the arm lies safely with its torque off.
"""
CONTROLLERS: Final = """\
# Parameter file in the format of ros2_control. Add or change controllers as you like.
"""
ARM: Final = """\
# The positive directions are those of the URDF. Describe each direction in your own words for `servoloop calibrate`.
"""
WIDTH: Final = 120
REVOLUTE: Final = (12.0, 120.0)
"""Acceleration and jerk of a revolute joint, in rad/s² and rad/s³."""
LINEAR: Final = (1.0, 20.0)
"""Acceleration and jerk of a prismatic joint, in m/s² and m/s³."""
TOLERANCES: Final = {"trajectory": 0.3, "goal": 0.05}
LINEAR_TOLERANCES: Final = {"trajectory": 0.03, "goal": 0.005}


def robot_text(made: NewDescription, model: ServoModel) -> str:
    """Return the robot file, with one servo per joint and IDs that start at 1 and follow the joint order."""
    joints = {joint.name: _servo(number, joint, model) for number, joint in enumerate(made.joints, 1)}
    bus = {"protocol": series_of(model).make, "baud": 1_000_000}
    defaults = {"arm_controller": {"interpolation_method": "ruckig"}}
    return (
        ROBOT
        + yaml_text({"bus": bus, "joints": joints})
        + EXIT
        + yaml_text({"on_exit": {"virtual": "hold", "real": "hold"}, "controller_defaults": defaults})
    )


def controllers_text(made: NewDescription) -> str:
    """Return the controllers file, with a trajectory controller for the arm and a controller for the hand, if any."""
    names = [joint.name for joint in made.hand if joint not in made.arm]
    types = {
        "joint_state_broadcaster": "joint_state_broadcaster/JointStateBroadcaster",
        "arm_controller": "joint_trajectory_controller/JointTrajectoryController",
        **({"hand_controller": "forward_command_controller/ForwardCommandController"} if names else {}),
    }
    manager = {"update_rate": 20, **{name: {"type": kind} for name, kind in types.items()}}
    content = {"controller_manager": manager, "arm_controller": _arm_controller(made.arm)}
    if names:
        content["hand_controller"] = {"joints": names, "interface_name": "position"}
    return CONTROLLERS + yaml_text({node: {"ros__parameters": parameters} for node, parameters in content.items()})


def arm_text(description: str, joints: Sequence[UrdfJoint]) -> str:
    """Return ``arm.yaml``, with the description and the calibration plan of the arm."""
    plans = {joint.name: {"positive": _positive(joint)} for joint in joints}
    return ARM + yaml_text({"description": description, "calibration": {"joints": plans}})


def _positive(joint: UrdfJoint) -> str:
    axis = " ".join(f"{value:g}" for value in joint.axis)
    how = "Push" if joint.kind == "prismatic" else "Turn"
    return f"{how} {joint.name} in its positive direction (axis {axis} in {joint.child})"


def _servo(number: int, joint: UrdfJoint, model: ServoModel) -> dict[str, Any]:
    acceleration, jerk = LINEAR if joint.kind == "prismatic" else REVOLUTE
    transmission = metres_per_radian(joint)
    counts_per_unit = model.counts_per_turn / (2.0 * pi * (transmission or 1.0))
    middle = (model.last_count + 1) // 2
    fields: dict[str, Any] = {"servo_id": number, "model": model.name, "sign": 1}
    fields["zero_counts"] = middle - round(0.5 * (joint.lower + joint.upper) * counts_per_unit)
    if transmission is not None:
        fields["metres_per_radian"] = transmission
    return {**fields, "acceleration": acceleration, "jerk": jerk}


def _arm_controller(joints: Sequence[UrdfJoint]) -> Mapping[str, Any]:
    tolerances = {joint.name: dict(LINEAR_TOLERANCES if joint.kind == "prismatic" else TOLERANCES) for joint in joints}
    return {
        "joints": [joint.name for joint in joints],
        "command_interfaces": ["position"],
        "state_interfaces": ["position", "velocity"],
        "allow_nonzero_velocity_at_trajectory_end": True,
        "constraints": {"goal_time": 1.0, **tolerances},
    }


def yaml_text(content: Mapping[str, Any]) -> str:
    """Return content as YAML, with each short list or mapping on one line."""
    text: str = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=WIDTH, allow_unicode=True)
    return text
