"""Behavior of every bus in thousands of cycles with line errors, and with each single fault."""

import math

import pytest

from drivers.protocol.v1 import SYNC_WRITE
from drivers.types import ServoFault, ServoGoal, ServoState
from sim_backend.faults import Disturbance
from tests.drivers.cycles import exchange
from tests.drivers.fault_lines import CYCLES, IDS, KINDS, Kind, Line, Truth, every_kind, every_servo

CHAINED = next(kind for kind in KINDS if kind.waits)
"""Kind of bus for the short cases, because `make test` runs only the first case of the long tests."""
TOO_LOW = 50
"""Value of max_voltage: 5 V, which is less than the supply voltage of any servo in these tests. An X series servo
accepts no value below 9.5 V."""


@pytest.mark.soak
@pytest.mark.parametrize(
    ("kind", "share"),
    # The decoder of complete reads is used only if faults are rare.
    [pytest.param(kind, 1.0, id=kind.name) for kind in KINDS]
    + [pytest.param(kind, 0.02, id=f"{kind.name}, rarely") for kind in KINDS if kind.with_goals],
)
def test_thousands_of_cycles_with_line_errors(kind: Kind, share: float) -> None:
    """Every value is correct and from this cycle, and the counters match the injected faults."""
    line = Line(kind)
    truth = Truth(line)
    goals = dict.fromkeys(IDS, ServoGoal(500))  # servos without torque do not move
    line.faults.disturbance = done = Disturbance(seed=3, drop=0.05 * share, flip=0.02 * share, noise=0.02 * share)
    states = 0
    for number in range(CYCLES):
        truth.number = number
        line.goals = goals if number % 2 or kind.with_goals else {}
        for servo_id, reading in line.cycle().items():
            if isinstance(reading, ServoState):
                states += 1
                assert truth.holds(servo_id, reading), (number, servo_id)
    for servo_id in IDS:
        account = line.account(servo_id)
        dropped, flipped = done.done["drop", servo_id], done.done["flip", servo_id]
        # After four consecutive losses, the next reply may belong to any of these requests, and counts as late. A servo
        # that was silenced by another servo may still answer, so its next reply may also count as late.
        doubtful = math.ceil(CYCLES / 2500) + (math.ceil(CYCLES / 150) if kind.waits else 0)
        assert 0 <= account.silent + account.corrupt + account.late - dropped - flipped <= doubtful
        # If two servos are missing in a group read, garbage may be attributed to the wrong one.
        assert account.silent == pytest.approx(dropped, rel=0.0 if kind.one_by_one else 0.05, abs=doubtful)
        assert account.retries > 0 and account.alarms == 0
    noise = sum(count for (what, _), count in done.done.items() if what == "noise")
    assert line.bus.counters.noise == pytest.approx(noise, rel=0.05)
    # One of 20 replies is lost, which in protocol 2.0 silences the servos after it until the next request.
    assert states > (0.93 if kind.waits else 0.99) * CYCLES * len(IDS)


@every_kind
def test_lost_requests_never_cause_a_wrong_value(kind: Kind) -> None:
    loses_requests(kind, 500)


def test_requests_lost_on_a_chained_bus() -> None:
    loses_requests(CHAINED, 250)


def loses_requests(kind: Kind, cycles: int) -> None:
    """Lose requests to servos, and check that every value is correct and that few values are missing."""
    line = Line(kind)
    truth = Truth(line)
    line.faults.disturbance = done = Disturbance(seed=6, flip=0.02, noise=0.02, miss=0.03)
    states = 0
    for number in range(cycles):
        truth.number = number
        for servo_id, reading in line.cycle().items():
            if isinstance(reading, ServoState):
                states += 1
                assert truth.holds(servo_id, reading), (number, servo_id)
    assert sum(count for (what, _), count in done.done.items() if what == "miss") > 0.1 * cycles
    assert line.bus.counters.faults()["silent"] > 0.1 * cycles
    assert states > 0.99 * cycles * len(IDS)


@every_kind
def test_a_lost_reply_is_requested_again_in_the_same_cycle(kind: Kind) -> None:
    line = Line(kind)
    account = line.account(3)
    before = account.replies
    line.faults.corrupt_next(3)
    assert line.missing() == {}
    assert (account.corrupt, account.retries, account.replies - before) == (1, 1, 1)


@every_kind
def test_requests_are_not_repeated_without_time(kind: Kind) -> None:
    line = Line(kind)
    line.cycle()
    line.faults.corrupt_next(3)
    readings = line.states(
        line.clock.now() + line.bus.exchange_size(dict.fromkeys(IDS, ServoGoal(500)), IDS) * 10.0 / line.port.baud
    )
    assert isinstance(readings[2], ServoState) and isinstance(readings[3], ServoFault)
    assert line.account(3).retries == 0


@every_kind
def test_the_deadline_ends_the_wait_on_a_silent_bus(kind: Kind) -> None:
    line = Line(kind)
    for servo_id in IDS:
        line.faults.silence(servo_id)
    begin_s = line.clock.now()
    readings = line.states(begin_s + 0.004)
    assert line.clock.now() <= begin_s + 0.0041
    kinds = [reading.kind for reading in readings.values() if isinstance(reading, ServoFault)]
    assert kinds[0] == "silent" and len(kinds) == len(IDS)
    # In protocol 2.0, a silent servo silences the servos listed after it, which are then read one by one.
    assert set(kinds) == ({"silent", "no_time"} if kind.one_by_one or kind.waits else {"silent"})


@every_servo
def test_a_silent_servo_is_reported_in_every_cycle_and_costs_little_time(kind: Kind, servo_id: int) -> None:
    costs_little(kind, servo_id, 300)


def test_the_first_servo_of_a_chained_bus_is_silent_and_costs_little_time() -> None:
    costs_little(CHAINED, 1, 100)


def costs_little(kind: Kind, servo_id: int, cycles: int) -> None:
    """Silence a servo, and check that only this servo is reported and that few cycles take much longer."""
    line = Line(kind)
    period_s = kind.table.period_s
    begin_s = line.clock.now()
    line.states(begin_s + period_s)
    whole_s = line.clock.now() - begin_s
    line.faults.silence(servo_id)
    costs = []
    for _ in range(cycles):
        begin_s = line.clock.now()
        readings = line.states(begin_s + period_s)
        costs.append(line.clock.now() - begin_s - whole_s)
        assert {i: r.kind for i, r in readings.items() if isinstance(r, ServoFault)} == {servo_id: "silent"}
        line.clock.sleep_until(begin_s + period_s)
    assert sorted(costs)[-4] < 0.0031  # the first cycles repeat requests
    assert max(costs) < 0.0125
    account = line.account(servo_id)
    assert account.silent + account.skipped == cycles + account.retries
    assert account.skipped > cycles - 20


@every_servo
def test_a_servo_that_returns_is_read_within_a_second(kind: Kind, servo_id: int) -> None:
    comes_back(kind, (servo_id,))


def test_the_first_servo_of_a_chained_bus_returns() -> None:
    comes_back(CHAINED, (1,))


@every_kind
def test_a_whole_bus_that_returns_is_read_within_a_second(kind: Kind) -> None:
    comes_back(kind, IDS)


def comes_back(kind: Kind, silent: tuple[int, ...]) -> None:
    """Silence servos for three seconds, and check that they are read again within a second.

    Before the first reply, a silent first servo of a chained read looks like a slow adapter.
    """
    line = Line(kind)
    assert line.missing() == {}
    for servo_id in silent:
        line.faults.silence(servo_id)
    for _ in range(round(3.0 / kind.table.period_s)):
        assert set(line.missing()) == set(silent)
    for servo_id in silent:
        line.faults.restore(servo_id)
    for _ in range(round(1.0 / kind.table.period_s)):
        line.cycle()
    assert line.missing() == {}


@every_kind
def test_goals_and_states_are_exchanged_in_one_cycle(kind: Kind) -> None:
    line = Line(kind)
    goals = {i: ServoGoal(kind.table.middle + 50 + i, 50) for i in IDS}
    readings = exchange(line.bus, goals, IDS, line.clock.now() + kind.table.budget_s)
    assert all(isinstance(reading, ServoState) for reading in readings.values())
    assert [line.bus.goal(i) for i in IDS] == [goal.position_counts for goal in goals.values()]


@every_kind
def test_alarms_are_named_and_counted(kind: Kind) -> None:
    line = Line(kind)
    line.bus.write(3, kind.table.max_voltage, 95 if kind.waits else TOO_LOW)
    line.clock.sleep_until(line.clock.now() + 0.1)
    reading = line.cycle()[3]
    assert isinstance(reading, ServoState)
    assert reading.alarms == ("voltage",)
    assert line.account(3).alarms == 1
    assert line.missing() == {}


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind.with_goals], ids=lambda kind: kind.name)
def test_no_goal_is_sent_while_a_reply_is_on_the_wire(kind: Kind) -> None:
    """The packets would collide on a half-duplex wire, and the loss of a goal would not be noticed, because goals are
    not acknowledged."""
    line = Line(kind)
    line.faults.disturbance = Disturbance(seed=5, drop=0.02, flip=0.02, noise=0.05)
    write = line.port.write
    collisions: list[bytes] = []

    def watched(data: bytes) -> None:
        if line.port._coming and bytes((SYNC_WRITE,)) in data[:8]:
            collisions.append(data)
        write(data)

    line.port.write = watched  # type: ignore[method-assign]
    for number in range(1500):
        if number % 100 == 0:  # a returning servo replies after all others
            line.faults.silence(4)
        elif number % 100 == 50:
            line.faults.restore(4)
        line.cycle()
    assert collisions == []
