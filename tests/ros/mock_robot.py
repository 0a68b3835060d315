"""The arm with a mock for almost every joint. Each mock has its own block and its own parameters."""

import re
from pathlib import Path

from servoloop.stack.shipped_files import URDF
from tests.ros.two_components import HAND, MOCK, servos, write_robot_file

FOLLOWER = "hand_left_joint"
MULTIPLIER, OFFSET_M = -0.5, 0.02
"""Multiplier and offset of the hand's ``<mimic>``."""
PERIOD_S = 0.05
DYNAMIC = '<param name="calculate_dynamics">true</param>'
FROZEN = '<param name="disable_commands">true</param>'

CONTROLLERS = f"""
controller_manager:
  ros__parameters:
    update_rate: {1 / PERIOD_S:g}
    joint_state_broadcaster: {{type: joint_state_broadcaster/JointStateBroadcaster}}
    positions: {{type: forward_command_controller/ForwardCommandController}}
    speeds: {{type: velocity_controllers/JointGroupVelocityController}}
    efforts: {{type: effort_controllers/JointGroupEffortController}}
positions: {{ros__parameters: {{joints: [joint1, joint2, joint4, {HAND}], interface_name: position}}}}
speeds: {{ros__parameters: {{joints: [joint3], command_timeout: 0.0}}}}
efforts: {{ros__parameters: {{joints: [joint5], command_timeout: 0.0}}}}
"""


def state(name: str, initial: float | None = None) -> str:
    value = "" if initial is None else f'<param name="initial_value">{initial}</param>'
    return f'<state_interface name="{name}">{value}</state_interface>'


def joint(name: str, command: str = "", begin: float | None = None, more: str = "") -> str:
    """Return the XML of a joint with position and velocity states, extra interfaces and an initial value."""
    commands = f'<command_interface name="{command}"/>' if command else ""
    return f'<joint name="{name}">{commands}{state("position", begin)}{state("velocity")}{more}</joint>'


def block(name: str, kind: str, hardware: str, *joints: str) -> str:
    inside = f"<hardware>{hardware}</hardware>{''.join(joints)}"
    return f'<ros2_control name="{name}" type="{kind}">{inside}</ros2_control>'


def blocks(folder: Path) -> str:
    """Return the XML of all blocks. ``wheel`` has servos, so that ``--hardware mock`` can replace them."""
    wheel = servos(write_robot_file(folder, "wheel", "joint3"))
    extra = state("effort") + state("heat", 21.5) + state("offset")
    return "".join(
        (
            block("plain-1", "system", MOCK, joint("joint1", "position", 0.25, extra)),
            block("smooth", "actuator", MOCK + DYNAMIC, joint("joint2", "position")),
            block("wheel", "system", wheel + DYNAMIC, joint("joint3", "velocity")),
            block("stuck", "system", MOCK + FROZEN, joint("joint4", "position", 0.125)),
            block("strong", "system", MOCK, joint("joint5", "effort", more=state("effort"))),
            block("probe", "sensor", MOCK, joint("joint6", begin=-0.5)),
            block("hand", "system", MOCK + DYNAMIC, joint(HAND, "position"), joint(FOLLOWER)),
        )
    )


def write_mocks(folder: Path) -> tuple[Path, Path]:
    """Write the URDF and the controllers file."""
    text, count = re.subn("<ros2_control.*</ros2_control>", blocks(folder), URDF.read_text(), flags=re.DOTALL)
    mimic = f'<mimic joint="{HAND}"/>'
    assert count == 1 and mimic in text
    urdf, controllers = folder / "mocks.urdf", folder / "controllers.yaml"
    urdf.write_text(text.replace(mimic, f'<mimic joint="{HAND}" multiplier="{MULTIPLIER}" offset="{OFFSET_M}"/>'))
    controllers.write_text(CONTROLLERS)
    return urdf, controllers
