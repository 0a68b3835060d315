"""Measurements, speeds and final state of ``servoloop bench arm``, in simulated time."""

import json
from dataclasses import asdict

import pytest

from commissioning.slow_arm import SPEED_SHARE
from drivers.driver_errors import DriverError
from drivers.servos import sts, x
from servoloop.bench.arm import Measured, measure_buses
from servoloop.bench.page import page
from servoloop.stack.processes import Interrupted
from tests.bench_arm.rig import Lying

slow = pytest.mark.slow  # about half a minute of simulated time


@pytest.fixture(scope="module")
def measured() -> tuple[Lying, Measured]:
    lying = Lying()
    return lying, lying.bench()


@slow
def test_all_figures_are_measured(measured: tuple[Lying, Measured]) -> None:
    figures = measured[1].figures
    bus = figures.buses[""]
    assert bus.p50_us == pytest.approx(bus.wire_us, rel=0.2), "the simulated bus needs exactly the time on the wire"
    assert set(bus.faults.values()) == {0}
    assert [one.joint for one in figures.motions] == [joint.name for joint in measured[0].files.robot.joints[:-1]]
    assert figures.loop.rate_hz == 20.0 and figures.loop.cycles > 500 and figures.loop.missed == 0
    assert figures.loop.took is not None and figures.loop.took.p50_ms > 1.0, "reading all states takes time"
    assert figures.machine.processors > 0 and figures.machine.processor and figures.machine.python
    assert figures.ros is None and figures.without_ros
    assert json.loads(json.dumps(asdict(figures)))["loop"]["cycles"] == figures.loop.cycles


@slow
def test_the_following_errors_are_small(measured: tuple[Lying, Measured]) -> None:
    for one in measured[1].figures.motions:
        assert 0.0 <= one.at_rest <= one.largest, one
        assert 0.0 < one.rms_moving <= one.largest < 0.1, one
        assert one.at_rest < 0.02, one


@slow
def test_no_joint_is_faster_than_a_quarter_of_its_limit(measured: tuple[Lying, Measured]) -> None:
    lying, _ = measured
    for joint, fastest in zip(lying.files.robot.joints[:-1], lying.fastest, strict=False):
        assert 0.1 < fastest < 1.1 * SPEED_SHARE * joint.limits.velocity, joint.name


@slow
def test_the_torque_is_off_in_the_initial_pose(measured: tuple[Lying, Measured]) -> None:
    lying, _ = measured
    assert lying.held == 0
    assert lying.lines.world.position() == pytest.approx(lying.lay, abs=0.05)


@slow
def test_the_page_is_complete_and_self_contained(measured: tuple[Lying, Measured]) -> None:
    pytest.importorskip("matplotlib")
    text = page(measured[1])
    for joint in measured[1].figures.motions:
        assert f"<td>{joint.joint}</td>" in text
    assert text.count("<svg") == 4 and "Not measured: the virtual servos" in text
    assert "<script" not in text and "src=" not in text


@slow
def test_after_an_interruption_the_arm_returns_and_its_torque_is_off() -> None:
    lying = Lying()
    with pytest.raises(Interrupted, match="the arm's torque is off"):
        lying.bench(lambda: int(lying.clock.now() > 6.5))
    assert lying.held == 0 and lying.fastest.max() > 0.1, "the arm has moved"
    assert lying.lines.world.position() == pytest.approx(lying.lay, abs=0.05)


@slow
def test_a_silent_servo_ends_the_bench_and_the_others_are_released() -> None:
    lying = Lying()

    def break_one(time_s: float) -> None:
        if time_s > 6.0:
            lying.lines.lines[""].faults.silence(4)

    lying.watch = break_one
    with pytest.raises(DriverError, match="wrist_flex"):
        lying.bench()
    assert [servo.servo_id for servo in lying.servos if servo.memory.get(sts.torque_enable)] == [4]


def test_an_arm_with_torque_enabled_is_refused() -> None:
    lying = Lying()
    for servo in lying.servos:
        servo.memory.put(sts.goal_position, servo.memory.get(sts.present_position))
        servo.memory.put(sts.torque_enable, 1)
    with pytest.raises(
        DriverError, match=r"shoulder_pan .*gripper \(servo 6\) have torque enabled, and the arm may fall"
    ):
        lying.bench()
    assert lying.held == 6


def test_servos_of_two_models_on_one_bus_are_held_and_released() -> None:
    lying = Lying("koch")
    (run,) = measure_buses(lying.files, lying.lines.devices, lying.clock, lying.lines.open, cycles=20).values()
    assert len(run.took_s) == 20 and set(run.figures.faults.values()) == {0}
    assert not any(servo.memory.get(x.torque_enable) for servo in lying.servos)


@slow
def test_all_arms_of_a_robot_are_measured() -> None:
    lying = Lying("bimanual_so101")
    figures = lying.bench().figures
    names = [joint.name for joint in lying.files.robot.joints if not joint.name.endswith("gripper")]
    assert [one.joint for one in figures.motions] == names and len(names) == 10
    assert all(0.0 < one.rms_moving <= one.largest < 0.1 for one in figures.motions)
    assert figures.buses.keys() == {"left", "right"} and figures.loop.missed == 0
    assert lying.held == 0 and lying.lines.world.position() == pytest.approx(lying.lay, abs=0.05)
