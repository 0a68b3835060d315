"""``tune`` on virtual servos: gains have the known effects, and the predictions match the measurements."""

from collections.abc import Sequence
from dataclasses import replace

import pytest

from commissioning.slow_arm import SPEED_SHARE
from commissioning.tune.predict import Law
from commissioning.tune.report import tune
from commissioning.tune.tuner import Ending, Measurement, Tuner
from drivers.bus.bus import Bus
from drivers.servos import sts, x
from drivers.servos.register import Register
from hal.joint import Joint
from sim_backend.buses.build import Build
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from tests.commissioning.patient import Patient
from tests.commissioning.tuned import TuneBench
from tests.hal.bench import JOINTS

COUNT = abs(JOINTS[0].units_per_count)


def measured(gains: dict[Register, int], joint: str = "shoulder") -> tuple[TuneBench, Measurement]:
    bench = TuneBench(gains)
    return bench, bench.tuner(joint).measure(None)


@pytest.fixture(scope="module")
def factory() -> Measurement:
    return measured({})[1]


@pytest.fixture(scope="module")
def soft() -> Measurement:
    return measured({sts.position_p: 16})[1]


@pytest.fixture(scope="module")
def undamped() -> Measurement:
    return measured({sts.position_d: 0})[1]


def test_half_the_p_sags_twice_as_far(factory: Measurement, soft: Measurement) -> None:
    """The dead zone of one count and the minimum drive of 16 units do not depend on the P gain."""
    assert factory.gains["P"] == 32 and soft.gains["P"] == 16
    assert soft.figures.sag / factory.figures.sag == pytest.approx(2.0, abs=0.15)
    assert factory.figures.sag > 15 * COUNT


def test_without_d_it_overshoots_more_and_sags_the_same(factory: Measurement, undamped: Measurement) -> None:
    assert undamped.figures.overshoot > factory.figures.overshoot + 3.0 * COUNT
    assert undamped.figures.sag == pytest.approx(factory.figures.sag, abs=1.5 * COUNT)
    assert undamped.figures.delay_s == pytest.approx(factory.figures.delay_s, abs=0.005)


def test_half_the_p_increases_the_delay(factory: Measurement, soft: Measurement) -> None:
    assert soft.figures.delay_s > 1.3 * factory.figures.delay_s
    assert soft.figures.following_rms > 1.5 * factory.figures.following_rms


def test_predictions_match_measurements(factory: Measurement, soft: Measurement) -> None:
    """Each of the two measurements is used to predict the other one."""
    for before, after in ((factory, soft), (soft, factory)):
        bench = TuneBench({sts.position_p: before.gains["P"]})
        law = Law(bench.tuner().joint, before.plan, before.figures)
        found = law.predict({"P": after.gains["P"]})
        assert found.sag == pytest.approx(after.figures.sag, abs=2.0 * COUNT)
        assert found.rest_error == pytest.approx(after.figures.rest_error, abs=4.0 * COUNT)
        assert found.delay_s == pytest.approx(after.figures.delay_s, abs=0.010)


def test_the_effect_of_d_is_predicted(factory: Measurement, undamped: Measurement) -> None:
    bench = TuneBench({sts.position_d: 0})
    law = Law(bench.tuner().joint, undamped.plan, undamped.figures)
    assert law.predict({}).overshoot == pytest.approx(undamped.figures.overshoot, abs=0.5 * COUNT)
    assert law.predict({"D": 32}).overshoot == pytest.approx(factory.figures.overshoot, abs=3.0 * COUNT)


def test_the_same_arm_gives_the_same_figures(factory: Measurement) -> None:
    assert measured({})[1].figures == factory.figures


def test_no_joint_is_faster_than_a_quarter_of_its_limit_and_the_others_stay() -> None:
    bench = TuneBench()
    fastest, farthest = [0.0] * 3, [0.0] * 3
    start = bench.positions

    def watch(data: bytes) -> None:
        for at, joint in enumerate(bench.joints):
            if all(bench.torque):
                speed = abs(float(bench.plant.joints.velocity[at])) * joint.transmission
                fastest[at] = max(fastest[at], speed)
                farthest[at] = max(farthest[at], abs(bench.positions[at] - start[at]))

    bench.before = watch
    found = bench.tuner("elbow", Ending(relax=True)).measure(None)
    allowed = SPEED_SHARE * JOINTS[1].limits.velocity
    assert 0.5 * allowed < fastest[1] < 1.4 * allowed  # the servo moves slightly faster than commanded to catch up
    assert farthest[1] == pytest.approx(abs(found.plan.far - found.plan.start), abs=15 * COUNT)
    assert farthest[2] < 1e-3


def test_a_prismatic_joint_is_measured_too() -> None:
    _, found = measured({}, "finger")
    assert 0.0 < found.plan.far < 0.05 and abs(found.plan.step) == pytest.approx(0.15 * 0.03)
    assert 0.0 < found.figures.delay_s < 0.15


def test_only_goals_are_written_by_default() -> None:
    """Even settings that differ from the robot file are not written."""
    bench = TuneBench({sts.position_p: 16}, joints=(replace(JOINTS[0], settings=(("position_p", 32),)), *JOINTS[1:]))
    before = bench.saved
    report = tune(bench.tuner())
    assert bench.saved == before
    assert report.written == () and report.after is None
    assert report.overruled == {"position_p": 32}
    assert report.proposal.values["P"] == 24 and report.predicted is not None


def test_gains_are_written_with_torque_off_and_measured() -> None:
    bench = TuneBench({sts.position_p: 16})
    under_torque: list[bool] = []
    memory = bench.memories[0]

    def watch(data: bytes) -> None:
        if memory.get(sts.lock) == 0:
            under_torque.append(any(bench.torque))

    bench.before = watch
    report = tune(bench.tuner(), write={"P": 32, "D": 32})
    assert [(one.gain, one.old, one.new) for one in report.written] == [("P", 16, 32)]  # D was already 32
    assert under_torque and not any(under_torque)
    assert memory.get(sts.lock) == 1
    bench.line.servo(1).power_cycle()
    assert memory.get(sts.position_p) == 32
    assert report.after is not None and report.predicted is not None
    assert report.before.figures.sag / report.after.figures.sag == pytest.approx(2.0, abs=0.15)
    assert report.predicted.sag == pytest.approx(report.after.figures.sag, abs=2.0 * COUNT)
    assert report.after.plan == report.before.plan
    assert report.to_keep == {"settings": {"position_p": 32}}


@pytest.mark.slow
def test_the_proposal_can_be_applied() -> None:
    report = tune(TuneBench({sts.position_d: 0}).tuner(), apply=True)
    assert {one.gain for one in report.written} == set(report.proposal.values) == {"D"}
    assert report.after is not None
    assert report.after.figures.overshoot < report.before.figures.overshoot - 2.0 * COUNT


def test_unchanged_gains_are_neither_written_nor_measured_again() -> None:
    bench = TuneBench()
    report = tune(bench.tuner(), write={"P": 32})
    assert report.written == () and report.after is None


@pytest.mark.slow
def test_a_joint_with_backlash_shakes_with_the_factory_s_p_and_not_with_half_of_it() -> None:
    """A joint that gravity does not hold at one end of its gap."""
    patient = Patient(build=Build(backlash_deg=1.0))

    def opened(joints: Sequence[Joint]) -> dict[str, Bus]:
        return {"": patient.bus()}

    report = tune(Tuner(patient.robot.joints, "joint1", opened, patient.clock, Ending(relax=True)), write={"P": 16})
    assert report.before.figures.shakes and report.before.figures.settling_s is None
    assert report.before.figures.swing > 8.0 * report.count
    assert report.proposal.values == {"P": 24}
    assert report.after is not None and not report.after.figures.shakes
    assert report.after.figures.settling_s is not None


def test_dynamixel_gains_are_in_ram_and_p_is_in_the_robot_file() -> None:
    joint = replace(JOINTS[0], model=x.XL430_W250, position_p=1000)
    clock, plant = SimulatedClock(), BenchPlant([1], timestep_s=0.002)
    line = VirtualDynamixelBus.of(plant, {1: x.XL430_W250})

    def opened(joints: Sequence[Joint]) -> dict[str, Bus]:
        gains = {one.servo_id: one.position_p for one in joints if one.position_p is not None}
        return {"": Bus(VirtualPort(line, clock), clock, {1: x.XL430_W250}, position_p=gains)}

    tuner = Tuner([joint], "shoulder", opened, clock, Ending(relax=True))
    assert tuner.gains["P"] == 1000, "which the robot file names, and the servo gets with its torque"
    report = tune(tuner, write={"P": 400})
    assert line.servo(1).memory.get(x.position_p_gain) == 400
    assert report.to_keep == {"position_p": 400}
    assert report.after is not None and report.after.figures.delay_s > report.before.figures.delay_s
    assert report.predicted is not None and report.predicted.overshoot is None
    assert report.predicted.delay_s == pytest.approx(report.after.figures.delay_s, rel=0.1)
