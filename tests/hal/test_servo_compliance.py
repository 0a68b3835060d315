"""Tests of the stiffness and lag of servos against known values."""

import math

import pytest

from drivers.servos.catalog import MODELS
from drivers.servos.sts import STS3215
from hal.compensation.servo_compliance import compliance_of

COUNT_RAD = 2.0 * math.pi / 4096


def test_an_sts3215_at_12_v_has_the_measured_stiffness_and_lag() -> None:
    found = compliance_of(STS3215)
    assert found is not None
    assert found.stiffness == pytest.approx(15.0, rel=0.03)
    assert math.degrees(1.0 / found.stiffness) == pytest.approx(3.6, rel=0.06)
    assert found.lag_s == pytest.approx(0.044, rel=0.1)
    behind_counts = 1304**2 / (2.0 * found.profile_acceleration / COUNT_RAD)
    assert behind_counts == pytest.approx(85, abs=1)
    assert 2.0 * COUNT_RAD < found.uncorrected < 0.02


def test_the_stiffness_of_an_x_servo_follows_from_its_gain() -> None:
    soft, stiff = (compliance_of(MODELS["xl430-w250"], gain) for gain in (800, 2400))
    assert soft is not None and stiff is not None
    assert stiff.stiffness == pytest.approx(3.0 * soft.stiffness)
    assert stiff.stiffness == pytest.approx(2400 / 128 / 885 / COUNT_RAD * 1.5, rel=0.01)
    assert stiff.lag_s == pytest.approx(soft.lag_s / 3.0)
    assert math.isinf(stiff.profile_acceleration)


def test_an_x_servo_has_its_factory_gain_unless_another_gain_is_given() -> None:
    assert compliance_of(MODELS["xm430-w350"]) == compliance_of(MODELS["xm430-w350"], 800)
    assert compliance_of(MODELS["xl430-w250"]) == compliance_of(MODELS["xl430-w250"], 640)
    assert compliance_of(MODELS["xl430-w250"], 0) is None
    assert compliance_of(MODELS["xl430-w250"], settings={"position_i_gain": 100}) is None
    assert compliance_of(MODELS["xl330-m077"], settings={"position_i_gain": 0}) is not None


@pytest.mark.parametrize("name", ["xl330-m077", "xl330-m288"])
def test_an_xl330_has_half_the_drive_per_gain(name: str) -> None:
    model = MODELS[name]
    found = compliance_of(model, 800)
    assert found is not None
    assert found.stiffness == pytest.approx(800 / 256 / 885 / COUNT_RAD * model.stall_torque_nm, rel=0.01)


def test_a_prismatic_joint_has_newtons_and_meters() -> None:
    turning, sliding = compliance_of(STS3215), compliance_of(STS3215, transmission=0.03)
    assert turning is not None and sliding is not None
    force_n, way_m = 1.0, 1.0 / sliding.stiffness
    torque_nm, angle_rad = force_n * 0.03, way_m / 0.03
    assert torque_nm / angle_rad == pytest.approx(turning.stiffness)
    assert sliding.uncorrected == pytest.approx(0.03 * turning.uncorrected)
    assert (sliding.lag_s, sliding.inertia_s2) == (turning.lag_s, turning.inertia_s2)
    assert sliding.profile_acceleration == pytest.approx(0.03 * turning.profile_acceleration)


@pytest.mark.parametrize("name", ["scs15", "ax-12a", "mx-28", "xl320", "xl330-m077"])
def test_an_unknown_loop_or_gain_gives_no_compliance(name: str) -> None:
    assert compliance_of(MODELS[name]) is None


def test_every_known_model_has_plausible_values() -> None:
    known = [found for model in MODELS.values() if (found := compliance_of(model, 800))]
    assert len(known) > 10
    for found in known:
        assert 0.1 < found.stiffness < 100.0
        assert 0.0 < found.lag_s < 0.1
        assert 0.0 < found.uncorrected < 0.1
