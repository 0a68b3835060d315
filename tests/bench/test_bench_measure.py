"""What ``servoloop bench bus`` writes to servos, and what it makes of their line, on simulated time."""

import math

import pytest

from drivers.bus import ServoGoal
from drivers.dynamixel import wire as dynamixel_wire
from drivers.dynamixel import x_series
from drivers.dynamixel.indirect import block_for
from drivers.errors import DriverError, ServoRefused
from drivers.feetech import sts, wire
from drivers.feetech.bus import FeetechBus
from drivers.makes import MODELS, bus_for
from drivers.registers import ServoModel
from servoloop.bench_bus import Figures, measure, stand_still, wire_s
from sim_backend.bus import VirtualBus
from sim_backend.clock import SimulatedClock
from sim_backend.dynamixel_bus import VirtualDynamixelBus
from sim_backend.plant import BenchPlant
from sim_backend.port import VirtualPort
from tests.drivers.ports import WatchedPort

IDS = (1, 2, 3, 4, 5, 6, 7)
BAUD = 1_000_000
GOALS = {i: ServoGoal(2048) for i in IDS}


class Interrupted(VirtualPort):
    """Nobody hears anything between two times."""

    from_s = 0.5
    to_s = 0.55

    def write(self, data: bytes) -> None:
        if not self.from_s <= self._clock.now() < self.to_s:
            super().write(data)


def measured(port: VirtualPort, cycles: int = 1000) -> Figures:
    clock = port._clock
    bus = FeetechBus(port, clock)
    return measure(bus, clock, IDS, GOALS, cycles, wire_s(bus, IDS, port.baud))


def servos() -> VirtualBus:
    return VirtualBus.of(BenchPlant(IDS))


def test_an_interruption_costs_as_many_cycles_as_it_lasts() -> None:
    """Whoever is known to be silent is not asked: cycles in which nobody is asked must not race through the run."""
    figures = measured(Interrupted(servos(), SimulatedClock(0.0)))
    assert 0 < figures.faults["silent"] < 7 * 60
    assert 1.0 <= figures.ratio < 1.2


def test_cycles_in_which_nobody_answers_are_faults_and_no_times() -> None:
    port = Interrupted(servos(), SimulatedClock(0.0))
    port.to_s = 2.0
    figures = measured(port)
    assert figures.faults["silent"] > 7 * 500
    assert 1.0 <= figures.ratio < 1.2
    assert figures.hz * figures.wire_us > 0.9e6
    assert figures.max_us < 2.0 * figures.wire_us


def test_a_run_in_which_nobody_answers_has_no_figures() -> None:
    port = Interrupted(servos(), SimulatedClock(0.0))
    port.from_s, port.to_s = 0.0, math.inf
    with pytest.raises(DriverError, match="nobody answered in any of 10 cycles"):
        measured(port, 10)


@pytest.mark.parametrize("late_s", [0.012, 0.016])
def test_a_slow_adapter_is_seen(late_s: float) -> None:
    port = WatchedPort(servos(), SimulatedClock(0.0))
    port.hold_s = late_s
    figures = measured(port, 100)
    assert figures.faults["silent"] == 0
    assert figures.p50_us >= late_s * 1e6


def test_a_slow_line_is_no_silent_one() -> None:
    """Its bytes alone take longer than the servos and the adapter are granted."""
    line = servos()
    for servo in line.servos:
        servo.memory.put(sts.baud_rate, sts.BAUD_RATES.index(38_400))
    figures = measured(VirtualPort(line, SimulatedClock(0.0), baud=38_400), 50)
    assert figures.faults["silent"] == 0
    assert 1.0 <= figures.ratio < 1.1


# What is written before the run


def goals_sent(port: WatchedPort) -> list[bytes]:
    return [packet for packet in port.sent if packet[4] == wire.SYNC_WRITE]


@pytest.mark.parametrize("model", ["mx-28", "ax-12a", "scs0009", "sts3250"])
def test_servos_of_another_model_are_refused_and_nothing_is_written(model: str) -> None:
    clock = SimulatedClock(0.0)
    port = WatchedPort(servos(), clock)
    bus = bus_for(dict.fromkeys(IDS, MODELS[model]), port, clock)
    # Where the other language has its state, these servos have something else: it looks like one all the same.
    with pytest.raises(ServoRefused, match="is model"):
        stand_still(bus, IDS, MODELS[model])
    assert not goals_sent(port)


def test_one_stranger_among_them_is_enough() -> None:
    line, clock = servos(), SimulatedClock(0.0)
    line.servo(7).memory.put(sts.model_number, 2825)
    port = WatchedPort(line, clock)
    with pytest.raises(ServoRefused, match=r"servo 7: is model 2825 \(sts3250\)"):
        stand_still(FeetechBus(port, clock), IDS, sts.STS3215)
    assert not goals_sent(port)


class Numberless(WatchedPort):
    """Simulated servos that answer sync reads and no others."""

    def write(self, data: bytes) -> None:
        if data[4] in (wire.SYNC_READ, wire.SYNC_WRITE):
            super().write(data)


def test_a_simulator_that_does_not_say_what_it_is_is_believed() -> None:
    clock = SimulatedClock(0.0)
    bus = FeetechBus(Numberless(servos(), clock), clock)
    goals = stand_still(bus, IDS, sts.STS3215)
    assert set(goals) == set(IDS)
    assert measure(bus, clock, IDS, goals, 20, wire_s(bus, IDS, BAUD)).faults["silent"] == 0


def test_a_simulator_with_nothing_in_its_memory_is_believed() -> None:
    line, clock = servos(), SimulatedClock(0.0)
    for servo in line.servos:
        for register in (sts.model_number, sts.status_level, sts.operating_mode):
            servo.memory.put(register, 0)
    assert set(stand_still(FeetechBus(VirtualPort(line, clock), clock), IDS, sts.STS3215)) == set(IDS)


def test_who_is_in_another_mode_is_read_and_gets_no_goal(caplog: pytest.LogCaptureFixture) -> None:
    line, clock = servos(), SimulatedClock(0.0)
    line.servo(3).memory.put(sts.operating_mode, 3)  # where a goal is a number of steps
    assert set(stand_still(FeetechBus(VirtualPort(line, clock), clock), IDS, sts.STS3215)) == set(IDS) - {3}
    assert "servo 3: is not in position mode" in caplog.text


def test_who_comes_only_later_gets_no_goal() -> None:
    line, clock = servos(), SimulatedClock(0.0)
    port = WatchedPort(line, clock)
    bus = FeetechBus(port, clock)
    line.faults.silence(7)
    goals = stand_still(bus, IDS, sts.STS3215)
    line.faults.restore(7)
    figures = measure(bus, clock, IDS, goals, 500, wire_s(bus, IDS, BAUD))
    assert 0 < figures.faults["silent"] < 400
    assert all(set(packet[7:-1:8]) == set(IDS) - {7} for packet in goals_sent(port))


def test_a_lost_answer_is_asked_for_again() -> None:
    line, clock = servos(), SimulatedClock(0.0)

    class Lossy(WatchedPort):
        def write(self, data: bytes) -> None:
            if data[4] != 2 or sum(packet[4] == 2 for packet in self.sent) % 3:
                super().write(data)
            else:
                self.sent += (data,)

    assert set(stand_still(FeetechBus(Lossy(line, clock), clock), IDS, sts.STS3215)) == set(IDS)


def test_a_servo_that_holds_a_load_keeps_its_goal() -> None:
    """Its goal is not where it sags to: cycle by cycle, run by run the arm would creep down."""
    plant, clock = BenchPlant(IDS), SimulatedClock(0.0)
    line = VirtualBus.of(plant)
    bus = FeetechBus(VirtualPort(line, clock), clock)
    bus.write_goals(GOALS)
    for servo_id in (1, 2):
        bus.torque_on(servo_id)
    plant.load_nm[0] = plant.load_nm[2] = 0.8
    clock.sleep_until(1.0)
    goals = stand_still(bus, IDS, sts.STS3215)
    assert line.servo(1).memory.get(sts.present_position) != 2048
    assert goals[1] == goals[2] == ServoGoal(2048)
    assert abs(goals[3].position_counts - 2048) > 100


def test_dynamixels_are_read_as_the_stack_reads_them() -> None:
    """By the mapped block, in one fast sync read."""
    model: ServoModel = x_series.XL430_W250
    clock = SimulatedClock(0.0)
    port = WatchedPort(VirtualDynamixelBus.of(BenchPlant(IDS), dict.fromkeys(IDS, model)), clock)
    bus = bus_for(dict.fromkeys(IDS, model), port, clock)
    goals = stand_still(bus, IDS, model)
    assert set(goals) == set(IDS)
    before = len(port.sent)
    figures = measure(bus, clock, IDS, goals, 20, wire_s(bus, IDS, BAUD))
    assert figures.faults["silent"] == 0
    block = block_for(model, 45)
    assert block is not None
    question = dynamixel_wire.fast_sync_read(IDS, block.address, block.size)
    assert all(packet.endswith(question) for packet in port.sent[before:])
