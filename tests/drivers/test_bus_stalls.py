"""Behavior of every bus when an adapter stalls and delivers all old replies before the new ones."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.bus.late_replies import HELD_S
from drivers.protocol import v2 as wire
from drivers.servos.catalog import series_of
from drivers.types import ServoState
from sim_backend.line.line import DelayedReply
from sim_backend.servos.dynamixel.servo import VirtualXServo
from tests.drivers.fault_lines import IDS, KINDS, Kind, Line, Truth, every_kind
from tests.drivers.ports import WatchedPort

PERIODS_S = (0.005, 0.01, 0.02, 0.05)
HOLDS_S = (0.02, 0.045, 0.11, 0.3, 1.0)
BEFORE = 5
"""Number of cycles without faults."""


class Stalling:
    """A bus whose adapter can delay replies, and whose registers encode the request that they answer."""

    def __init__(self, kind: Kind, period_s: float) -> None:
        self.line = Line(kind, WatchedPort)
        self.period_s = period_s
        self.truth = Truth(self.line)
        self.answers: dict[int, int] = {}
        """Number of the last request that each servo has answered on the wire between servo and adapter."""
        self.cycles = self.torque_replies = 0
        """Number of cycles, and number of torque states received in time."""
        self._switch = series_of(kind.model).torque_enable
        receive = self.line.servos.receive

        def heard(data: bytes, now_s: float, baud: int = 1_000_000) -> list[DelayedReply]:
            self.truth.number += 1
            self._publish()
            replies = receive(data, now_s, baud)
            if data[:4] != wire.HEADER or data[7] not in (wire.READ, wire.WRITE):  # a single request for the map
                self._note([reply.data for reply in replies])
            return replies

        self.line.servos.receive = heard  # type: ignore[method-assign]

    def _publish(self) -> None:
        for servo in self.line.servos.servos:
            if isinstance(servo, VirtualXServo):
                servo.firmware.publish()

    def _note(self, replies: list[bytes]) -> None:
        for data in replies:
            servo_id = data[4 if data[2] == 0xFD else 2]
            self.answers |= dict.fromkeys((servo_id,) if servo_id in IDS else IDS, self.truth.number)

    def cycle(self) -> set[int]:
        """Return the servos with a state, and check that each state answers the last request to its servo."""
        begin_s = self.line.clock.now()
        seen = set()
        for servo_id, reading in self.line.states(begin_s + 0.8 * self.period_s).items():
            if isinstance(reading, ServoState):
                seen.add(servo_id)
                number, self.truth.number = self.truth.number, self.answers[servo_id]
                assert self.truth.holds(servo_id, reading), (self.answers[servo_id], servo_id, reading)
                self.truth.number = number
        self.cycles += 1
        if self.cycles % 3 == 0:
            self._ask_for_torque(IDS[self.cycles // 3 % len(IDS)])
        self.line.clock.sleep_until(begin_s + self.period_s)
        return seen

    def _ask_for_torque(self, servo_id: int) -> None:
        """Read the torque state and check that it answers this request. The torque switch is changed before each
        read."""
        on = self.cycles % 2
        self.line.servos.servo(servo_id).memory.put(self._switch, on)
        states = self.line.bus.torque_states((servo_id,), self.line.clock.now() + self.period_s)
        assert states in ({servo_id: bool(on)}, {})
        self.torque_replies += len(states)

    def stall(self, hold_s: float, cycles: int) -> None:
        """Run ``cycles`` cycles whose replies are delayed by ``hold_s``, and then more cycles until all replies have
        arrived."""
        port: Any = self.line.port
        port.hold_s = hold_s
        for _ in range(cycles):
            self.cycle()
        port.hold_s = 0.0
        over_s = self.line.clock.now() + hold_s
        while self.line.clock.now() < over_s:
            self.cycle()

    def outage(self, duration_s: float) -> None:
        """Run cycles without replies for ``duration_s``."""
        faults, end_s = self.line.faults, self.line.clock.now() + duration_s
        for servo_id in IDS:
            faults.silence(servo_id)
        while self.line.clock.now() < end_s:
            self.cycle()
        for servo_id in IDS:
            faults.restore(servo_id)

    def comes_back(self) -> None:
        """Check that all servos are read within a second, and in every cycle after that."""
        end_s = self.line.clock.now() + 1.0
        missing = set(IDS)
        while missing and self.line.clock.now() < end_s:
            missing -= self.cycle()
        assert not missing
        before = self.torque_replies
        for _ in range(BEFORE + round(HELD_S / self.period_s)):
            self.cycle()
        assert self.torque_replies > before


@pytest.mark.parametrize(
    "period_s", [pytest.param(one, marks=() if one in (0.005, 0.05) else pytest.mark.slow) for one in PERIODS_S]
)
@every_kind
def test_a_stall_never_yields_an_old_state_and_the_servos_return(kind: Kind, period_s: float) -> None:
    for hold_s in HOLDS_S:
        for cycles in (1, 12):
            stalling = Stalling(kind, period_s)
            for _ in range(BEFORE):
                stalling.cycle()
            stalling.stall(hold_s, cycles)
            stalling.comes_back()


durations_s = st.floats(0.005, 1.0)
stalls = st.tuples(durations_s, st.integers(1, 15))


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.sampled_from(KINDS), st.sampled_from(PERIODS_S), st.lists(stalls | durations_s, min_size=1, max_size=3))
def test_repeated_stalls_with_lost_replies(
    kind: Kind, period_s: float, troubles: list[tuple[float, int] | float]
) -> None:
    stalling = Stalling(kind, period_s)
    for trouble in troubles:
        if isinstance(trouble, tuple):
            stalling.stall(*trouble)
        else:
            stalling.outage(trouble)
        for _ in range(BEFORE):
            stalling.cycle()
    stalling.comes_back()


@every_kind
def test_a_lost_reply_has_no_effect_after_a_later_reply(kind: Kind) -> None:
    line = Line(kind)
    line.faults.silence(7)
    for _ in range(20):
        line.faults.corrupt_next(3)
        for _ in range(3):
            line.cycle()
    account = line.account(3)
    assert (account.corrupt, account.late) == (20, 0)


@every_kind
@pytest.mark.parametrize("pause_s", [0.0, 0.0003, 0.002], ids=str)
def test_replies_to_an_abandoned_request_are_discarded(kind: Kind, pause_s: float) -> None:
    """If another bus is lost while both buses are read, the replies of this bus arrive later."""
    stalling = Stalling(kind, 0.02)
    stalling.cycle()
    for _ in range(3):
        stalling.line.bus.request(IDS, stalling.line.clock.now() + 0.01)
        stalling.line.clock.sleep_until(stalling.line.clock.now() + pause_s)
        for _ in range(5):
            seen = stalling.cycle()
        assert seen == set(IDS)
    for account in map(stalling.line.account, IDS):
        assert min(account.silent, account.late, account.corrupt) >= 0
