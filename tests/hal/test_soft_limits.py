"""Soft limits of ``<safety_controller>`` narrow the positions of a joint."""

import pytest

from hal.hal_errors import DescriptionError
from hal.robot_description.description import Description, parse_urdf

URDF = """<robot name="r"><link name="base"/><link name="arm"/>
<joint name="lift" type="revolute"><parent link="base"/><child link="arm"/>
<limit lower="-1" upper="1" velocity="2" effort="3"/>
<safety_controller {safety}/></joint>
<ros2_control name="arm" type="system"><hardware><plugin>mock_components/GenericSystem</plugin></hardware>
<joint name="lift"><command_interface name="position">{minimum}</command_interface></joint></ros2_control></robot>"""


def parsed(safety: str, minimum: str = "") -> Description:
    return parse_urdf(URDF.format(safety=f'k_velocity="10" {safety}', minimum=minimum), "arm.urdf")


@pytest.mark.parametrize(
    ("safety", "limits", "warning"),
    [
        ('soft_lower_limit="-0.9" soft_upper_limit="0.8"', (-0.9, 0.8), ""),
        ('soft_upper_limit="0.8"', (0.0, 0.8), ""),
        (
            'soft_lower_limit="-0.9" soft_upper_limit="2"',
            (-0.9, 1.0),
            "soft_upper_limit 2.0 is above the joint's limit",
        ),
        (
            'soft_lower_limit="0" soft_upper_limit="0"',
            (-1.0, 1.0),
            "are both 0.0 (arm.urdf, line 4) and have no effect",
        ),
        ("", (-1.0, 1.0), ""),
    ],
    ids=["both", "one", "beyond the limit", "equal", "none"],
)
def test_soft_limits_narrow_the_range(safety: str, limits: tuple[float, float], warning: str) -> None:
    description = parsed(safety)
    joint = description.joints["lift"]
    assert (joint.lower, joint.upper) == limits
    assert joint.stops == (None if limits == (-1.0, 1.0) else (-1.0, 1.0))
    assert [warning in one for one in description.warnings] == [True] * bool(warning)


def test_the_narrower_of_soft_limit_and_command_range_applies() -> None:
    joint = parsed('soft_lower_limit="-0.9" soft_upper_limit="0.8"', '<param name="min">-0.5</param>').joints["lift"]
    assert (joint.lower, joint.upper, joint.stops) == (-0.5, 0.8, (-1.0, 1.0))


@pytest.mark.parametrize(
    ("safety", "reason"),
    [
        ('soft_lower_limit="0.5" soft_upper_limit="-0.5"', r"0.5 is above soft_upper_limit -0.5 \(arm.urdf, line 4\)"),
        ('soft_lower_limit="2" soft_upper_limit="3"', r"are outside the joint's limits -1.0 to 1.0: correct them"),
        ('soft_lower_limit="low"', r"soft_lower_limit must be a finite number .*, not .low. \(arm.urdf, line 4\)"),
    ],
)
def test_soft_limits_without_a_range_are_refused(safety: str, reason: str) -> None:
    with pytest.raises(DescriptionError, match=reason):
        parsed(safety)
