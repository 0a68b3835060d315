"""Dynamixel servos of protocol 2.0 on one port: single-servo calls by the SDK, group transactions by us."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial

from drivers.burst import FIRST_REPLY_S
from drivers.bus import Reading, ServoBus, ServoGoal, ServoState
from drivers.clock import Clock
from drivers.counters import BusCounters
from drivers.dynamixel import state
from drivers.dynamixel.burst import BurstReader
from drivers.dynamixel.mapping import Maps
from drivers.dynamixel.models import MODELS, SERIES, series_of
from drivers.dynamixel.reader import StateReader
from drivers.dynamixel.series import ALARMED
from drivers.dynamixel.servo_calls import ServoCalls, Wire, dialect
from drivers.dynamixel.servos import Servos
from drivers.echo import Echo
from drivers.errors import ServoError, ServoRefused
from drivers.port import Port
from drivers.questions import Questions
from drivers.readings import Outcome, port_at, readings_of, refuse_stranger
from drivers.registers import ServoModel
from drivers.tries import tried
from drivers.turns import Steps, Wait, finish


class DynamixelBus(ServoCalls):
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
        self._counters = BusCounters()
        echo, servos = Echo(), Servos(self._models)
        self._burst = BurstReader(port, clock, echo, self._counters, servos)
        questions = Questions(port, clock, echo, self._counters, dialect(), self._disturb, self._burst.single_until_s)
        super().__init__(Wire(questions), servos, self._burst.send, position_p or {})
        self._maps = Maps(servos, self._single, port, clock)
        self._reader = StateReader(port, clock, self._burst, self._counters)

    @property
    def name(self) -> str:
        return self._port.name

    @property
    def baud(self) -> int:
        return self._port.baud

    @property
    def counters(self) -> BusCounters:
        return self._counters

    def _disturb(self) -> None:
        """Something else than a group read goes over the line, and may leave something on it."""
        self._burst.clean = False

    def identify(self, servo_id: int, model: ServoModel) -> None:
        refuse_stranger(servo_id, tried(partial(self._single.number, servo_id)), model, MODELS)
        self._servos.take_for(servo_id, model)
        self.check_settings(servo_id, model)
        self._maps.set_up(servo_id, model)

    def check_settings(self, servo_id: int, model: ServoModel) -> None:
        misfit = series_of(model).misfit(partial(self._read_surely, servo_id))
        if misfit:
            raise ServoRefused(servo_id, misfit)

    def read_states(self, servo_ids: Sequence[int], deadline_s: float | None = None) -> Mapping[int, Reading]:
        if deadline_s is not None:
            return finish(self.state_steps(servo_ids, deadline_s))
        asked = tuple(servo_ids)
        return self._readings(asked, self._reader.read(asked), math.inf)

    def state_steps(self, servo_ids: Sequence[int], deadline_s: float) -> Steps[Mapping[int, Reading]]:
        asked = tuple(servo_ids)
        turn = self._reader.ask(asked, b"", deadline_s)
        try:
            yield Wait.LAST
        except GeneratorExit:
            if turn.firm:
                self._burst.forsake()
            raise
        return self._readings(asked, self._reader.hear(turn, deadline_s), deadline_s)

    def exchange(
        self, goals: Mapping[int, ServoGoal], servo_ids: Sequence[int], deadline_s: float
    ) -> Mapping[int, Reading]:
        asked = tuple(servo_ids)
        outcome = self._reader.exchange(asked, self._goals(goals) if goals else b"", deadline_s)
        return self._readings(asked, outcome, deadline_s)

    def exchange_size(self, goals: Mapping[int, ServoGoal], servo_ids: Sequence[int]) -> int:
        ids = tuple(servo_ids)
        plan = (self._burst.plans.fast(ids) if self._burst.fast else None) or self._burst.plans.plan(ids)
        return len(self._goals(goals)) + len(plan.request) + plan.reply_size

    def _goals(self, goals: Mapping[int, ServoGoal]) -> bytes:
        """A sync write for each series. ValueError, and nothing is sent, where a goal does not fit."""
        series = self._servos.series
        kinds = {series(i) for i in goals}
        if len(kinds) == 1:
            return state.goals_packet(goals, kinds.pop())
        packets = [
            state.goals_packet({i: goal for i, goal in goals.items() if series(i) is kind}, kind)
            for kind in SERIES
            if kind in kinds
        ]
        return b"".join(packets)

    def _readings(
        self, asked: tuple[int, ...], outcome: Mapping[int, Outcome], deadline_s: float
    ) -> Mapping[int, Reading]:
        """``readings_of``, alarms by name. Then what the maps need, if there is time."""
        readings = readings_of(asked, outcome)
        for servo_id, reading in readings.items():
            if not isinstance(reading, ServoState):
                if reading.kind == "reset":
                    self._maps.lost(servo_id)
            elif reading.alarms == ALARMED:
                readings[servo_id] = self._named(servo_id, reading, deadline_s)
        if self._maps.busy or self._reader.missed:
            self._maps.watch(self._reader.proofs())
            self._maps.tend(outcome, deadline_s)
        return readings

    def _named(self, servo_id: int, reading: ServoState, deadline_s: float) -> ServoState:
        """With the names of its alarms, asked for while there is time: it is a transaction of its own."""
        if self._clock.now() + FIRST_REPLY_S / 4.0 >= deadline_s:
            return reading
        series = self._servos.series(servo_id)
        try:
            alarms = series.alarms(self._read_surely(servo_id, series.hardware_error_status, deadline_s))
        except ServoError:
            return reading
        return reading._replace(alarms=alarms or reading.alarms)

    def write_goals(self, goals: Mapping[int, ServoGoal]) -> None:
        self._burst.send(self._goals(goals))

    @contextmanager
    def at_baud(self, baud: int) -> Iterator[ServoBus]:
        with port_at(self._port, self._clock, baud):
            yield DynamixelBus(self._port, self._clock, self._models)
        self._burst.clean = False

    def close(self) -> None:
        self._port.close()
