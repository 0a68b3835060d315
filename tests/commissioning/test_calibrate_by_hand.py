"""Calibration by hand finds zeros and directions of randomly mounted servos, wherever the seam lies."""

from typing import Any, cast

import pytest

from commissioning.calibrate.by_hand import ByHand, as_joint
from commissioning.calibrate.result import travel_warnings
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import X
from servoloop.stack.arm_folders import arms, find_arm, read_arm_files
from tests.commissioning.arm import Person, UnalignedArm, off_rad
from tests.commissioning.held import HeldArm
from tests.drivers.fault_lines import CYCLES

ZERO_RAD, ZERO_WITH_BACKLASH_RAD = 0.02, 0.025
FIRST = (
    (0, "so101", 0.0),
    (0, "so101", 1.0),
    (0, "robot_arm", 1.0),
    # The hand presses the trigger slightly into its stop, because the gears of the trigger are light.
    (0, "so101_leader", 1.0),
    # Its wrist turns freely.
    (0, "so100", 1.0),
    # The servos of this arm move their seams in extended position mode.
    (0, "koch", 1.0),
)
SEEDS = range(CYCLES // 1000) if CYCLES > 1000 else ()
"""Seeds that ``make soak`` runs for each arm, with and without backlash."""
HELD_SEEDS = [0, 1, *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(2, CYCLES // 100))]
ONE_BUS = [arm.name for arm in arms() if len(read_arm_files(arm).robot.file.lines()) == 1]
"""Arms with one bus. A robot with several arms is calibrated one arm after the other."""
FURTHER = [(seed, name, gap) for name in ONE_BUS for gap in (0.0, 1.0) for seed in SEEDS]


@pytest.mark.parametrize(
    ("seed", "name", "backlash_deg"),
    [
        *(pytest.param(*one, marks=pytest.mark.slow) for one in FIRST),
        *(pytest.param(*one, marks=pytest.mark.soak) for one in FURTHER if one not in FIRST),
    ],
)
def test_zeros_and_directions_are_found(seed: int, name: str, backlash_deg: float) -> None:
    arm = UnalignedArm(seed, backlash_deg, name)
    plans = find_arm(name).file.calibration.joints
    found = ByHand(arm.bus, arm.joints, plans, Person(arm, plans)).run()
    allowed_rad = ZERO_WITH_BACKLASH_RAD if backlash_deg else ZERO_RAD
    for joint in arm.joints:
        made = found[joint.name]
        assert made.sign == arm.coupling(joint.name).sign, joint.name
        assert off_rad(arm, joint, made) <= allowed_rad, joint.name
        assert 0 <= made.lower_counts < made.upper_counts <= 4095
        assert travel_warnings(joint, made) == ""
    torque = {joint.servo_id: series_of(joint.model).torque_enable for joint in arm.joints}
    assert not any(servo.memory.get(torque[servo.servo_id]) for servo in arm.line.servos)


@pytest.mark.parametrize("name", ONE_BUS)
@pytest.mark.parametrize("seed", HELD_SEEDS)
def test_every_arm_is_calibrated_however_its_servos_are_mounted(seed: int, name: str) -> None:
    arm = HeldArm(seed, name)
    person = Person(cast(Any, arm), arm.plan.joints)
    found = ByHand(cast(Any, arm.bus), arm.joints, arm.plan.joints, person).run()
    for joint in arm.joints:
        made = found[joint.name]
        assert made.sign == arm.coupling(joint.name).sign, joint.name
        assert off_rad(arm, joint, made) < 0.002 and travel_warnings(joint, made) == "", joint.name
        lowest, highest = as_joint(joint, made).counts_range()
        assert 0 <= lowest < highest <= joint.model.last_count, "the robot file would be refused"
        assert not made.extended or series_of(joint.model) is X
