"""Servos that answer reads and writes but no group instructions are read and written one by one."""

import logging
import re

import pytest

from drivers.driver_errors import ServoRefused
from drivers.servos import x
from drivers.types import ServoFault, ServoGoal, ServoState
from hal.joint import Joint
from hal.servos.servo_hardware import ServoHardware
from hal.types import JointLimits
from sim_backend.faults import Disturbance
from tests.drivers.plain_slaves import GROUP_READS, GROUP_WRITES, PlainLine

IDS = (1, 2, 3)
MODELS = dict.fromkeys(IDS, x.XL430_W250)
BUDGET_S = 0.02


def ready(line: PlainLine) -> PlainLine:
    for servo_id, model in MODELS.items():
        line.bus.identify(servo_id, model)
    line.bus.read_states(IDS)
    return line


@pytest.mark.parametrize("plain", [(2,), (1, 3), IDS])
def test_every_servo_is_read_in_every_cycle(plain: tuple[int, ...]) -> None:
    line = ready(PlainLine(MODELS, plain))
    for _ in range(20):
        readings = line.bus.read_states(IDS, line.clock.now() + BUDGET_S)
        assert [i for i, reading in readings.items() if not isinstance(reading, ServoState)] == []
        line.clock.sleep_until(line.clock.now() + 0.03)
    assert sum(line.bus.counters.of(i).silent for i in IDS if i not in plain) == 0
    assert line.bus.read_together is False
    assert line.bus.torque_states(IDS, line.clock.now() + BUDGET_S) == dict.fromkeys(IDS, False)


@pytest.mark.parametrize("ignored", [GROUP_READS, GROUP_READS | GROUP_WRITES])
def test_goals_arrive_with_an_acknowledgment(ignored: frozenset[int]) -> None:
    line = ready(PlainLine(MODELS, (2,), ignored))
    for servo_id in IDS:
        line.bus.torque_on(servo_id)
    goals = {i: ServoGoal(700 + 100 * i, 900) for i in IDS}
    assert line.bus.exchange_size(goals, IDS) > 0
    for _ in range(60):
        line.bus.read_states(IDS, line.clock.now() + BUDGET_S)
        line.bus.write_goals(goals)
        line.clock.sleep_until(line.clock.now() + 0.03)
    readings = line.bus.read_states(IDS, line.clock.now() + BUDGET_S)
    for servo_id, reading in readings.items():
        assert isinstance(reading, ServoState)
        assert reading.position_counts == pytest.approx(goals[servo_id].position_counts, abs=20)


def test_a_lost_acknowledgment_is_counted_and_the_next_cycle_works() -> None:
    line = ready(PlainLine(MODELS, (2,)))
    line.servos.faults.silence(2)
    line.bus.write_goals({2: ServoGoal(900)})
    assert line.bus.counters.of(2).retries >= 1
    line.servos.faults.restore(2)
    line.clock.sleep_until(line.clock.now() + 0.1)
    line.bus.write_goals({2: ServoGoal(901)})
    assert line.servos.servo(2).memory.get(x.goal_position) == 901
    assert isinstance(line.bus.read_states(IDS, line.clock.now() + BUDGET_S)[2], ServoState)


@pytest.mark.parametrize(("plain", "subject"), [((2,), "servo 2 does"), (IDS, "servos 1, 2, 3 do")])
def test_a_warning_names_the_servos_and_the_highest_rate(
    plain: tuple[int, ...], subject: str, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING, "servoloop.drivers"):
        line = ready(PlainLine(MODELS, plain))
        line.bus.read_states(IDS)
    (said,) = [message for message in caplog.messages if "single requests" in message]
    pattern = rf"{subject} not support group reads and writes, .* of 3 servos takes ([\d.]+) ms .* to (\d+) Hz"
    found = re.search(pattern, said)
    assert found is not None, said
    cycle_s, rate_hz = float(found[1]) * 1e-3, int(found[2])
    assert rate_hz == pytest.approx(1.0 / cycle_s, rel=0.05)
    begin_s = line.clock.now()
    for _ in range(10):
        line.bus.read_states(IDS, line.clock.now() + 0.1)
        line.bus.write_goals({i: ServoGoal(1000) for i in IDS})
    assert line.clock.now() - begin_s < 10.0 * cycle_s * 1.5


def test_a_silent_servo_is_not_separate() -> None:
    line = PlainLine(MODELS, ())
    for servo_id, model in MODELS.items():
        line.bus.identify(servo_id, model)
    line.servos.faults.silence(2)
    for _ in range(3):
        assert isinstance(line.bus.read_states(IDS)[2], ServoFault)
    assert not line.bus.needs_single_reads(2) and line.bus.read_together


@pytest.mark.parametrize("seed", range(10))
def test_a_bad_line_makes_no_servo_separate(seed: int) -> None:
    line = PlainLine(MODELS, ())
    line.servos.faults.disturbance = Disturbance(seed, drop=0.05, miss=0.05)
    for servo_id, model in MODELS.items():
        line.bus.identify(servo_id, model)
    for _ in range(20):
        line.bus.read_states(IDS)
    assert line.bus.read_together


def test_an_arm_with_plain_slaves_is_activated_and_holds() -> None:
    limits = JointLimits(-3.2, 3.2, 4.0, 12.0, 120.0)
    line = PlainLine(MODELS, (1, 3))
    joints = [Joint(f"joint{i}", i, model, limits) for i, model in MODELS.items()]
    hardware = ServoHardware("arm", joints, lambda: line.bus, line.clock)
    hardware.configure()
    hardware.activate()
    assert hardware.read().faults == {}
    held = {i: line.servos.servo(i).memory for i in IDS}
    assert all(memory.get(x.torque_enable) == 1 for memory in held.values())
    assert all(memory.get(x.goal_position) > 0 for memory in held.values())


def test_a_servo_without_group_writes_gets_single_writes(caplog: pytest.LogCaptureFixture) -> None:
    limits = JointLimits(-3.2, 3.2, 4.0, 12.0, 120.0)
    line = PlainLine(MODELS, (2,), GROUP_WRITES)
    line.servos.servo(2).memory.put(x.goal_position, 0)
    joints = [Joint(f"joint{i}", i, model, limits) for i, model in MODELS.items()]
    hardware = ServoHardware("arm", joints, lambda: line.bus, line.clock)
    with caplog.at_level(logging.WARNING):
        hardware.configure()
        hardware.activate()
    assert line.servos.servo(2).memory.get(x.goal_position) > 0
    assert any("servo 2 does not support group writes, so" in message for message in caplog.messages)
    assert line.bus.read_together


def test_a_servo_whose_status_level_forbids_reads_is_not_called_separate() -> None:
    line = PlainLine(MODELS, ())
    line.servos.servo(2).memory.put(x.status_return_level, 0)
    with pytest.raises(ServoRefused, match="responds to pings but not to reads"):
        line.bus.identify(2, x.XL430_W250)
    assert not line.bus.needs_single_reads(2)
