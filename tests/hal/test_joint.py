"""Tests of the conversion between counts and joint positions."""

import math
from dataclasses import replace

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from drivers.servos.sts import STS3215
from hal.joint import Joint
from hal.types import JointLimits

TURN = 2.0 * math.pi


def limits(lower: float, upper: float) -> JointLimits:
    return JointLimits(lower, upper, velocity=4.0, acceleration=10.0, jerk=100.0)


ELBOW = Joint("elbow", 1, STS3215, limits(-2.0, 2.0))
MIRRORED = replace(ELBOW, sign=-1)
HAND = Joint("hand", 7, STS3215, limits(0.0, 0.05), zero_counts=1024, transmission=0.03)


@st.composite
def joints(draw: st.DrawFn) -> Joint:
    transmission = draw(st.sampled_from((1.0, 0.03, 0.5)))
    lower = draw(st.floats(-3.0, 2.0)) * transmission
    span = draw(st.floats(0.01, 3.0)) * transmission
    return Joint(
        "any",
        1,
        STS3215,
        limits(lower, lower + span),
        sign=draw(st.sampled_from((1, -1))),
        zero_counts=draw(st.integers(0, 4095)),
        transmission=transmission,
    )


@pytest.mark.parametrize(
    ("joint", "counts", "position"),
    [
        (ELBOW, 2048, 0.0),
        (ELBOW, 3072, TURN / 4),
        (ELBOW, 1024, -TURN / 4),
        (MIRRORED, 3072, -TURN / 4),
        (MIRRORED, 1024, TURN / 4),
        (HAND, 1024, 0.0),
        (HAND, 2048, 0.03 * TURN / 4),
        (replace(HAND, sign=-1), 512, 0.03 * TURN / 8),
    ],
)
def test_known_positions(joint: Joint, counts: int, position: float) -> None:
    assert joint.position(counts) == pytest.approx(position)
    if joint.limits.lower <= position <= joint.limits.upper:
        assert joint.counts(position) == counts


@pytest.mark.parametrize(
    ("joint", "position", "counts"),
    [
        (ELBOW, 2.0, 2048 + 1303),  # 1303.8 counts: rounding up would leave the limits
        (ELBOW, -2.0, 2048 - 1303),
        (MIRRORED, 2.0, 2048 - 1303),
        (MIRRORED, -2.0, 2048 + 1303),
        (HAND, 0.0, 1024),
        (HAND, 0.05, 1024 + 1086),
        (HAND, -0.001, 1024),
        (HAND, 1.0, 1024 + 1086),
    ],
)
def test_the_ends_of_the_range(joint: Joint, position: float, counts: int) -> None:
    assert joint.counts(position) == counts


@pytest.mark.parametrize("joint", [ELBOW, MIRRORED, HAND])
@pytest.mark.parametrize("wanted", [math.inf, -math.inf, 1e308, -1e308, 1e300, 7.0, -7.0])
def test_commands_beyond_a_limit_end_at_the_limit(joint: Joint, wanted: float) -> None:
    lowest, highest = joint.counts_range()
    towards_highest = (wanted > 0) == (joint.sign > 0)
    assert joint.counts(wanted) == (highest if towards_highest else lowest)


def test_nan_is_not_a_position() -> None:
    with pytest.raises(ValueError):
        ELBOW.counts(math.nan)


def test_a_limit_that_is_a_whole_number_of_counts_is_reached() -> None:
    for whole in range(1, 2048):
        end = whole * TURN / 4096
        assert replace(ELBOW, limits=limits(-end, end)).counts_range() == (2048 - whole, 2048 + whole)


@given(joints(), st.floats(allow_nan=False))
def test_no_command_leaves_the_limits(joint: Joint, wanted: float) -> None:
    count = abs(joint.units_per_count)
    position = joint.position(joint.counts(wanted))
    assert joint.limits.lower - 1e-6 * count <= position <= joint.limits.upper + 1e-6 * count


@given(joints(), st.data())
def test_converting_counts_back_is_exact(joint: Joint, data: st.DataObject) -> None:
    lowest, highest = joint.counts_range()
    assume(lowest <= highest)
    counts = data.draw(st.integers(lowest, highest))
    assert joint.counts(joint.position(counts)) == counts


@given(joints(), st.floats(0.0, 1.0))
def test_converting_positions_back_is_exact_to_half_a_count(joint: Joint, share: float) -> None:
    lower, upper = joint.limits.lower, joint.limits.upper
    wanted = lower + share * (upper - lower)
    count = abs(joint.units_per_count)
    counts = joint.counts(wanted)
    # At the ends of the range, the nearest count may be outside the limits; in this case, the next count is used.
    off = 1.0 if counts in joint.counts_range() else 0.5
    assert abs(joint.position(counts) - wanted) <= off * count * (1.0 + 1e-6)


@given(joints(), st.floats(-10.0, 10.0), st.floats(-10.0, 10.0))
def test_the_sign_is_the_direction_of_the_counts(joint: Joint, a: float, b: float) -> None:
    low, high = sorted((a, b))
    assert joint.counts(low) * joint.sign <= joint.counts(high) * joint.sign


def test_effort_at_full_drive() -> None:
    assert ELBOW.full_effort == pytest.approx(2.94)
    assert HAND.full_effort == pytest.approx(98.0)


def test_the_limits_between_its_stops_cover_the_travel_of_a_joint() -> None:
    calibrated = replace(ELBOW, stops=(-2.5, 2.25))
    assert ELBOW.between_stops() is ELBOW
    assert calibrated.between_stops() == replace(calibrated, limits=limits(-2.5, 2.25))


@pytest.mark.parametrize(("counts", "turns"), [(-1, -1), (0, 0), (4095, 0), (4096, 1), (-4097, -2)])
def test_a_reading_contains_whole_turns(counts: int, turns: int) -> None:
    assert ELBOW.turns(counts) == turns
