"""Tests that the torque of servos is checked even if no cycle has time left; in this case, one cycle is late."""

import pytest

from drivers.servos import sts
from hal.servos.servo_faults import LATEST, WATCH_S
from hal.types import JointCommand, JointFault
from tests.hal.bench import JOINTS, Bench, at

LONGEST_S = LATEST * WATCH_S
HERE = at(0.0, 0.0, JOINTS[2].position(1500))


class Paced:
    """Control loop whose cycles only have time to read the states."""

    def __init__(self, rate_hz: float, held_back_s: float) -> None:
        self.bench = Bench()
        if held_back_s:
            self.bench.servos.faults.on_arrival.append(lambda servo_id: held_back_s)
        self.bench.active()
        self.period_s = 1.0 / rate_hz
        self.due_s = self.bench.clock.now()
        self.late = 0
        for _ in range(round(rate_hz)):
            self.cycle()
        self.late = 0

    def cycle(self) -> dict[str, JointFault]:
        clock, hardware = self.bench.clock, self.bench.hardware
        hardware.request(self.due_s + 0.9 * self.period_s)
        faults = dict(hardware.read().faults)
        hardware.write(JointCommand(HERE, self.period_s))
        self.due_s += self.period_s
        if clock.now() > self.due_s:
            self.late += 1
            self.due_s = clock.now()
        clock.sleep_until(self.due_s)
        return faults

    def cycles(self, for_s: float) -> list[dict[str, JointFault]]:
        end_s = self.bench.clock.now() + for_s
        found = []
        while self.bench.clock.now() < end_s:
            found.append(self.cycle())
        return found


busy = pytest.mark.parametrize(("rate_hz", "held_back_s"), [(400.0, 0.0), (50.0, 0.0155)], ids=["fast", "slow adapter"])


@busy
def test_a_servo_that_answers_again_gets_goals_after_its_torque_is_checked(rate_hz: float, held_back_s: float) -> None:
    loop = Paced(rate_hz, held_back_s)
    loop.bench.servos.faults.silence(1)
    loop.cycles(0.2)
    loop.bench.servos.faults.restore(1)
    while (faults := loop.cycle())["shoulder"].kind != "no_torque":
        pass
    assert faults["shoulder"].text.startswith("shoulder: servo 1 responds again, but its torque has not been checked")
    loop.late = 0
    waited = loop.cycles(LONGEST_S + 0.1)
    assert "shoulder" in waited[0] and waited[-1] == {}
    assert not loop.bench.hardware._states.faults.withheld
    assert loop.late <= 2


def test_two_short_silences_are_not_one_long_silence() -> None:
    loop = Paced(400.0, 0.0)
    for _ in range(2):
        loop.bench.servos.faults.silence(1)
        assert loop.cycle().keys() == {"shoulder"}
        loop.bench.servos.faults.restore(1)
        faults = loop.cycles(0.15)
        assert faults[-1] == {}
        assert not loop.bench.hardware._states.faults.withheld


@busy
def test_a_servo_reset_within_a_cycle_is_detected(rate_hz: float, held_back_s: float) -> None:
    loop = Paced(rate_hz, held_back_s)
    loop.bench.servos.servo(7).power_cycle()
    loop.bench.servos.servo(7).memory.put(sts.torque_enable, 1)  # the next goal would also enable the torque
    faults = loop.cycles(LONGEST_S + 0.1)[-1]
    assert faults["finger"].text.startswith("finger: servo 7 has lost its torque")


@busy
def test_late_cycles_are_few(rate_hz: float, held_back_s: float) -> None:
    loop = Paced(rate_hz, held_back_s)
    cycles = loop.cycles(5.0)
    assert cycles.count({}) == len(cycles)
    assert loop.late <= 5.0 / LONGEST_S + 1


def test_on_a_fast_bus_one_servo_is_checked_at_a_time() -> None:
    loop = Paced(800.0, 0.0)  # the answers of all three servos do not fit in one cycle
    shown = loop.bench.hardware._states.faults._checked_s
    oldest = []
    for _ in range(1000):
        loop.cycle()
        oldest.append(loop.bench.clock.now() - min(shown.values()))
    assert loop.late == 0
    assert max(oldest) <= LONGEST_S + len(shown) * 2 * loop.period_s


def test_on_a_bus_that_becomes_slow_all_servos_are_checked_at_once() -> None:
    loop = Paced(50.0, 0.0155)
    faults = loop.bench.hardware._states.faults
    faults._quick = True
    for _ in range(50):
        loop.cycle()
        if not faults._quick:
            break
    loop.cycle()
    assert loop.bench.clock.now() - min(faults._checked_s.values()) <= 2 * loop.period_s


def test_all_servos_can_be_checked_at_once() -> None:
    bench = Bench().active()
    bench.wait()
    assert bench.hardware.ask_for_torque() == frozenset()
    assert bench.hardware.without_torque == frozenset()
    for servo_id in (2, 7):
        bench.servos.servo(servo_id).power_cycle()
    assert bench.hardware.ask_for_torque() == frozenset()
    assert bench.hardware.without_torque == {"elbow", "finger"}
    faults = bench.wait().faults
    assert set(faults) == {"elbow", "finger"} and "activate again" in faults["elbow"].text


def test_a_servo_that_does_not_answer_differs_from_one_without_torque() -> None:
    bench = Bench().active()
    bench.wait()
    bench.servos.faults.silence(2)
    assert bench.hardware.ask_for_torque() == {"elbow"}
    assert bench.hardware.without_torque == frozenset(), "a lost answer does not mean lost torque"
    bench.servos.faults.restore(2)
    assert bench.wait().faults == {}
    assert bench.hardware.ask_for_torque() == frozenset() == bench.hardware.without_torque


def test_cycles_without_time_left_are_logged_at_most_once_a_second(caplog: pytest.LogCaptureFixture) -> None:
    """Every second cycle has no time left, as at a cycle rate that is too high for the bus."""
    loop = Paced(100.0, 0.0)
    clock, hardware = loop.bench.clock, loop.bench.hardware
    for cycle in range(250):
        hardware.request(clock.now() if cycle % 2 == 0 else clock.now() + 0.009)
        faults = hardware.read().faults
        assert {fault.kind for fault in faults.values()} == ({"no_time"} if cycle % 2 == 0 else set())
        clock.sleep_until(clock.now() + loop.period_s)
    assert caplog.text.count("the cycle had no time left") == 3
    assert caplog.text.count("respond again") == 3


def test_a_servo_that_stays_silent_after_a_want_of_time_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    loop = Paced(100.0, 0.0)
    clock, hardware = loop.bench.clock, loop.bench.hardware
    for _ in range(3):
        hardware.request(clock.now())
        hardware.read()
        loop.cycle()
    caplog.clear()
    hardware.request(clock.now())
    hardware.read()
    loop.bench.servos.faults.silence(1)
    loop.cycle()
    assert "shoulder: servo 1 does not respond" in caplog.text
