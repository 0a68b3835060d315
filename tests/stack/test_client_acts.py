"""Tests of jogging and guiding by simulated clients."""

import pytest

from servoloop.campaign.campaign import run_schedule_of
from servoloop.simulation.acts import Act, GuideArm, Jog
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.schedule import Schedule


def turned(arm: str, act: Act, joint: str) -> tuple[list[float], tuple[str, ...]]:
    """Run one act. Return the angle of the joint in each cycle of 0.05 s, and the violations."""
    angles: list[float] = []

    def prepare(stack: FaultyStack) -> None:
        place = stack.files.robot.joints.index(next(one for one in stack.files.robot.joints if one.name == joint))
        stack.on_state = lambda state: angles.append(float(stack.world.position()[place]))

    report = run_schedule_of(Schedule(arm=arm, seconds=3.0, clients=(act,)), prepare)
    return angles, tuple(str(violation) for violation in report.violations)


@pytest.mark.parametrize(
    ("arm", "joint"), [("robot_arm", "joint1"), ("so101", "shoulder_pan"), ("koch", "shoulder_pan")]
)
def test_jogged_joint_moves_while_key_is_held_and_stops_soon_after(arm: str, joint: str) -> None:
    angles, violations = turned(arm, Jog(at_s=0.5, joint=joint, share=1.0, for_s=1.0), joint)
    assert not violations
    assert angles[32] - angles[10] > 0.2
    assert abs(angles[-1] - angles[44]) < 0.02


@pytest.mark.parametrize(
    ("arm", "joint"), [("robot_arm", "joint1"), ("so101", "shoulder_pan"), ("koch", "shoulder_pan")]
)
def test_a_guided_joint_follows_the_hand_and_is_then_held(arm: str, joint: str) -> None:
    angles, violations = turned(arm, GuideArm(at_s=0.3, joint=joint, share=1.0, for_s=1.5), joint)
    assert not violations
    assert angles[36] - angles[6] > 0.2
    assert abs(angles[-1] - angles[44]) < 0.05  # The hand leaves the gears under tension, which the arm then relieves.
