"""Test your own program without hardware and faster than real time. Run: pytest test_own_robot.py"""

from collections.abc import Iterator

import pytest

from servoloop import Arm, ArmInputError


def wave(arm: Arm, times: int = 2) -> None:
    """The program under test: raise the arm and wave with the wrist."""
    arm.move_to({"shoulder_pan": 0.0, "shoulder_lift": -1.0, "elbow_flex": 0.0, "wrist_flex": 0.0}, duration=2.0)
    for _ in range(times):
        arm.move_to({"wrist_roll": 0.4}, duration=0.8)
        arm.move_to({"wrist_roll": -0.4}, duration=0.8)


@pytest.fixture(params=[1, 2])
def arm(request: pytest.FixtureRequest) -> Iterator[Arm]:
    """Create a virtual arm. The tests run with two arms, which differ in friction, motors and masses."""
    with Arm.simulated("so101", seed=request.param) as simulated:
        yield simulated


def test_the_arm_waves_to_both_sides(arm: Arm) -> None:
    angles: list[float] = []
    arm.on_state(lambda state: angles.append(state.position["wrist_roll"]))
    wave(arm)
    assert max(angles[-60:]) > 0.3 and min(angles[-60:]) < -0.3
    assert not arm.faults


def test_a_target_outside_the_limits_is_refused(arm: Arm) -> None:
    with pytest.raises(ArmInputError, match="wrist_roll"):
        arm.move_to({"wrist_roll": 9.0})
