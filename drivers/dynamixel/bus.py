"""Dynamixel servos of protocol 2.0 on one port: single-servo calls by the SDK, group transactions by us."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Final

from dynamixel_sdk import COMM_RX_CORRUPT, COMM_SUCCESS, Protocol2PacketHandler

from drivers.absent import AbsenceWatch
from drivers.burst import BITS_PER_BYTE, FIRST_REPLY_S, TRIED_GAP_S
from drivers.bus import Reading, ServoBus, ServoGoal, ServoState
from drivers.clock import Clock
from drivers.counters import BusCounters
from drivers.dynamixel import state, wire
from drivers.dynamixel.burst import BurstReader
from drivers.dynamixel.models import MODELS, SERIES, Series, X, series_of
from drivers.echo import Echo
from drivers.errors import ServoCorrupt, ServoError, ServoRefused, ServoSilent
from drivers.port import Port
from drivers.readings import RETRIES, Outcome, count_skipped, port_at, readings_of, refuse_stranger
from drivers.registers import Register, ServoModel
from drivers.sdk_port import SdkPort
from drivers.turns import Steps, finish

_ORDER: Final = "little"


class _SeriesById(dict[int, Series]):
    """By a servo's ID; the X series for who is not known."""

    def __missing__(self, servo_id: int) -> Series:
        self[servo_id] = X
        return X


class DynamixelBus:
    """A ServoBus of Dynamixels that speak protocol 2.0, in position mode."""

    def __init__(
        self,
        port: Port,
        clock: Clock,
        models: Mapping[int, ServoModel] | None = None,
        *,
        position_p: Mapping[int, int] | None = None,
    ) -> None:
        """``models`` by ID; who is not among them is taken to be of the X series until it is identified.

        ``position_p``: the position P gain of servos (by ID) that are not to have the factory's. It lives
        in RAM: it is written whenever the torque goes on.
        """
        self._port = port
        self._clock = clock
        self._models = dict(models or {})
        self._position_p = dict(position_p or {})
        self._counters = BusCounters()
        self._echo = Echo()
        self._series = _SeriesById({i: series_of(model) for i, model in self._models.items()})
        self._burst = BurstReader(port, clock, self._echo, self._counters, self._series)
        self._fast_tried = False
        self._absent = AbsenceWatch()
        self._queue: list[int] = []  # of those that did not answer last time, in the order to try them
        self._sdk_port = SdkPort(port, clock, self._echo)
        self._sdk = Protocol2PacketHandler()

    @property
    def name(self) -> str:
        return self._port.name

    @property
    def counters(self) -> BusCounters:
        return self._counters

    def identify(self, servo_id: int, model: ServoModel) -> None:
        self._burst.clean = False
        number, result, _ = self._sdk.ping(self._sdk_port, servo_id)
        _raise_for(servo_id, result)
        refuse_stranger(servo_id, number, model, MODELS)
        self._take_for(servo_id, series_of(model))
        misfit = self._series[servo_id].misfit(lambda register: self.read(servo_id, register))
        if misfit:
            raise ServoRefused(servo_id, misfit)

    def _take_for(self, servo_id: int, series: Series) -> None:
        """What the servo is has been seen."""
        if self._series[servo_id] is not series:
            self._series[servo_id] = series
            self._burst.replan()

    def read(self, servo_id: int, register: Register) -> int:
        # Not the SDK's readTxRx: of a reply that is too short, it takes the checksum for data.
        request = [0, 0, 0, 0, servo_id, 7, 0, wire.READ, *wire.span(register.address, register.size), 0, 0]
        reply = self._asked_alone(servo_id, request)
        data = bytes(reply[9 : reply[5] + (reply[6] << 8) + 5])
        if len(data) != register.size:
            raise ServoCorrupt(servo_id, f"answered {len(data)} bytes for {register.name}")
        return register.decode(data, _ORDER)

    def write(self, servo_id: int, register: Register, value: int) -> None:
        data = list(register.encode(value, _ORDER))
        self._burst.clean = False
        result, error = self._sdk.writeTxRx(self._sdk_port, servo_id, register.address, register.size, data)
        _raise_for(servo_id, result, error)

    def _asked_alone(self, servo_id: int, request: list[int]) -> Any:
        self._burst.clean = False
        reply, result, error = self._sdk.txRxPacket(self._sdk_port, request)
        _raise_for(servo_id, result, error)
        return reply

    def read_states(self, servo_ids: Sequence[int], deadline_s: float | None = None) -> dict[int, Reading]:
        if deadline_s is not None:
            return finish(self.state_steps(servo_ids, deadline_s))
        # Whether a servo waits in vain for one before it that is silent, the manual does not say. So those
        # that were missing are asked last, and whoever may have waited in vain is asked once more.
        asked = tuple(servo_ids)
        firm, tried = self._absent.split(asked, math.inf)
        outcome = dict(self._burst.read(firm + self._queued(tried), (), math.inf)) if asked else {}
        behind = tuple(i for i in self._note(outcome)[:-1] if i in firm)
        if behind:
            for servo_id in behind:
                self._counters.of(servo_id).retries += 1
            again = self._burst.read(behind, (), math.inf)
            self._note(again)
            outcome.update(again)
        if asked and not self._fast_tried and not self._absent and self._burst.clean:
            self._try_fast(asked)
        return self._readings(asked, outcome)

    def _try_fast(self, servo_ids: tuple[int, ...]) -> None:
        """Once a bus, when all have just answered, and outside of a cycle: can they be read fast?"""
        if self._burst.fast_plan(servo_ids) is None:
            return
        self._fast_tried = True
        self._burst.try_fast(servo_ids)

    def state_steps(self, servo_ids: Sequence[int], deadline_s: float) -> Steps[dict[int, Reading]]:
        asked = tuple(servo_ids)
        firm, tried = self._ask(asked, b"")
        yield
        return self._hear(asked, firm, tried, deadline_s)

    def exchange(
        self, goals: Mapping[int, ServoGoal], servo_ids: Sequence[int], deadline_s: float
    ) -> dict[int, Reading]:
        asked = tuple(servo_ids)
        firm, tried = self._ask(asked, self._goals(goals) if goals else b"")
        return self._hear(asked, firm, tried, deadline_s)

    def exchange_size(self, servo_ids: Sequence[int]) -> int:
        ids = tuple(servo_ids)
        plan = (self._burst.fast_plan(ids) if self._burst.fast else None) or self._burst.plan(ids)
        return len(self._goals({i: ServoGoal(0) for i in ids})) + len(plan.request) + plan.reply_size

    def _goals(self, goals: Mapping[int, ServoGoal]) -> bytes:
        """A sync write for each series. ValueError, and nothing is sent, where a goal does not fit."""
        kinds = {self._series[i] for i in goals}
        if len(kinds) == 1:
            return state.goals_packet(goals, kinds.pop())
        packets = [
            state.goals_packet({i: goal for i, goal in goals.items() if self._series[i] is kind}, kind)
            for kind in SERIES
            if kind in kinds
        ]
        return b"".join(packets)

    def _ask(self, asked: tuple[int, ...], goals: bytes) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Send the goals and the question; who surely answers, and who is only tried."""
        firm, tried = self._absent.split(asked, self._clock.now())
        tried = self._queued(tried)
        # Not while somebody is missing: one who is silent would hide those behind it.
        fast = bool(firm) and not tried
        if not firm:
            # Where nobody is expected to answer, the adapter may be the slow one: the whole first wait.
            firm, tried = tried, ()
        if firm:
            self._burst.ask(firm, tried, goals, fast=fast)
        elif goals:
            self._burst.send(goals)
        return firm, tried

    def _hear(
        self, asked: tuple[int, ...], firm: tuple[int, ...], tried: tuple[int, ...], deadline_s: float
    ) -> dict[int, Reading]:
        outcome = dict(self._burst.hear(firm, tried, deadline_s)) if firm else {}
        count_skipped(self._counters, asked, outcome)
        if not (self._burst.clean and firm == asked):
            self._ask_again([i for i in self._note(outcome) if i in firm], outcome, deadline_s)
        elif self._absent:
            self._note(outcome)
        return self._readings(asked, outcome, deadline_s)

    def _ask_again(self, missing: list[int], outcome: dict[int, Outcome], deadline_s: float) -> None:
        """Only what is missing, and only while there is time."""
        for _ in range(RETRIES):
            if not missing or not self._has_time(missing, deadline_s):
                return
            for servo_id in missing:
                self._counters.of(servo_id).retries += 1
            again = self._burst.read((), tuple(missing), deadline_s)
            outcome.update(again)
            missing = self._note(again)

    def _has_time(self, servo_ids: Sequence[int], deadline_s: float) -> bool:
        """Whether those can be asked again and waited for."""
        # Also for the question, which is no longer than one more reply.
        size = (state.STATE_SIZE + 2 * wire.OVERHEAD) * (len(servo_ids) + 1)
        return self._clock.now() + size * BITS_PER_BYTE / self._port.baud + TRIED_GAP_S < deadline_s

    def _note(self, outcome: Mapping[int, Outcome]) -> list[int]:
        """Who has given no state. The first of them may hide the others: it goes to the end of the queue."""
        missing = self._absent.note(outcome, self._clock.now())
        missing = missing[1:] + missing[:1]
        self._queue = [i for i in self._queue if i not in outcome] + missing
        return missing

    def _queued(self, servo_ids: tuple[int, ...]) -> tuple[int, ...]:
        """Those that were missing in the order in which to try them."""
        return tuple(i for i in self._queue if i in servo_ids)

    def _readings(
        self, asked: tuple[int, ...], outcome: Mapping[int, Outcome], deadline_s: float = math.inf
    ) -> dict[int, Reading]:
        """``readings_of``, alarms by name."""
        readings = readings_of(asked, outcome)
        for servo_id, reading in readings.items():
            if isinstance(reading, ServoState) and reading.alarms:
                readings[servo_id] = self._named(servo_id, reading, deadline_s)
        return readings

    def _named(self, servo_id: int, reading: ServoState, deadline_s: float) -> ServoState:
        """With the names of its alarms, asked for while there is time: it is a transaction of its own."""
        if self._clock.now() + FIRST_REPLY_S / 4.0 >= deadline_s:
            return reading
        self._sdk_port.latest_s = deadline_s
        try:
            series = self._series[servo_id]
            alarms = series.alarms(self.read(servo_id, series.hardware_error_status))
        except ServoError:
            return reading
        finally:
            self._sdk_port.latest_s = math.inf
        return reading._replace(alarms=alarms or reading.alarms)

    def write_goals(self, goals: Mapping[int, ServoGoal]) -> None:
        self._burst.send(self._goals(goals))

    def goal(self, servo_id: int) -> int:
        return self.read(servo_id, self._series[servo_id].goal_position)

    def torque_is_on(self, servo_id: int) -> bool:
        return self.read(servo_id, self._series[servo_id].torque_enable) == 1

    def torque_on(self, servo_id: int) -> None:
        series = self._series[servo_id]
        for register, value in series.before_torque:
            self.write(servo_id, register, value)
        if servo_id in self._position_p:
            self.write(servo_id, series.position_p, self._position_p[servo_id])
        self.write(servo_id, series.torque_enable, 1)

    def torque_off(self, servo_ids: Sequence[int]) -> list[ServoError]:
        # All at once first, so that nobody waits for a dead one's time-out; then each, acknowledged.
        for kind in SERIES:
            register = kind.torque_enable
            off = {i: register.encode(0, _ORDER) for i in servo_ids if self._series[i] is kind}
            if off:
                self._burst.send(wire.sync_write(register.address, register.size, off))
        failed: list[ServoError] = []
        for servo_id in servo_ids:
            try:
                self.write(servo_id, self._series[servo_id].torque_enable, 0)
            except ServoError as error:
                failed.append(error)
        return failed

    def limit_torque(self, servo_id: int, share: float) -> None:
        # Beyond its ceiling the servo would refuse.
        series = self._series[servo_id]
        limit = self.read(servo_id, series.torque_ceiling)
        self.write(servo_id, series.torque_limit, min(round(share * series.full_torque), limit))

    @contextmanager
    def at_baud(self, baud: int) -> Iterator[ServoBus]:
        with port_at(self._port, baud):
            yield DynamixelBus(self._port, self._clock, self._models)
        self._burst.clean = False

    def close(self) -> None:
        self._port.close()


def _raise_for(servo_id: int, result: int, error: int = 0) -> None:
    """Turn the SDK's result code and the reply's error number into an error.

    The alert bit is no failure: alarms are states.
    """
    if result == COMM_RX_CORRUPT:
        raise ServoCorrupt(servo_id, "answered with a broken packet: check the cable's plugs")
    if result != COMM_SUCCESS:
        raise ServoSilent(servo_id, "does not answer: check its power and cable, its ID and the baud rate")
    number = error & ~wire.ALERT
    if number:
        raise ServoRefused(servo_id, wire.ERRORS.get(number, f"answered error {number}"))
