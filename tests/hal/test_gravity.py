"""Tests of the gravity torques against MuJoCo, and with incomplete URDFs."""

import math
import re
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.compensation.gravity import GRAVITY_M_S2, Gravity
from hal.hal_errors import DescriptionError
from hal.robot_description.description import parse_urdf
from hal.types import FloatArray
from servoloop.stack.shipped_files import URDF

JOINTS = (*(f"joint{i}" for i in range(1, 7)), "hand_right_joint")
ARM = parse_urdf(URDF.read_text())
GRAVITY = Gravity(ARM, JOINTS)
LIMITS = [(ARM.joints[name].lower, ARM.joints[name].upper) for name in JOINTS]
CONTROL = (
    '<ros2_control name="a" type="system"><hardware><plugin>servoloop/ServoHardware</plugin></hardware>'
    '<joint name="lift"><command_interface name="position"/></joint></ros2_control>'
)


@pytest.fixture(scope="module")
def model() -> Any:
    """Load the URDF with MuJoCo."""
    return mujoco.MjModel.from_xml_string(re.sub(r"<ros2_control.*</ros2_control>", "", ARM.xml, flags=re.DOTALL))


def bias(model: Any, position: FloatArray) -> FloatArray:
    """Return the torques of MuJoCo. The servo of the right finger also carries the force of the left finger."""
    data = mujoco.MjData(model)
    for name, value in zip((*JOINTS, "hand_left_joint"), (*position, position[-1]), strict=True):
        data.joint(name).qpos[0] = value
    mujoco.mj_forward(model, data)
    torques = np.array([data.joint(name).qfrc_bias[0] for name in JOINTS])
    torques[-1] += data.joint("hand_left_joint").qfrc_bias[0]
    return torques


@given(st.tuples(*(st.floats(lower, upper) for lower, upper in LIMITS)))
def test_the_torques_equal_those_of_mujoco(model: Any, pose: tuple[float, ...]) -> None:
    position = np.array(pose)
    assert GRAVITY.torques(position) == pytest.approx(bias(model, position), rel=1e-9, abs=1e-9)


def arm(links: str, joints: str) -> Gravity:
    return Gravity(parse_urdf(f'<robot name="r">{links}{joints}{CONTROL}</robot>'), ["lift"])


def link(name: str, kg: str = "", xyz: str = "0 0 0") -> str:
    inside = f'<inertial><origin xyz="{xyz}"/><mass value="{kg}"/></inertial>' if kg else ""
    return f'<link name="{name}">{inside}</link>'


def joint(name: str, parent: str, child: str, kind: str = "revolute", rest: str = "") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="0 -2 0"/><limit lower="-3" upper="3" velocity="1"/>{rest}</joint>'
    )


def test_a_level_arm_has_the_torque_of_its_weight_and_of_attached_links() -> None:
    lift = joint("lift", "base", "arm")
    level = arm(link("base", "5") + link("arm", "2", "0.5 0 0"), lift)
    assert level.torques(np.zeros(1)) == pytest.approx([2 * 0.5 * GRAVITY_M_S2])
    tool = joint("tool", "arm", "tip", "fixed", '<origin xyz="1 0 0" rpy="0 0 3.141592653589793"/>')
    both = arm(link("base") + link("arm", "2", "0.5 0 0") + link("tip", "1", "0.25 0 0"), lift + tool)
    # The tool is rotated, so its center of mass is 0.75 m from the joint.
    assert both.torques(np.zeros(1)) == pytest.approx([(2 * 0.5 + 1 * 0.75) * GRAVITY_M_S2])
    assert both.torques(np.array([math.pi / 2])) == pytest.approx([0.0], abs=1e-12)


def test_a_mimic_joint_loads_its_leader() -> None:
    follower = joint("other", "base", "arm2", rest='<mimic joint="lift" multiplier="-2" offset="0.5"/>')
    links = link("base") + link("arm") + link("arm2", "1", "1 0 0")
    found = arm(links, joint("lift", "base", "arm") + follower).torques(np.array([0.2]))
    assert found == pytest.approx([-2.0 * math.cos(-2 * 0.2 + 0.5) * GRAVITY_M_S2])


def test_torques_after_an_unknown_joint_are_zero() -> None:
    links = link("base") + link("mast") + link("arm", "1", "1 0 0")
    found = arm(links, joint("tilt", "base", "mast") + joint("lift", "mast", "arm")).torques(np.zeros(1))
    assert found.tolist() == [0.0]


def test_a_urdf_without_masses_has_no_torques_and_logs_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    found = arm(link("base") + link("arm"), joint("lift", "base", "arm")).torques(np.array([0.3]))
    assert found.tolist() == [0.0]
    assert "no masses" in caplog.text


@pytest.mark.parametrize("mass", ["heavy", "nan", "-1"])
def test_an_invalid_mass_is_refused_with_its_link(mass: str) -> None:
    with pytest.raises(DescriptionError, match="link 'arm': mass"):
        arm(link("base") + link("arm", mass), joint("lift", "base", "arm"))
