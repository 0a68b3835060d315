"""Proposals for given figures, and predictions for other gains, without motion."""

from collections.abc import Mapping
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from commissioning.tune.figures import JointFigures
from commissioning.tune.gains import with_gains
from commissioning.tune.predict import Law, Loop
from commissioning.tune.propose import FACTORY_P, UNKNOWN, Proposal, propose
from commissioning.tune.report import kept
from commissioning.tune.trial import plan_for
from drivers.servos import scs, sts, x
from hal.joint import Joint
from tests.hal.bench import JOINTS

FACTORY = {"P": 32, "I": 0, "D": 32, "cw_dead_zone": 1, "ccw_dead_zone": 1, "minimum_startup_force": 16}
COUNT = abs(JOINTS[0].units_per_count)
WELL = JointFigures(
    overshoot=3.0 * COUNT,
    settling_s=0.2,
    sag=4.0 * COUNT,
    stick=1.0 * COUNT,
    rest_error=5.0 * COUNT,
    delay_s=0.05,
    following_largest=20.0 * COUNT,
    following_rms=12.0 * COUNT,
    swing=1.0 * COUNT,
    swing_hz=0.0,
    shakes=False,
)
PLAN = plan_for(JOINTS[0], 0.0)


def held(changes: Mapping[str, int]) -> Joint:
    """Return the joint with these settings, as ``as_held`` returns it."""
    return with_gains(JOINTS[0], {**FACTORY, **changes})


def proposed(changes: Mapping[str, int], measured: JointFigures) -> Proposal:
    return propose(held(changes), {**FACTORY, **changes}, PLAN, measured)


def shaking(measured: JointFigures) -> JointFigures:
    return replace(measured, swing=20.0 * COUNT, swing_hz=6.0, shakes=True)


@pytest.mark.parametrize(
    ("changes", "measured", "values", "says"),
    [
        ({}, WELL, {}, "are good"),
        ({}, shaking(WELL), {"P": 24}, "swings by 20 counts at rest (6.0 Hz), because P is too high"),
        ({"I": 5}, shaking(WELL), {"P": 24, "I": 0}, "I 5 integrates the error from friction"),
        ({"P": 8}, shaking(WELL), {}, "for play"),
        (
            {"cw_dead_zone": 6},
            WELL,
            {"cw_dead_zone": 1},
            "with cw_dead_zone 6, errors of up to 6 counts are not corrected",
        ),
        ({}, replace(WELL, sag=24.0 * COUNT, rest_error=25.0 * COUNT), {}, "the gravity compensation of the stack"),
        (
            {"P": 16},
            replace(WELL, rest_error=25.0 * COUNT),
            {"P": 24},
            "error at rest is 25 counts, which is proportional to 1/P",
        ),
        ({"P": 28}, replace(WELL, rest_error=25.0 * COUNT), {"P": FACTORY_P}, "1/P"),
        ({"P": 16}, replace(WELL, rest_error=9.0 * COUNT), {"P": 19}, "1/P"),
        ({"P": 16}, replace(WELL, rest_error=8.0 * COUNT), {}, "are good"),
    ],
)
def test_proposals_and_their_reasons(
    changes: Mapping[str, int], measured: JointFigures, values: Mapping[str, int], says: str
) -> None:
    found = proposed(changes, replace(measured, overshoot=0.0))
    assert found.values == values
    assert any(says in reason for reason in found.reasons), found.reasons
    assert (found.predicted is None) == (not values)


def test_the_smallest_sufficient_d_is_proposed() -> None:
    measured = replace(WELL, overshoot=9.0 * COUNT)
    found = proposed({"D": 0}, measured)
    assert set(found.values) == {"D"} and 0 < found.values["D"] <= 64
    law = Law(held({"D": 0}), PLAN, measured)
    less = law.predict({"D": found.values["D"] - 4}).overshoot
    assert found.predicted is not None and found.predicted.overshoot is not None and less is not None
    assert found.predicted.overshoot <= 0.05 * abs(PLAN.step) < less


def test_servos_with_an_unpublished_loop_get_no_proposal() -> None:
    joint = replace(JOINTS[0], model=scs.SCS15)
    found = propose(joint, {"P": 32, "I": 0, "D": 32}, PLAN, shaking(WELL))
    assert found == Proposal(reasons=(UNKNOWN,))


def test_error_at_rest_and_delay_are_predicted_for_a_dynamixel() -> None:
    joint = replace(JOINTS[0], model=x.XL430_W250, position_p=640)
    measured = replace(WELL, rest_error=20.0 * COUNT)
    found = propose(joint, {"P": 640, "I": 0, "D": 0}, PLAN, measured)
    assert set(found.values) == {"P"} and found.values["P"] == 960
    assert found.predicted is not None and found.predicted.overshoot is None
    assert found.predicted.rest_error == pytest.approx(20.0 * COUNT * 640 / 960)


@given(st.integers(4, 64), st.floats(-60.0, 60.0), st.floats(0.02, 0.1))
def test_predictions_are_consistent_and_more_p_means_less_sag(
    position_p: int, sag_counts: float, delay_s: float
) -> None:
    """The I gain is nonzero, which disables the slow computation of the overshoot."""
    sag = sag_counts * COUNT
    law = Law(held({"P": position_p, "I": 1}), PLAN, replace(WELL, sag=sag, rest_error=abs(sag), delay_s=delay_s))
    same, stiffer = law.predict({}), law.predict({"P": position_p + 1})
    assert same.sag is not None and stiffer.sag is not None
    assert abs(same.sag) == pytest.approx(abs(sag), abs=1e-9)
    assert same.delay_s == pytest.approx(delay_s)
    assert abs(stiffer.sag) <= abs(same.sag) + 1e-12
    assert stiffer.delay_s is not None and stiffer.delay_s <= delay_s
    assert law.predict({"D": 0}).sag == same.sag and law.predict({"D": 0}).delay_s == same.delay_s


def test_twice_the_p_halves_the_error_beyond_the_dead_zone() -> None:
    measured = replace(WELL, sag=41.0 * COUNT)
    found = Law(held({"P": 16}), PLAN, measured).predict({"P": 32})
    assert found.sag == pytest.approx(21.0 * COUNT)
    wide = Law(held({}), PLAN, measured).predict({"cw_dead_zone": 5, "ccw_dead_zone": 5})
    assert wide.sag == pytest.approx(45.0 * COUNT)


def test_inertia_increases_overshoot_and_d_reduces_it() -> None:
    def over(inertia: float, position_d: int) -> float:
        return Loop(32, position_d, 1, 0.016, 2900.0, inertia).overshoot(98.0, 652.0)

    light, heavy = over(7e-6, 0), over(4e-5, 0)
    assert light < 5.0 < heavy
    assert over(4e-5, 32) < over(4e-5, 16) < heavy


def test_the_robot_file_entries_keep_the_gains() -> None:
    assert kept(sts.STS3215, {"P": 24, "D": 16}, {"max_torque": 800, "position_p": 32}) == {
        "settings": {"max_torque": 800, "position_p": 24, "position_d": 16}
    }
    assert kept(x.XL430_W250, {"P": 700, "D": 5}, {}) == {"position_p": 700, "settings": {"position_d_gain": 5}}
    assert kept(x.XL430_W250, {"P": 700}, {}) == {"position_p": 700}
