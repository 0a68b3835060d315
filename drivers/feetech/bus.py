"""Feetech STS servos on one port: single-servo calls by the SDK, group transactions by us."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Final, cast

from scservo_sdk import PacketHandler

from drivers.absent import AbsenceWatch
from drivers.burst import BITS_PER_BYTE, TRIED_GAP_S
from drivers.bus import Reading, ServoBus, ServoGoal
from drivers.clock import Clock
from drivers.counters import BusCounters
from drivers.echo import Echo
from drivers.errors import ServoError
from drivers.feetech import state, sts, wire
from drivers.feetech.burst import BurstReader
from drivers.feetech.identify import check_settings, identify
from drivers.port import Port
from drivers.questions import Questions
from drivers.readings import RETRIES, Outcome, count_skipped, port_at, readings_of
from drivers.registers import ServoModel
from drivers.single_calls import SingleCalls
from drivers.single_servo import SingleServo, dialect
from drivers.tries import tried_with_each
from drivers.turns import Steps, Wait, finish

_ORDER: Final = "little"


class FeetechBus(SingleCalls):
    """A ServoBus of STS servos (protocol 0, little endian)."""

    def __init__(self, port: Port, clock: Clock) -> None:
        self._port = port
        self._clock = clock
        self._counters = BusCounters()
        self._echo = Echo()
        self._burst = BurstReader(port, clock, self._echo, self._counters)
        self._absent = AbsenceWatch()
        # No status bit refuses an instruction: all are alarms.
        talk = dialect(PacketHandler(0), 0, sts.alarms, 0)
        questions = Questions(port, clock, self._echo, self._counters, talk, self._disturb, self._burst.single_until_s)
        self._single = SingleServo(questions, _ORDER, reboots=True)
        super().__init__(self._single)

    @property
    def name(self) -> str:
        return self._port.name

    @property
    def baud(self) -> int:
        return self._port.baud

    @property
    def counters(self) -> BusCounters:
        return self._counters

    def identify(self, servo_id: int, model: ServoModel) -> None:
        identify(self._single, servo_id, model)
        self.check_settings(servo_id, model)

    def check_settings(self, servo_id: int, model: ServoModel) -> None:
        check_settings(self._single, servo_id, self.name)

    def _disturb(self) -> None:
        """Something else than a group read goes over the line, and may leave something on it."""
        self._burst.clean = False

    def read_states(self, servo_ids: Sequence[int], deadline_s: float | None = None) -> Mapping[int, Reading]:
        if deadline_s is not None:
            return finish(self.state_steps(servo_ids, deadline_s))
        asked = tuple(servo_ids)
        outcome = self._burst.read(asked, (), math.inf)
        self._absent.note(outcome, self._clock.now())
        return readings_of(asked, outcome)

    def state_steps(self, servo_ids: Sequence[int], deadline_s: float) -> Steps[Mapping[int, Reading]]:
        asked = tuple(servo_ids)
        firm, tried = self._ask(asked)
        try:
            yield Wait.LAST
        except GeneratorExit:
            self._burst.forsake(firm + tried if firm else ())
            raise
        return self._hear(asked, firm, tried, deadline_s)

    def exchange(
        self, goals: Mapping[int, ServoGoal], servo_ids: Sequence[int], deadline_s: float
    ) -> Mapping[int, Reading]:
        packet = state.goals_packet(goals) if goals else b""
        asked = tuple(servo_ids)
        steady = self._burst.steady
        if steady is None or steady.servo_ids != asked or not self._burst.clean:
            firm, tried = self._ask(asked)
            return self._hear(asked, firm, tried, deadline_s, packet)
        states = self._burst.cycle(steady, packet, deadline_s)
        if states is None:
            return self._made_up(asked, asked, self._burst.recover(steady, deadline_s), deadline_s)
        return states

    def exchange_size(self, goals: Mapping[int, ServoGoal], servo_ids: Sequence[int]) -> int:
        ids = tuple(servo_ids)
        question = wire.sync_read(ids, state.STATE_ADDRESS, state.STATE_SIZE)
        return (
            (state.goals_size(len(goals)) if goals else 0)
            + len(question)
            + (state.STATE_SIZE + wire.OVERHEAD) * len(ids)
        )

    def _ask(self, asked: tuple[int, ...]) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Send the question; who surely answers, and who is only tried."""
        firm, tried = self._absent.split(asked, self._clock.now())
        if not firm:
            # Where nobody is expected to answer, the adapter may be the slow one: the whole first wait.
            firm, tried = tried, ()
        if firm:
            self._burst.ask(firm, tried)
        return firm, tried

    def _hear(
        self,
        asked: tuple[int, ...],
        firm: tuple[int, ...],
        tried: tuple[int, ...],
        deadline_s: float,
        goals: bytes = b"",
    ) -> Mapping[int, Reading]:
        outcome: Mapping[int, Outcome] = {}
        if firm:
            outcome = self._burst.hear(firm, tried, deadline_s, goals)
        elif goals:
            self._burst.send(goals)
        if self._burst.clean and firm == asked and not self._absent.misses:
            return cast(Mapping[int, Reading], outcome)
        return self._made_up(asked, firm, outcome, deadline_s)

    def _made_up(
        self, asked: tuple[int, ...], firm: tuple[int, ...], outcome: Mapping[int, Outcome], deadline_s: float
    ) -> Mapping[int, Reading]:
        """Whoever is missing is asked again if there is time."""
        if len(outcome) < len(asked):
            count_skipped(self._counters, asked, outcome)
        missing = self._absent.note(outcome, self._clock.now())
        if missing:
            outcome = dict(outcome)
            self._ask_again([i for i in missing if i in firm], outcome, deadline_s)
        return readings_of(asked, outcome)

    def _ask_again(self, missing: list[int], outcome: dict[int, Outcome], deadline_s: float) -> None:
        """Only what is missing, and only while there is time."""
        for _ in range(RETRIES):
            if not missing or not self._has_time(missing, deadline_s):
                return
            again = self._retry(tuple(missing), deadline_s)
            outcome.update(again)
            missing = self._absent.note(again, self._clock.now())

    def _retry(self, missing: tuple[int, ...], deadline_s: float) -> Mapping[int, Outcome]:
        for servo_id in missing:
            self._counters.of(servo_id).retries += 1
        return self._burst.read((), missing, deadline_s)

    def _has_time(self, servo_ids: Sequence[int], deadline_s: float) -> bool:
        """Whether those can be asked again and waited for."""
        size = (state.STATE_SIZE + 2 * wire.OVERHEAD) * (len(servo_ids) + 1)
        return self._clock.now() + size * BITS_PER_BYTE / self._port.baud + TRIED_GAP_S < deadline_s

    def write_goals(self, goals: Mapping[int, ServoGoal]) -> None:
        self._burst.send(state.goals_packet(goals))

    def goal(self, servo_id: int) -> int:
        return self._read_surely(servo_id, sts.goal_position)

    def position_limits(self, servo_id: int) -> tuple[int, int] | None:
        return self._limits(servo_id, sts.POSITION_LIMITS)

    def torque_is_on(self, servo_id: int, deadline_s: float | None = None) -> bool:
        return self._read_surely(servo_id, sts.torque_enable, deadline_s) == 1

    def torque_on(self, servo_id: int) -> None:
        self.write(servo_id, sts.torque_enable, 1)

    def torque_off(self, servo_ids: Sequence[int]) -> list[ServoError]:
        # All at once first, so that nobody waits for a dead one's time-out; then each, acknowledged.
        off = {servo_id: sts.torque_enable.encode(0, _ORDER) for servo_id in servo_ids}
        self._burst.send(wire.sync_write(sts.torque_enable.address, sts.torque_enable.size, off))
        return tried_with_each(servo_ids, lambda servo_id: self.write(servo_id, sts.torque_enable, 0))

    def limit_torque(self, servo_id: int, share: float) -> None:
        # What lasts stays the upper bound.
        lasting = self._read_surely(servo_id, sts.max_torque)
        self._write_surely(servo_id, sts.torque_limit, min(round(share / sts.TORQUE_UNIT), lasting))

    @contextmanager
    def at_baud(self, baud: int) -> Iterator[ServoBus]:
        with port_at(self._port, self._clock, baud):
            yield FeetechBus(self._port, self._clock)
        self._burst.clean = False

    def close(self) -> None:
        self._port.close()
