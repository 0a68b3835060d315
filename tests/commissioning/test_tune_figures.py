"""The figures of known curves, the plan of the motions, and the parsing of gains."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from commissioning.tune.figures import SHAKES_COUNTS, TuneTrace, figures, following, response, rest_error
from commissioning.tune.gains import TuneError, gains_of, parse_gains, with_gains
from commissioning.tune.trial import LIFT_RAD, STEP_RAD, TrialPlan, plan_for, plan_question
from drivers.servos import ax_mx, scs, sts, x
from drivers.servos.register import ServoModel
from hal.joint import Joint
from hal.types import FloatArray
from tests.hal.bench import JOINTS

COUNT = 2.0 * math.pi / 4096
PERIOD_S = 0.02
SHOULDER, _, FINGER = JOINTS


def times(seconds: float) -> FloatArray:
    return np.arange(round(seconds / PERIOD_S) + 1) * PERIOD_S


def step(over: float, off: float, decay_s: float = 0.05, swing: float = 0.0, way: float = 0.15) -> TuneTrace:
    """Return a ramp of 0.2 s with a decaying overshoot and an error of ``off`` at rest."""
    time_s = times(1.7)
    command = np.clip(way * time_s / 0.2, min(way, 0.0), max(way, 0.0))
    since = np.maximum(time_s - 0.2, 0.0)
    bump = over * (since / decay_s) * np.exp(1.0 - since / decay_s) * math.copysign(1.0, way)
    return TuneTrace(time_s, command, command - off + bump + 0.5 * swing * np.sign(np.sin(2.0 * np.pi * 5.0 * time_s)))


def sine(delay_s: float, off: float, hz: float, periods: int = 2) -> TuneTrace:
    time_s = times(periods / hz)

    def wave(at_s: FloatArray) -> FloatArray:
        return 0.075 * (1.0 - np.cos(2.0 * np.pi * hz * at_s))

    return TuneTrace(time_s, wave(time_s), wave(time_s - delay_s) - off)


@given(st.floats(0.0, 0.2), st.floats(-0.1, 0.1), st.floats(0.3, 1.0))
def test_the_delay_of_a_sine_does_not_depend_on_sag(delay_s: float, off: float, hz: float) -> None:
    found = following(sine(delay_s, off, hz), hz)
    assert found.delay_s == pytest.approx(delay_s, abs=1e-3)
    assert found.gain == pytest.approx(1.0, abs=1e-3)
    assert found.largest >= found.rms - 1e-9 >= -1e-9


@given(st.floats(0.0, 0.05), st.floats(-0.1, 0.1), st.sampled_from([0.15, -0.15]))
def test_overshoot_is_relative_to_the_position_at_rest(over: float, off: float, way: float) -> None:
    found = response(step(over, off, way=way), COUNT)
    assert found.overshoot == pytest.approx(over, abs=0.03 * over + 1e-6)
    assert found.rest_error == pytest.approx(off, abs=1e-4)


def test_settling_ends_with_the_last_sample_outside_the_band() -> None:
    """The curve t / d * exp(1 - t / d) of 20 mm falls below 0.003 (2 % of the step) at 4.15 d."""
    found = response(step(0.02, 0.0, decay_s=0.05), COUNT)
    assert found.settling_s == pytest.approx(0.22, abs=PERIOD_S)
    assert response(step(0.0, 0.0), COUNT).settling_s == 0.0
    assert response(step(0.02, 0.0, decay_s=0.5), COUNT).settling_s is None


def test_load_and_friction_are_separated_by_approaching_from_both_sides() -> None:
    up, down = step(0.0, 0.03), step(0.0, 0.01, way=-0.15)
    found = figures([up, down], sine(0.03, 0.02, 1.0), 1.0, COUNT, (rest_error(up), rest_error(down)))
    assert (found.sag, found.stick) == (pytest.approx(0.02, abs=1e-6), pytest.approx(0.01, abs=1e-6))
    assert found.rest_error == pytest.approx(0.03, abs=1e-6)
    assert not found.shakes


@pytest.mark.parametrize(("counts", "shakes"), [(SHAKES_COUNTS - 1.0, False), (SHAKES_COUNTS + 1.0, True)])
def test_a_joint_that_swings_at_rest_shakes(counts: float, shakes: bool) -> None:
    steps = [step(0.0, 0.0, swing=counts * COUNT), step(0.0, 0.0, way=-0.15)]
    found = figures(steps, sine(0.0, 0.0, 1.0), 1.0, COUNT, (0.0, 0.0))
    assert found.shakes is shakes
    assert found.swing == pytest.approx(counts * COUNT)
    assert found.swing_hz == pytest.approx(5.0, abs=1.0)


@given(st.sampled_from(JOINTS), st.floats(0.0, 1.0), st.none() | st.floats(0.0, 1.0))
def test_a_plan_stays_within_the_limits_and_a_quarter_of_the_speed(
    joint: Joint, share: float, at_share: float | None
) -> None:
    limits = joint.limits
    span, unit = limits.upper - limits.lower, joint.transmission
    at = None if at_share is None else limits.lower + at_share * span
    plan = plan_for(joint, limits.lower + share * span, at)
    assert limits.lower - 1e-12 <= min(plan.near, plan.far) and max(plan.near, plan.far) <= limits.upper + 1e-12
    assert abs(plan.near - plan.start) <= LIFT_RAD * unit + 1e-12 or at is not None
    assert abs(plan.step) <= STEP_RAD * unit + 1e-12
    assert plan.speed <= 0.25 * limits.velocity
    assert math.pi * plan.sine_hz * abs(plan.step) <= plan.speed
    assert 0.5 * abs(plan.step) * (2.0 * math.pi * plan.sine_hz) ** 2 <= limits.acceleration


def test_the_step_shrinks_with_the_room_and_no_room_is_refused() -> None:
    narrow = replace(SHOULDER, limits=replace(SHOULDER.limits, lower=-0.15, upper=0.15))
    assert abs(plan_for(narrow, 0.0).step) == pytest.approx(0.06)
    with pytest.raises(TuneError, match="shoulder does not have enough room"):
        plan_for(replace(SHOULDER, limits=replace(SHOULDER.limits, lower=-0.05, upper=0.05)), 0.0)
    with pytest.raises(TuneError, match=r"cannot move to 3\.000: its limits are -2\.000 to 2\.000"):
        plan_for(SHOULDER, 0.0, 3.0)


def test_the_question_states_distance_and_speed() -> None:
    text = plan_question(SHOULDER, plan_for(SHOULDER, 0.0), ["elbow"], "It holds.")
    assert "from 0.000 to 0.350 rad" in text and "0.350 and 0.500 rad (98 counts)" in text
    assert "at most 1 rad/s (its limit is 4)" in text and "elbow will hold" in text
    assert " m/s" in plan_question(FINGER, plan_for(FINGER, 0.02), [], "It holds.")


def test_gains_have_their_usual_names() -> None:
    assert {name: one.address for name, one in gains_of(sts.STS3215).items()} == {
        **{"P": 21, "I": 23, "D": 22},
        **{"cw_dead_zone": 26, "ccw_dead_zone": 27, "minimum_startup_force": 24},
    }
    assert gains_of(x.XL430_W250)["P"] is x.position_p_gain
    assert gains_of(ax_mx.AX_12A) == {} and set(gains_of(ax_mx.MX_28)) == {"P", "I", "D"}
    assert parse_gains(sts.STS3215, ["P=24", "d=32"]) == {"P": 24, "D": 32}
    assert parse_gains(sts.STS3215, ["p=24,dead_zone=2"]) == {"P": 24, "cw_dead_zone": 2, "ccw_dead_zone": 2}


@pytest.mark.parametrize(
    ("model", "words", "says"),
    [
        (sts.STS3215, ["P=0"], "P must be 1 to 254, not 0"),
        (sts.STS3215, ["P=256", "D=300"], "P must be 1 to 254, not 256; D must be 0 to 254, not 300"),
        (sts.STS3215, ["Q=1"], "'Q=1' is not a gain: write one of P, I, D, cw_dead_zone, ccw_dead_zone"),
        (sts.STS3215, ["P"], "'P' is not a gain: write one of"),
        (sts.STS3215, [""], "'' is not a gain: write one of"),
        (ax_mx.AX_12A, ["P=1"], "ax-12a has no adjustable gains"),
        (scs.SCS15, ["homing_offset=1"], "is not a gain: write one of P, I, D"),
    ],
)
def test_invalid_gains_are_named(model: ServoModel, words: list[str], says: str) -> None:
    with pytest.raises(TuneError) as caught:
        parse_gains(model, words)
    assert says in str(caught.value)


def test_stiffness_follows_the_gains() -> None:
    soft, stiff = with_gains(SHOULDER, {"P": 16}).compliance, SHOULDER.compliance
    assert soft is not None and stiff is not None and soft.stiffness == pytest.approx(0.5 * stiff.stiffness)
    joint = replace(SHOULDER, model=x.XL430_W250)
    assert with_gains(joint, {"P": 700, "D": 10}).position_p == 700


def test_the_plan_contains_its_step() -> None:
    assert TrialPlan("one", 0.0, 0.2, 0.05, 1.0, 1.0).step == pytest.approx(-0.15)
