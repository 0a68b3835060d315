"""Servos without a sync read on one port: each is asked by itself, goals go out together."""

import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

from drivers.absent import AbsenceWatch
from drivers.burst import BITS_PER_BYTE
from drivers.bus import Reading, ServoBus, ServoGoal
from drivers.clock import Clock
from drivers.counters import BusCounters
from drivers.echo import Echo
from drivers.errors import ServoError, ServoRefused
from drivers.feetech import wire
from drivers.port import Port
from drivers.questions import Questions
from drivers.read_each.identify import check_settings, identify
from drivers.read_each.line import RETRY_GAP_S, Line
from drivers.read_each.series import series_of
from drivers.readings import RETRIES, Outcome, count_skipped, fault, port_at, readings_of
from drivers.registers import Register, ServoModel
from drivers.single_calls import SingleCalls
from drivers.single_servo import SingleServo, dialect
from drivers.tries import tried_with_each
from drivers.turns import Steps, finish

LOG = logging.getLogger("servoloop.drivers")


class ReadEachBus(SingleCalls):
    """A ServoBus of Feetech SCS servos, or of Dynamixels of protocol 1.0 (AX, MX).

    Where all are MX, one bulk read asks them all. ``models``: which servo is on the line, by ID;
    ValueError where they cannot share it.
    """

    def __init__(
        self, port: Port, clock: Clock, models: Mapping[int, ServoModel], *, say_how_long: bool = True
    ) -> None:
        self._series = series = series_of(tuple(models.values()))
        self._models = dict(models)
        self._port = port
        self._clock = clock
        self._counters = BusCounters()
        echo = Echo()
        state_of = {servo_id: series.state_of(model) for servo_id, model in models.items()}
        self._line = Line(port, clock, echo, self._counters, series, state_of)
        self._goal_of = {servo_id: series.goal_of(model) for servo_id, model in models.items()}
        self._absent = AbsenceWatch()
        talk = dialect(series.sdk(), series.refusals, series.alarms, series.came_broken)
        self._questions = Questions(port, clock, echo, self._counters, talk, self._disturb, self._line.single_until_s)
        self._single = SingleServo(self._questions, series.byte_order, reboots=series.reboots)
        super().__init__(self._single)
        self._bulk = bool(models) and all(model in series.bulk_models for model in models.values())
        self._unasked: set[int] = set()
        """Whom the last cycle had no time for: the next begins with them."""
        if say_how_long and not self._bulk:
            self._say_that_it_takes_longer(tuple(models))

    def _say_that_it_takes_longer(self, servo_ids: tuple[int, ...]) -> None:
        each_s = self._question_and_replies(servo_ids) * BITS_PER_BYTE / self._port.baud
        more_s = (len(servo_ids) - 1) * len(self._line.question((1,), 1)) * BITS_PER_BYTE / self._port.baud
        LOG.info(
            "%s: these %s servos have no group read, so the %d of them are asked one by one: %.2f ms of every cycle "
            "at %d baud, %.2f ms more than together, and the adapter's delay %d times instead of once",
            self.name, self._series.name, len(servo_ids), each_s * 1e3, self._port.baud, more_s * 1e3, len(servo_ids),
        )  # fmt: skip

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
        identify(self._single, self._series, servo_id, model)
        self.check_settings(servo_id, model)

    def check_settings(self, servo_id: int, model: ServoModel) -> None:
        check_settings(self._single, self._series, servo_id, model)

    def _disturb(self) -> None:
        """Something else than a read of the state goes over the line, and may leave something on it."""
        self._line.clean = False

    def read(self, servo_id: int, register: Register) -> int:
        value = self._single.read(servo_id, register)
        on_wire_s = (len(self._line.question((servo_id,), 1)) + wire.OVERHEAD + register.size) * self._line.byte_s
        self._line.patience.heard(max(0.0, self._clock.now() - self._questions.sent_s - on_wire_s))
        return value

    def read_states(self, servo_ids: Sequence[int], deadline_s: float | None = None) -> Mapping[int, Reading]:
        if deadline_s is not None:
            return finish(self.state_steps(servo_ids, deadline_s))
        asked = tuple(servo_ids)
        outcome = finish(self._each(asked))
        self._absent.note(outcome, self._clock.now())
        return self._readings(asked, outcome)

    def state_steps(self, servo_ids: Sequence[int], deadline_s: float) -> Steps[Mapping[int, Reading]]:
        return self._cycle(tuple(servo_ids), deadline_s, b"")

    def exchange(
        self, goals: Mapping[int, ServoGoal], servo_ids: Sequence[int], deadline_s: float
    ) -> Mapping[int, Reading]:
        """The goals go out in one piece with the first question."""
        return finish(self._cycle(tuple(servo_ids), deadline_s, self._goals_packet(goals)))

    def exchange_size(self, goals: Mapping[int, ServoGoal], servo_ids: Sequence[int]) -> int:
        return len(self._goals_packet(goals)) + self._question_and_replies(tuple(servo_ids))

    def _question_and_replies(self, servo_ids: tuple[int, ...]) -> int:
        """Bytes on the wire for the states of all."""
        reply_size = self._series.state_sizes[0] + wire.OVERHEAD
        questions = sum(len(self._line.question(group, 1)) for group in self._groups(servo_ids))
        return questions + reply_size * len(servo_ids)

    def _groups(self, servo_ids: tuple[int, ...]) -> list[tuple[int, ...]]:
        """Who is asked together."""
        return [servo_ids] if self._bulk and servo_ids else [(servo_id,) for servo_id in servo_ids]

    def _each(self, servo_ids: tuple[int, ...]) -> Steps[dict[int, Outcome]]:
        """Without haste: every servo by itself, however long it takes."""
        self._line.patience.begin()
        outcome: dict[int, Outcome] = {}
        for servo_id in servo_ids:
            outcome |= yield from self._line.steps((servo_id,), True, math.inf)
        return outcome

    def _cycle(self, asked: tuple[int, ...], deadline_s: float, goals: bytes) -> Steps[Mapping[int, Reading]]:
        firm, tried = self._absent.split(asked, self._clock.now())
        firm = tuple(sorted(firm, key=lambda i: i not in self._unasked))
        outcome: dict[int, Outcome] = {}
        self._line.patience.begin()
        groups = [*self._groups(firm), *((i,) for i in tried)]
        for index, group in enumerate(groups, 1):
            if self._line.has_time(group, deadline_s):
                # Whoever a silent one hides in a bulk read is asked again, alone.
                others = groups[index:] + ([(i,) for i in group] if len(group) > 1 else [])
                until_s = self._line.leaving_time_for(others, group, deadline_s)
                outcome |= yield from self._line.steps(group, group[0] in firm, until_s, goals)
                goals = b""
        if goals:
            self._line.send(goals)
        self._unasked = {i for i in firm if i not in outcome}
        missing = self._absent.note(outcome, self._clock.now())
        yield from self._ask_again([i for i in missing if i in firm], outcome, deadline_s)
        count_skipped(self._counters, asked, outcome)
        return self._readings(asked, outcome)

    def _ask_again(self, missing: list[int], outcome: dict[int, Outcome], deadline_s: float) -> Steps[None]:
        """Only what is missing, and only while there is time."""
        for _ in range(RETRIES):
            again: dict[int, Outcome] = {}
            for index, servo_id in enumerate(missing, 1):
                if self._line.has_time((servo_id,), deadline_s, RETRY_GAP_S):
                    self._counters.of(servo_id).retries += 1
                    until_s = self._line.leaving_time_for([(i,) for i in missing[index:]], (servo_id,), deadline_s)
                    again |= yield from self._line.steps((servo_id,), False, until_s)
            outcome |= again
            missing = self._absent.note(again, self._clock.now())

    def _readings(self, asked: tuple[int, ...], outcome: Mapping[int, Outcome]) -> Mapping[int, Reading]:
        """``readings_of``, but whom there was no time for is not said to be silent."""
        readings = readings_of(asked, outcome)
        for servo_id in self._unasked:
            if servo_id in readings:
                readings[servo_id] = fault(servo_id, "silent", "was not asked: the cycle was over")
        return readings

    def write_goals(self, goals: Mapping[int, ServoGoal]) -> None:
        if goals:
            self._line.send(self._goals_packet(goals))

    def _goals_packet(self, goals: Mapping[int, ServoGoal]) -> bytes:
        """One sync write; ValueError where a goal does not fit. No ramp: the trajectory above is smooth already."""
        data = {servo_id: self._goal_of[servo_id](goal) for servo_id, goal in goals.items()}
        return wire.sync_write(self._series.goal_address, self._series.goal_size, data) if data else b""

    def goal(self, servo_id: int) -> int:
        return self._read_surely(servo_id, self._series.goal_position)

    def position_limits(self, servo_id: int) -> tuple[int, int] | None:
        return self._limits(servo_id, self._series.position_limits)

    def torque_is_on(self, servo_id: int, deadline_s: float | None = None) -> bool:
        return self._read_surely(servo_id, self._series.torque_enable, deadline_s) == 1

    def torque_on(self, servo_id: int) -> None:
        self.write(servo_id, self._series.torque_enable, 1)

    def torque_off(self, servo_ids: Sequence[int]) -> list[ServoError]:
        # All at once first, so that nobody waits for a dead one's time-out; then each, acknowledged.
        register = self._series.torque_enable
        off = {servo_id: register.encode(0, self._series.byte_order) for servo_id in servo_ids}
        self._line.send(wire.sync_write(register.address, register.size, off))
        return tried_with_each(servo_ids, lambda servo_id: self.write(servo_id, register, 0))

    def limit_torque(self, servo_id: int, share: float) -> None:
        series = self._series
        wanted = round(share * series.full_torque)
        if series.torque_limit is not None:
            # What lasts stays the upper bound.
            lasting = self._read_surely(servo_id, series.max_torque)
            self._write_surely(servo_id, series.torque_limit, min(wanted, lasting))
        elif share < 1.0:
            raise ServoRefused(
                servo_id,
                f"has no torque limit that ends with the power: write {wanted} to {series.max_torque.name} (register "
                f"{series.max_torque.address}, EEPROM) and set torque_limit: 1.0 in the robot file",
            )

    @contextmanager
    def at_baud(self, baud: int) -> Iterator[ServoBus]:
        with port_at(self._port, self._clock, baud):
            yield ReadEachBus(self._port, self._clock, self._models, say_how_long=False)
        self._line.clean = False

    def close(self) -> None:
        self._port.close()
