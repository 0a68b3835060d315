"""The gear test of a loose servo identifies gears with small, slow motions and then releases the torque."""

from collections.abc import Callable
from dataclasses import replace
from math import sqrt, tau

import pytest

from commissioning.drive_trial import TrialMotion
from commissioning.set_up.turn import WAY_RAD, GearResult, called, judge_gear, rivals, v_s_rad
from commissioning.slow_arm import StoppedError
from drivers.driver_errors import PortLost
from drivers.servos import sts
from drivers.servos.register import ServoModel
from sim_backend.faults import Disturbance
from sim_backend.mechanics.gears import Gears
from tests.commissioning.loose import Cut, Loose, Plant, interrupt

GEARS = (sts.STS3215_C001, sts.STS3215_C044, sts.STS3215_C046)
STARTS = {None: 2048, 0: 3, 1: 4090}
"""Position of the horn, by seed: in the middle of the turn, and on both sides of the encoder seam."""
LEFT_AS_IT_WAS = (0, 1000)


def in_place_of(model: ServoModel, motion: TrialMotion | None) -> GearResult:
    """Judge the motion for a joint that needs another model with the same rated voltage."""
    assert motion is not None
    return judge_gear(replace(motion, joint=replace(motion.joint, model=model)))


@pytest.mark.parametrize("seed", STARTS)
@pytest.mark.parametrize("model", GEARS, ids=lambda model: model.name)
def test_every_gear_is_identified_with_a_small_slow_motion(model: ServoModel, seed: int | None) -> None:
    loose = Loose(model, seed, counts=STARTS[seed])
    start_rad = loose.plant.ends[0]
    motion = loose.turn()
    for place in GEARS:
        gear = in_place_of(place, motion)
        assert gear.verdict == ("fits" if place == model else "other"), (place.name, gear)
        assert place == model or f"probably an {called(model)}" in gear.text
    assert loose.left == LEFT_AS_IT_WAS
    assert 0.2 < loose.plant.fastest < 0.25 * min(one.no_load_speed_rad_s for one in rivals(model))
    assert loose.plant.ends[0] > 0.0 and loose.plant.ends[1] < tau, "over the seam"
    lowest, highest = (end - start_rad for end in loose.plant.ends)
    assert 0.9 * WAY_RAD < highest - lowest < 1.1 * WAY_RAD


@pytest.mark.parametrize(
    ("model", "place", "supply_v", "verdict"),
    [
        (sts.STS3215, sts.STS3215, 12.0, "fits"),
        (sts.STS3215_C044, sts.STS3215, 12.0, "other"),
        (sts.STS3215, sts.STS3215_C046, 7.4, "other"),
    ],
)
def test_gears_of_12_v_servos_are_distinguished_from_7_v_servos(
    model: ServoModel, place: ServoModel, supply_v: float, verdict: str
) -> None:
    loose = Loose(model, 2, supply_v)
    gear = judge_gear(loose.turn(place))
    assert gear.verdict == verdict
    assert verdict == "fits" or f"probably an {called(model)}" in gear.text
    assert loose.left == LEFT_AS_IT_WAS
    assert loose.plant.fastest < 0.25 * min(model.no_load_speed_rad_s, place.no_load_speed_rad_s)


def test_an_ambiguous_gear_is_not_guessed() -> None:
    motion = Loose(sts.STS3215_C044).turn()
    assert motion is not None
    between = 1.02 * sqrt(v_s_rad(sts.STS3215_C044) * v_s_rad(sts.STS3215_C046))
    motion = replace(motion, drive=motion.speed * between / motion.joint.model.rated_voltage_v)
    assert [in_place_of(place, motion).verdict for place in GEARS] == ["other", "not sure", "not sure"]
    either = f"{called(sts.STS3215_C046)} or an {called(sts.STS3215_C044)}"
    assert all(either in in_place_of(place, motion).text for place in GEARS)


@pytest.mark.parametrize("seed", range(2))
def test_lost_packets_do_not_change_the_gear_result(seed: int) -> None:
    loose = Loose(sts.STS3215_C046, seed)
    loose.line.faults.disturbance = Disturbance(seed, drop=0.05, flip=0.02, miss=0.02)
    motion = loose.turn()
    loose.line.faults.disturbance = None
    assert [in_place_of(place, motion).verdict for place in GEARS] == ["other", "other", "fits"]
    assert loose.left == LEFT_AS_IT_WAS


@pytest.mark.parametrize(
    ("hinder", "text"),
    [
        (lambda plant: plant.fit([Gears(0.0154, 0.0, 50.0, 0.0)]), "its horn did not move far enough"),
        (lambda plant: plant.load_nm.__setitem__(0, 0.3), "something pulls at its horn"),
    ],
)
def test_a_blocked_horn_gives_no_gear_result(hinder: Callable[[Plant], None], text: str) -> None:
    loose = Loose(sts.STS3215_C046)
    hinder(loose.plant)
    gear = judge_gear(loose.turn())
    assert (gear.verdict, text in gear.text) == ("not sure", True)
    assert loose.left == LEFT_AS_IT_WAS


def test_the_horn_stays_within_the_servo_limits() -> None:
    loose = Loose(sts.STS3215_C046, counts=1050)
    loose.servo.memory.save(sts.min_position, 900)
    loose.servo.memory.save(sts.max_position, 1100)
    assert loose.turn() is None and loose.plant.fastest == 0.0
    loose.servo.memory.save(sts.min_position, 600)
    assert loose.turn() is not None
    assert loose.plant.ends[0] * 4096 / tau > 600 and loose.plant.ends[1] * 4096 / tau < 1100


def fail() -> None:
    raise RuntimeError("broken")


@pytest.mark.parametrize("at", [*range(5, 50, 3), 80, 150])
def test_an_interrupt_at_any_packet_releases_the_servo(at: int) -> None:
    loose = Loose(sts.STS3215_C046)
    loose.port.before_write = Cut(at, interrupt if at % 2 else fail)
    with pytest.raises((KeyboardInterrupt, RuntimeError)):
        loose.turn()
    loose.clock.sleep_until(loose.clock.now() + 0.1)
    loose.line.advance(loose.clock.now())
    assert loose.left == LEFT_AS_IT_WAS
    assert abs(float(loose.plant.joints.velocity[0])) < 0.01


def test_stopping_releases_the_servo_at_once() -> None:
    loose = Loose(sts.STS3215_C046)
    stopped_s: list[float] = []

    def stopped() -> bool:
        if loose.clock.now() > 12.0:
            stopped_s.append(loose.clock.now())
        return bool(stopped_s)

    with pytest.raises(StoppedError):
        loose.turn(stopped=stopped)
    assert loose.left == LEFT_AS_IT_WAS
    assert loose.clock.now() - stopped_s[0] < 0.1


@pytest.mark.parametrize("at", [12, 30, 80])
def test_a_lost_port_is_reported_with_a_torque_warning(at: int) -> None:
    loose = Loose(sts.STS3215_C046)
    loose.port.before_write = Cut(at, loose.port.unplug)
    with pytest.raises(PortLost) as lost:
        loose.turn()
    assert "the torque of servo 1 may still be on: unplug the servo or switch its supply off" in lost.value.__notes__


def test_a_model_with_a_unique_number_has_no_rivals() -> None:
    assert rivals(sts.STS3250) == ()
    assert rivals(sts.STS3215_C046) == (sts.STS3215, sts.STS3215_C001, sts.STS3215_C044)
