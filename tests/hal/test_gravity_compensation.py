"""Tests of the offsets of the gravity compensation and of their limits."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.servos.catalog import MODELS
from hal.compensation.gravity import Gravity
from hal.compensation.joint_offset import LARGEST_LOAD
from hal.compensation.limit_cycle import GIVE_WAY_RAD
from hal.robot_description.description import parse_urdf
from hal.servos.gravity_compensation import GravityCompensation
from hal.types import FloatArray, JointLimits
from servoloop.stack.robot_files import read_files
from servoloop.stack.shipped_files import URDF

JOINTS = read_files().robot.joints
GRAVITY = Gravity(parse_urdf(URDF.read_text()), [joint.name for joint in JOINTS])
LOWER = np.array([joint.limits.lower for joint in JOINTS])
UPPER = np.array([joint.limits.upper for joint in JOINTS])
VELOCITY = np.array([joint.limits.velocity for joint in JOINTS])
LEANING = np.array([0.0, -0.5, -0.6, -0.5, -0.5, 0.0, 0.0])
PERIOD_S = 0.05

SOFT = replace(JOINTS[0], limits=JointLimits(-1.0, 1.0, 4.0, 12.0, 120.0))
COMPLIANCE = SOFT.compliance
assert COMPLIANCE is not None
UNCORRECTED = COMPLIANCE.uncorrected


def settled(made: GravityCompensation, command: FloatArray, seconds: float = 3.0) -> FloatArray:
    """Return the offset after the arm has stayed for some time exactly at its command."""
    for _ in range(round(seconds / PERIOD_S)):
        offset = made.offset(command, command, PERIOD_S)
    return offset


def one(position: float) -> FloatArray:
    return np.array([position])


def test_the_offset_equals_the_sag_due_to_gravity() -> None:
    offset = settled(GravityCompensation(JOINTS, GRAVITY), LEANING)
    stiffness = np.array([joint.compliance.stiffness for joint in JOINTS if joint.compliance])
    assert offset == pytest.approx(GRAVITY.torques(LEANING) / stiffness)
    assert 0.03 < offset[1] < 0.08


def test_the_offset_fades_in_after_each_activation() -> None:
    made = GravityCompensation(JOINTS, GRAVITY)
    for _ in range(2):
        offsets = [made.offset(LEANING, LEANING, PERIOD_S) for _ in range(30)]
        assert not offsets[0].any()
        steps = np.diff([offset[1] for offset in offsets])
        assert (steps[:20] > 0.0).all() and steps[:20] == pytest.approx(steps[0])
        assert not steps[21:].any()
        made.restart()


def test_the_offset_fades_out_and_in_when_it_is_disabled_and_enabled() -> None:
    made = GravityCompensation(JOINTS, GRAVITY)
    before = settled(made, LEANING)
    made.enabled = False
    steps = np.diff([before[1], *(made.offset(LEANING, LEANING, PERIOD_S)[1] for _ in range(25))])
    assert np.abs(steps).max() <= 1.01 * abs(before[1]) * PERIOD_S
    assert not settled(made, LEANING).any()
    made.enabled = True
    assert settled(made, LEANING) == pytest.approx(before)


def test_wrong_masses_use_at_most_half_of_full_effort() -> None:
    heavy = Gravity(parse_urdf(URDF.read_text().replace('mass value="', 'mass value="10')), [j.name for j in JOINTS])
    offset = settled(GravityCompensation(JOINTS, heavy), LEANING)
    assert offset[1] == pytest.approx(LARGEST_LOAD * 2.94 / COMPLIANCE.stiffness)


def test_joints_with_unknown_servo_or_disabled_compensation_get_no_offset() -> None:
    unknown = replace(JOINTS[1], model=MODELS["scs15"])
    off = replace(JOINTS[2], gravity_compensation=False)
    made = GravityCompensation((JOINTS[0], unknown, off, *JOINTS[3:]), GRAVITY)
    for _ in range(60):
        offset = made.offset(LEANING, LEANING - 0.01, PERIOD_S)
    assert offset[1] == offset[2] == 0.0 < offset[3]


def spring(made: GravityCompensation, lost: float, seconds: float, wall: float = math.inf) -> tuple[float, float]:
    """Return the error and the offset of a joint that stays ``lost`` behind its goal 0 and stops at ``wall``."""
    measured = 0.0
    for _ in range(round(seconds / PERIOD_S)):
        offset = float(made.offset(one(0.0), one(measured), PERIOD_S)[0])
        measured = min(offset - lost, wall)
    return -measured, offset


def test_the_error_at_rest_is_corrected_down_to_the_dead_band() -> None:
    for lost in (0.012, -0.012):
        error, _ = spring(GravityCompensation([SOFT], None), lost, 6.0)
        assert abs(error) <= COMPLIANCE.dead_band


def test_the_correction_is_limited_to_dead_band_and_friction() -> None:
    error, offset = spring(GravityCompensation([SOFT], None), 1.5 * UNCORRECTED, 60.0)
    assert offset == pytest.approx(UNCORRECTED)
    assert error == pytest.approx(0.5 * UNCORRECTED)


def test_a_joint_that_friction_holds_above_its_goal_is_corrected_until_nothing_carries_it() -> None:
    made, stiffness = GravityCompensation(JOINTS, GRAVITY), np.array([j.compliance.stiffness for j in JOINTS])
    sag = GRAVITY.torques(LEANING) / stiffness
    settled(made, LEANING)
    above = LEANING + np.where(np.arange(7) == 1, 0.9 * sag, 0.0)
    assert 0.9 * sag[1] > 2.0 * UNCORRECTED, "an error of this size in the other direction is not corrected"
    for _ in range(200):
        offset = made.offset(LEANING, above, PERIOD_S)
    assert offset[1] == pytest.approx(0.0, abs=1e-12)
    made.offset(LEANING + 0.001, above, PERIOD_S)
    assert made.offset(LEANING + 0.002, above, PERIOD_S)[1] == pytest.approx(0.0, abs=0.2 * sag[1]), "no jump"
    for cycle in range(100):
        offset = made.offset(LEANING + 1e-4 * cycle, above, PERIOD_S)
    assert offset[1] == pytest.approx(sag[1] - UNCORRECTED, rel=0.05), "a moving joint is carried again"


def test_a_joint_that_hangs_below_its_goal_is_not_lifted_further() -> None:
    made, stiffness = GravityCompensation(JOINTS, GRAVITY), np.array([j.compliance.stiffness for j in JOINTS])
    sag = GRAVITY.torques(LEANING) / stiffness
    settled(made, LEANING)
    below = LEANING - np.where(np.arange(7) == 1, 0.9 * sag, 0.0)
    for _ in range(200):
        offset = made.offset(LEANING, below, PERIOD_S)
    assert offset[1] == pytest.approx(sag[1])


def test_a_blocked_joint_is_not_corrected() -> None:
    assert spring(GravityCompensation([SOFT], None), 0.0, 60.0, wall=-0.1) == (0.1, 0.0)


def test_the_correction_pauses_while_the_command_moves_or_the_servo_is_missing() -> None:
    made = GravityCompensation([SOFT], None)
    _, before = spring(made, 0.012, 3.0)
    for cycle in range(1, 100):
        assert made.offset(one(cycle * 1e-3), one(cycle * 1e-3 - 0.012), PERIOD_S)[0] == pytest.approx(before)
    for _ in range(100):
        assert made.offset(one(0.099), one(math.nan), PERIOD_S)[0] == pytest.approx(before)


def test_a_joint_at_its_limit_gets_no_correction_beyond_it() -> None:
    made = GravityCompensation([SOFT], None)
    for _ in range(100):
        assert made.offset(one(1.0), one(0.99), PERIOD_S)[0] == 0.0
    assert made.offset(one(0.9), one(0.9), PERIOD_S)[0] == 0.0  # no correction has accumulated in this time


shares = st.lists(st.floats(0.0, 1.0), min_size=7, max_size=7).map(np.array)
errors = st.lists(st.one_of(st.just(math.nan), st.floats(-0.1, 0.1)), min_size=7, max_size=7).map(np.array)
cycles = st.lists(st.tuples(st.one_of(st.none(), shares), errors), min_size=1, max_size=60)


@given(shares, cycles, st.sampled_from([0.01, 0.05, 0.2]))
def test_goals_always_stay_within_the_limits(
    start: FloatArray, todo: list[tuple[FloatArray | None, FloatArray]], dt_s: float
) -> None:
    made = GravityCompensation(JOINTS, GRAVITY)
    command = LOWER + start * (UPPER - LOWER)
    known = [(joint.transmission, joint.compliance.uncorrected) for joint in JOINTS if joint.compliance]
    largest = np.array([(0.5 * 2.94 / 15.0 + GIVE_WAY_RAD) * ratio + left for ratio, left in known])
    for number, (target, error) in enumerate(todo):
        if target is not None:  # commands have already passed the safety gate
            wanted = LOWER + target * (UPPER - LOWER)
            command = np.clip(wanted, command - VELOCITY * dt_s, command + VELOCITY * dt_s)
        offset = made.offset(command, command + error, dt_s)
        goal = command + offset
        assert np.isfinite(goal).all()
        assert number or not offset.any()
        assert (goal >= LOWER - 1e-12).all() and (goal <= UPPER + 1e-12).all()
        assert (np.abs(offset) <= largest).all()


def test_a_joint_beyond_its_limit_does_not_jump_back() -> None:
    made = GravityCompensation([SOFT], None)
    assert made.offset(one(1.02), one(1.02), PERIOD_S)[0] == 0.0
