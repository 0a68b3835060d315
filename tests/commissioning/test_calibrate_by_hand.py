"""Calibration by hand of arms that nobody aligned: zeros and directions are found, wherever the seam lies."""

from math import tau

import pytest

from commissioning.calibrate.flow import ByHand
from commissioning.calibrate.result import doubts
from drivers.servos.sts import torque_enable
from servoloop.arms.folder import find_arm
from tests.commissioning.arm import PLAN, Person, UnalignedArm
from tests.drivers.fault_lines import CYCLES

ZERO_RAD, ZERO_WITH_BACKLASH_RAD = 0.01, 0.03
ARMS = (
    ("so101", 0.0),
    ("so101", 1.0),
    ("robot_arm", 1.0),
    # The hand presses its trigger, whose gears are light, a little into the stop.
    ("so101_leader", 1.0),
)
SEEDS = [
    pytest.param(0, marks=pytest.mark.slow),
    *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(1, CYCLES // 500)),
]
"""In make soak twenty."""


@pytest.mark.parametrize(("name", "backlash_deg"), ARMS)
@pytest.mark.parametrize("seed", SEEDS)
def test_zeros_and_directions_are_found(seed: int, name: str, backlash_deg: float) -> None:
    arm = UnalignedArm(seed, backlash_deg, name)
    plans = PLAN.joints if name == "robot_arm" else find_arm(name).file.calibration.joints
    found = ByHand(arm.bus, arm.joints, plans, Person(arm, plans)).run()
    allowed_rad = ZERO_WITH_BACKLASH_RAD if backlash_deg else ZERO_RAD
    for joint in arm.joints:
        made, true = found[joint.name], arm.coupling(joint.name)
        assert made.sign == true.sign, joint.name
        off = (made.zero_counts + (made.homing_offset or 0) - true.zero_counts + 2048) % 4096 - 2048
        assert abs(off) * tau / 4096 <= allowed_rad, joint.name
        assert 0 <= made.lower_counts < made.upper_counts <= 4095
        assert doubts(joint, made) == ""
    assert not any(servo.memory.get(torque_enable) for servo in arm.line.servos)
