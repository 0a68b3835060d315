"""Test the numbers of a cycle: durations of reads, limits of goal speeds, and the joint and sign of each measured
value."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drivers.servos import sts
from hal.joint import Joint
from hal.servos.servo_hardware import ServoHardware
from hal.types import JointCommand, JointLimits
from sim_backend.buses.feetech import VirtualBus, servo_of
from sim_backend.buses.port import VirtualPort
from sim_backend.faults import Disturbance
from sim_backend.line.rig import Rig, Supply
from tests.drivers.fault_lines import IDS, KINDS, Kind, Line
from tests.hal.bench import JOINTS, Bench, WatchedPort, at

HERE = at(0.0, 0.0, JOINTS[2].position(1500))
UNTOLD_PERIOD_S = 0.05
"""Default period of the stack (20 Hz), which applies until the first command."""

every_kind = pytest.mark.parametrize(
    "kind", [kind for kind in KINDS if not kind.with_goals], ids=lambda kind: kind.name
)


def seven_joints(line: Line) -> ServoHardware:
    """Return configured hardware with joints j1 to j7."""
    kind = line.kind
    limits = JointLimits(-5.0, 5.0, 3.0, 5.0, 50.0)
    joints = [Joint(f"j{i}", i, kind.models[i], limits, zero_counts=kind.table.middle) for i in IDS]
    hardware = ServoHardware("arm", joints, lambda: line.bus, line.clock)
    hardware.configure()
    return hardware


def silence(line: Line, servo_ids: tuple[int, ...]) -> None:
    for servo_id in servo_ids:
        line.faults.silence(servo_id)


# Duration of a read


@every_kind
@pytest.mark.parametrize("period_s", [0.004, 0.01, 0.02])
@pytest.mark.parametrize("silent", [IDS, (1,), (3, 5)], ids=str)
def test_a_read_with_silent_servos_leaves_time_for_the_goals(
    kind: Kind, period_s: float, silent: tuple[int, ...]
) -> None:
    line = Line(kind)
    hardware = seven_joints(line)
    hardware.activate()
    silence(line, silent)
    for _ in range(20):
        begin_s = line.clock.now()
        hardware.write(JointCommand(np.zeros(len(IDS)), period_s))
        hardware.read()
        assert line.clock.now() < begin_s + period_s
        line.clock.sleep_until(begin_s + period_s)


@every_kind
def test_the_period_before_the_first_command_is_that_of_20_hz(kind: Kind) -> None:
    line = Line(kind)
    hardware = seven_joints(line)
    line.faults.disturbance = Disturbance(seed=1, drop=0.6)  # the slowest case, because such servos are read again
    for _ in range(20):
        begin_s = line.clock.now()
        hardware.read()
        assert line.clock.now() < begin_s + UNTOLD_PERIOD_S
        line.clock.sleep_until(begin_s + UNTOLD_PERIOD_S)


@every_kind
def test_at_20_hz_all_servos_are_read_although_one_is_silent(kind: Kind) -> None:
    line = Line(kind)
    hardware = seven_joints(line)
    silence(line, (4,))
    for _ in range(20):
        begin_s = line.clock.now()
        assert hardware.read().faults.keys() == {"j4"}
        line.clock.sleep_until(begin_s + UNTOLD_PERIOD_S)


@pytest.mark.parametrize("wait_s", [0.002, 0.01])
def test_a_read_ends_at_the_deadline_of_its_request(wait_s: float) -> None:
    """No servo answers, so the read waits until the deadline."""
    bench = Bench().active()
    for joint in JOINTS:
        bench.servos.faults.silence(joint.servo_id)
    begin_s = bench.clock.now()
    bench.hardware.request(begin_s + wait_s)
    bench.hardware.read()
    assert bench.clock.now() == pytest.approx(begin_s + wait_s, abs=1e-6)


def test_a_read_does_not_repeat_its_request() -> None:
    bench = Bench().active()
    bench.hardware.request()
    asked = len(bench.port.sent)
    bench.hardware.read()
    assert len(bench.port.sent) == asked
    bench.hardware.read()
    assert len(bench.port.sent) == asked + 1


# Goal speeds


def test_the_goal_speed_is_limited_to_the_maximum_of_its_register() -> None:
    """One count/s more would set the sign bit of the register and reverse the direction."""
    fast = replace(JOINTS[0], limits=replace(JOINTS[0].limits, velocity=60.0))
    bench = Bench(joints=(fast, *JOINTS[1:])).active()
    bench.hardware.write(JointCommand(HERE + at(2.0, 0.0, 0.0), 0.02))
    assert abs(bench.held(1, sts.goal_position) - 2048) / 0.02 > 0x7FFF
    assert bench.held(1, sts.goal_velocity) == 0x7FFF


# Values of a state


def test_voltage_and_temperature_belong_to_the_servo_of_the_joint() -> None:
    """Each servo has a different supply voltage and a different temperature."""
    expected = {1: (11.1, 31.0), 2: (11.2, 32.0), 7: (11.7, 37.0)}
    servos: list[Any] = [servo_of(sts.STS3215, servo_id) for servo_id in expected]
    for servo in servos:
        servo.firmware.temperature_c = expected[servo.servo_id][1]
    supplies = [Supply(voltage_v, resistance_ohm=0.0) for voltage_v, _ in expected.values()]
    bench = Bench()
    bench.servos = VirtualBus(Rig(servos, bench.plant, supplies))
    bench.port = WatchedPort(VirtualPort(bench.servos, bench.clock))
    health = bench.configured().hardware.read().health
    for joint in JOINTS:
        voltage_v, temperature_c = expected[joint.servo_id]
        assert health[joint.name].voltage_v == pytest.approx(voltage_v)
        assert health[joint.name].temperature_c == temperature_c


def test_communication_faults_are_counted_for_the_right_joint() -> None:
    bench = Bench().active()
    bench.servos.faults.corrupt_next(2)
    health = bench.wait().health
    assert {name: servo.counters.corrupt for name, servo in health.items()} == {"shoulder": 0, "elbow": 1, "finger": 0}


def test_a_joints_load_has_the_sign_of_its_effort() -> None:
    bench = Bench().active()
    bench.plant.load_nm[:] = [-0.5, 0.5, -0.5]  # torques on the shafts; the servo of the elbow is mirrored
    for _ in range(10):
        state = bench.cycle(HERE)
    for joint, effort in zip(JOINTS, state.effort, strict=True):
        load = state.health[joint.name].load
        assert load > 0.1
        assert load * joint.full_effort == pytest.approx(effort)
