"""Tests that the output of the safety gate is finite, within the limits and close to the last command."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.gate import RETURN_SHARE, Gated, SafetyGate, clipped
from hal.types import FloatArray, JointLimits

PERIOD_S = 0.05
LIMITS = (
    JointLimits(-2.0, 2.0, 4.0, 10.0, 100.0),
    JointLimits(0.5, 1.5, 1.0, 10.0, 100.0),
    JointLimits(0.0, 0.05, 0.2, 1.0, 20.0),
)
LOWER = np.array([limit.lower for limit in LIMITS])
UPPER = np.array([limit.upper for limit in LIMITS])
REACH = np.array([limit.velocity for limit in LIMITS]) * PERIOD_S
MIDDLE = (LOWER + UPPER) / 2.0
ROUNDING = 1e-12

anything = st.floats() | st.sampled_from((math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, -0.0))
commands = st.tuples(anything, anything, anything).map(np.array)
inside = st.tuples(*(st.floats(limit.lower, limit.upper) for limit in LIMITS)).map(np.array)
shares = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)


def gate() -> SafetyGate:
    """Create a new gate for each test, because its construction is tested too."""
    return SafetyGate(LIMITS)


def gated(wanted: list[float], last: FloatArray = MIDDLE) -> Gated:
    return gate().limit(np.array(wanted), last, PERIOD_S)


@given(commands, inside)
def test_the_output_is_finite_within_the_limits_and_reachable(wanted: FloatArray, last: FloatArray) -> None:
    out = gate().limit(wanted, last, PERIOD_S).values
    assert np.isfinite(out).all()
    assert (out >= LOWER).all() and (out <= UPPER).all()
    assert (np.abs(out - last) <= REACH + ROUNDING).all()


@given(commands, inside, st.sampled_from((0.001, 0.01, 0.02, 0.1, 1.0)))
def test_the_reach_follows_the_period(wanted: FloatArray, last: FloatArray, period_s: float) -> None:
    out = gate().limit(wanted, last, period_s).values
    assert (np.abs(out - last) <= REACH / PERIOD_S * period_s + ROUNDING).all()


@given(shares)
def test_a_command_slightly_beyond_a_limit_becomes_the_limit(share: FloatArray) -> None:
    at_end = np.where(share < 0.0, LOWER, UPPER)
    out = gate().limit(at_end + 0.9 * share * REACH, at_end, PERIOD_S).values
    np.testing.assert_allclose(out, at_end, rtol=0.0, atol=ROUNDING)


@given(commands)
def test_values_are_clipped_as_by_numpy(values: FloatArray) -> None:
    np.testing.assert_array_equal(clipped(values, LOWER, UPPER), np.clip(values, LOWER, UPPER))


@given(inside, shares)
def test_a_valid_command_passes_unchanged_and_without_reasons(last: FloatArray, share: FloatArray) -> None:
    wanted = np.clip(last + share * REACH, LOWER, UPPER)
    out = gate().limit(wanted, last, PERIOD_S)
    np.testing.assert_allclose(out.values, wanted, rtol=0.0, atol=ROUNDING)
    assert out.reasons == {}


@given(commands, inside)
def test_the_reasons_name_exactly_the_joints_that_were_changed(wanted: FloatArray, last: FloatArray) -> None:
    out = gate().limit(wanted, last, PERIOD_S)
    changed = {i for i in range(3) if not abs(out.values[i] - wanted[i]) <= 1e-9}
    assert out.reasons.keys() == changed


@given(commands, inside)
def test_one_joint_does_not_move_another(wanted: FloatArray, last: FloatArray) -> None:
    alone = np.where([True, False, False], wanted, last)
    assert gate().limit(alone, last, PERIOD_S).values[0] == gate().limit(wanted, last, PERIOD_S).values[0]


@given(st.lists(commands, max_size=20), inside)
def test_no_sequence_of_commands_outruns_the_velocity(sequence: list[FloatArray], start: FloatArray) -> None:
    last = start
    for wanted in sequence:
        last = gate().limit(wanted, last, PERIOD_S).values
    assert (np.abs(last - start) <= len(sequence) * REACH + ROUNDING * (1 + len(sequence))).all()


@pytest.mark.parametrize("nothing", [math.nan, math.inf, -math.inf])
def test_a_position_that_is_not_finite_means_hold(nothing: float) -> None:
    out = gated([nothing, MIDDLE[1], nothing])
    np.testing.assert_array_equal(out.values, MIDDLE)
    assert out.reasons == {0: f"the command is {nothing}: holding", 2: f"the command is {nothing}: holding"}


@pytest.mark.parametrize(
    ("wanted", "reason"),
    [
        (2.5, "command 2.5000 is outside the limits -2.0000 to 2.0000"),
        (-7.0, "command -7.0000 is outside the limits -2.0000 to 2.0000"),
        (1.0, "command 1.0000 is too far for one cycle: limited to 0.2000"),
        (-1.0, "command -1.0000 is too far for one cycle: limited to -0.2000"),
    ],
)
def test_a_reason_contains_the_command_and_the_limit(wanted: float, reason: str) -> None:
    assert gated([wanted, MIDDLE[1], MIDDLE[2]]).reasons == {0: reason}


def test_inputs_are_not_modified_and_the_output_is_a_copy() -> None:
    wanted, last = np.array([math.nan, 9.0, 0.0]), MIDDLE.copy()
    out = gate().limit(wanted, last, PERIOD_S).values
    out[:] = 77.0
    np.testing.assert_array_equal(wanted, [math.nan, 9.0, 0.0])
    np.testing.assert_array_equal(last, MIDDLE)


@given(commands, st.tuples(*[st.sampled_from((-1.0, 1.0))] * 3), st.floats(0.0, 5.0))
def test_a_joint_slightly_outside_its_limits_returns_slowly(
    wanted: FloatArray, side: tuple[float, ...], reaches: float
) -> None:
    """Backlash may cause a joint to be outside its limits. No command moves such a joint further out, and it returns
    slowly."""
    ends = np.where(np.array(side) > 0.0, UPPER, LOWER)
    last = ends + np.array(side) * REACH * reaches
    out = gate().limit(wanted, last, PERIOD_S).values
    outside_before = np.maximum(LOWER - last, last - UPPER)
    outside_after = np.maximum(LOWER - out, out - UPPER)
    reach = np.where(outside_before > 0.0, RETURN_SHARE * REACH, REACH)
    assert (np.abs(out - last) <= reach + ROUNDING).all()
    assert (outside_after <= np.maximum(0.0, outside_before - reach) + ROUNDING).all()


def test_a_slow_return_is_reported_with_position_and_limits() -> None:
    last = MIDDLE.copy()
    last[0] = UPPER[0] + 0.01
    found = gate().limit(MIDDLE, last, PERIOD_S)
    assert found.values[0] == pytest.approx(last[0] - RETURN_SHARE * REACH[0])
    limits = f"{LOWER[0]:.4f} to {UPPER[0]:.4f}"
    assert found.reasons == {0: f"position {last[0]:.4f} is outside the limits {limits}: returning slowly"}


def test_an_unknown_last_command_is_reported() -> None:
    """The gate cannot make such a command safe, but it must report the command."""
    last = MIDDLE.copy()
    last[1] = math.nan
    assert 1 in gate().limit(MIDDLE, last, PERIOD_S).reasons


def mixed() -> SafetyGate:
    """Create a gate for a position, a velocity and an effort."""
    return SafetyGate([JointLimits(-2.0, 2.0, 4.0, 10.0, 100.0, 3.0)] * 3, ["position", "velocity", "effort"])


@given(st.lists(commands, max_size=20))
def test_velocities_and_efforts_are_limited(
    sequence: list[FloatArray],
) -> None:
    last = np.zeros(3)
    for wanted in sequence:
        now = mixed().limit(wanted, last, PERIOD_S).values
        assert np.isfinite(now).all()
        assert (np.abs(now) <= [2.0, 4.0, 3.0]).all()
        assert (np.abs(now - last)[:2] <= np.array([4.0, 10.0]) * PERIOD_S + ROUNDING).all()
        last = now


@pytest.mark.parametrize("nothing", [math.nan, math.inf, -math.inf])
def test_a_velocity_or_effort_that_is_not_finite_means_zero(nothing: float) -> None:
    out = mixed().limit(np.full(3, nothing), np.array([1.0, 0.2, 2.0]), PERIOD_S)
    np.testing.assert_array_equal(out.values, [1.0, 0.0, 0.0])
    assert out.reasons[1] == f"the command is {nothing}: stopping"


@given(
    st.lists(st.floats(-9.0, 9.0), min_size=1, max_size=150),
    st.floats(-1.9, 1.9),
    st.sampled_from((0.5, 10.0, math.inf)),
)
def test_a_velocity_never_drives_a_joint_out_of_its_range(
    wanted: list[float], start: float, acceleration: float
) -> None:
    gate = SafetyGate([JointLimits(-2.0, 2.0, 4.0, acceleration, 100.0)], ["velocity"])
    position, last = np.array([start]), np.zeros(1)
    for value in wanted:
        last = gate.limit(np.array([value]), last, PERIOD_S, position).values
        position = position + last * PERIOD_S
        assert abs(position[0]) <= 2.0 + 1e-9


def test_at_the_end_of_its_range_a_joint_may_only_move_back() -> None:
    gate = SafetyGate([JointLimits(-2.0, 2.0, 4.0, 10.0, 100.0)] * 2, ["velocity"] * 2)
    out = gate.limit(np.array([0.4, -0.4]), np.zeros(2), PERIOD_S, np.array([2.0, 2.0]))
    np.testing.assert_allclose(out.values, [0.0, -0.4])
    assert out.reasons == {0: "command 0.4000 is too fast this close to the end of the range: limited to 0.0000"}


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("room", [0.001, 0.05, 0.4])
@pytest.mark.parametrize("acceleration", [0.5, 10.0])
@pytest.mark.parametrize("period_s", [0.01, 0.1])
def test_near_the_end_the_velocity_allows_one_period_and_braking(
    side: float, room: float, acceleration: float, period_s: float
) -> None:
    """The velocity is as high as allowed: v * T + v² / (2 a) equals the remaining range."""
    gate = SafetyGate([JointLimits(-2.0, 2.0, 90.0, acceleration, 100.0)], ["velocity"])
    braked = acceleration * (math.sqrt(period_s**2 + 2.0 * room / acceleration) - period_s)
    assert braked * period_s + braked**2 / (2.0 * acceleration) == pytest.approx(room)
    measured, last = np.array([side * (2.0 - room)]), np.array([side * braked])
    out = gate.limit(np.array([side * 90.0]), last, period_s, measured)
    np.testing.assert_allclose(out.values, last, rtol=1e-6)
    assert "is too fast this close to the end" in out.reasons[0]  # although it is within the velocity limit of 90


def test_a_command_changed_to_its_opposite_is_reported() -> None:
    gate = SafetyGate([JointLimits(-2.0, 2.0, 4.0, 10.0, 100.0)])
    out = gate.limit(np.array([-0.1]), np.array([0.3]), PERIOD_S)
    np.testing.assert_allclose(out.values, [0.1])
    assert out.reasons == {0: "command -0.1000 is too far for one cycle: limited to 0.1000"}


def test_each_limit_needs_a_kind() -> None:
    with pytest.raises(ValueError):
        SafetyGate(LIMITS, ["position"])


def test_joints_without_position_or_without_limits_are_not_slowed() -> None:
    endless = JointLimits(-math.inf, math.inf, 4.0, 10.0, 100.0)
    gate = SafetyGate([endless, JointLimits(-2.0, 2.0, 4.0, 10.0, 100.0)], ["velocity"] * 2)
    out = gate.limit(np.array([0.4, 0.4]), np.zeros(2), PERIOD_S, np.array([1e6, math.nan]))
    np.testing.assert_allclose(out.values, [0.4, 0.4])


def test_without_an_effort_limit_any_effort_passes() -> None:
    gate = SafetyGate([JointLimits(-2.0, 2.0, 4.0, 10.0, 100.0)], ["effort"])
    assert gate.limit(np.array([1e6]), np.zeros(1), PERIOD_S).values[0] == 1e6


def test_a_robot_without_joints() -> None:
    assert SafetyGate(()).limit(np.array([]), np.array([]), PERIOD_S).reasons == {}
