"""The bus is one line of servos of one wire protocol: all calls that the layer above may make."""

import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Final

from drivers.bus.counters import BusCounters
from drivers.bus.group_read import GroupRead
from drivers.bus.identify import check_model_number, check_settings
from drivers.bus.indirect import IndirectMaps
from drivers.bus.known_servos import KnownServos
from drivers.bus.late_replies import HELD_S, LateReplies
from drivers.bus.retry import ATTEMPTS, retry
from drivers.bus.single_servo import SingleServo
from drivers.bus.state_reader import StateReader
from drivers.bus.turns import Turns
from drivers.bus.types import Reading, ServoGoal, ServoState
from drivers.clock import Clock
from drivers.errors import ServoError, ServoRefused
from drivers.port import Port
from drivers.port.line import Line
from drivers.protocol import v2
from drivers.servos import x
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import ALARMED, X
from drivers.servos.register import Register, ServoModel

LOG = logging.getLogger("servoloop.drivers")

_AT_ONCE: Final = 256  # bytes that are thrown away in one read


class Bus:
    """One transaction at a time, from one thread.

    Single-servo calls raise ServoError; every call raises PortLost once the line is gone. What set-up needs makes up
    for lost packets (drivers/bus/retry.py): ``identify``, ``goal``, ``position_limits``, ``torque_is_on``,
    ``limit_torque``, ``torque_off``. A cycle is ``request``, ``receive``, ``write_goals``.
    """

    def __init__(
        self,
        port: Port,
        clock: Clock,
        models: Mapping[int, ServoModel] | None = None,
        *,
        position_p: Mapping[int, int] | None = None,
        lent: bool = False,
    ) -> None:
        """``models`` by ID; ValueError where they cannot share a line. None: STS servos.

        ``position_p``: the position P gain of Dynamixels (by ID) that are not to have the factory's. It lives
        in RAM: it is written whenever the torque goes on. ``lent``: the port is another bus's, and ``close`` leaves it.
        """
        self._port, self._clock, self._lent = port, clock, lent
        self._position_p = dict(position_p or {})
        self._limits: dict[int, int] = {}
        self._turns: Turns | None = None
        """Those of servos in extended position mode, if there are any."""
        try:
            self._servos = servos = KnownServos(models or {})
        except ValueError as error:
            raise ValueError(f"{port.name}: {error}") from error
        self.counters = BusCounters()
        """What went wrong since the bus was opened, by servo and kind."""
        late, protocol = LateReplies(), servos.protocol
        self._line = line = Line(port, clock)
        self._reader = StateReader(line, GroupRead(line, protocol, self.counters, late), servos, self.counters, late)
        self._single = single = SingleServo(line, protocol, self.counters, late)
        self._maps = IndirectMaps(servos, single, port.name) if protocol.packets is v2 else None
        # What one servo is asked and told goes straight to the SDK, once.
        self.ping, self.read, self.write = single.ping, single.read, single.write
        self.reg_write, self.action, self.broadcast_ping = single.reg_write, single.action, single.broadcast_ping
        self.reboot, self.factory_reset, self.forget_turns = single.reboot, single.factory_reset, single.forget_turns

    @property
    def name(self) -> str:
        """The port's name."""
        return self._port.name

    @property
    def baud(self) -> int:
        """The rate of the line, in bits per second."""
        return self._port.baud

    @property
    def read_together(self) -> bool:
        """Whether one packet asks all servos for their states; otherwise each is asked by itself."""
        return self._servos.read_together

    def request(self, servo_ids: Sequence[int], deadline_s: float) -> None:
        """Ask for the states; ``receive`` waits for them until ``deadline_s`` on the bus's clock.

        Lines that are asked before any of them is waited for work at the same time. What was requested before and
        not received is abandoned.
        """
        self._reader.request(tuple(servo_ids), deadline_s)

    def receive(self) -> Mapping[int, Reading]:
        """The state of each servo that was asked, or its fault.

        What is missing is asked for again while there is time, and a servo known to be silent is not waited for in
        every cycle.
        """
        readings, deadline_s = self._reader.receive(), self._reader.deadline_s
        return readings if self._maps is None else self._look_after(readings, deadline_s)

    def write_goals(self, goals: Mapping[int, ServoGoal]) -> None:
        """A goal for each servo, in one packet that nobody acknowledges. ValueError where one does not fit."""
        if goals:
            self._line.tell(self._servos.goals(self._turns.goals(goals) if self._turns else goals))

    def read_states(self, servo_ids: Sequence[int], deadline_s: float | None = None) -> Mapping[int, Reading]:
        """``request`` and ``receive``; without a deadline every servo is waited for, which is not for a cycle."""
        if deadline_s is None:
            readings = self._reader.read_patiently(tuple(servo_ids))
            return readings if self._maps is None else self._look_after(readings, math.inf)
        self.request(servo_ids, deadline_s)
        return self.receive()

    def exchange_size(self, goals: Mapping[int, ServoGoal], servo_ids: Sequence[int]) -> int:
        """Bytes that a cycle with these goals and states puts on the wire, where nothing goes wrong."""
        return len(self._servos.goals(goals)) + self._reader.exchange_size(tuple(servo_ids))

    def _look_after(self, readings: Mapping[int, Reading], deadline_s: float) -> Mapping[int, Reading]:
        """Name the alarms, if there is time, and note who has lost the map of its indirect registers."""
        readings = self._turns.readings(readings) if self._turns else readings
        alarmed: dict[int, ServoState] = {}
        for servo_id, reading in readings.items():
            if isinstance(reading, ServoState):
                if reading.alarms == ALARMED:
                    alarmed[servo_id] = reading
            elif reading.kind == "reset" and self._maps is not None:
                self._maps.lost(servo_id)
        if not alarmed:
            return readings
        sources = {i: source for i in alarmed if (source := self._servos.series(i).hardware_error)}
        said = self._reader.registers({i: register for i, (register, _) in sources.items()}, deadline_s)
        named = {i: alarmed[i]._replace(alarms=sources[i][1](bits) or ALARMED) for i, bits in said.items()}
        return {**readings, **named}

    def identify(self, servo_id: int, model: ServoModel) -> None:
        """Raise ServoSilent or ServoRefused unless the servo is there, of this model and set up to be driven."""
        check_model_number(self._single, servo_id, model)
        self._servos.identified(servo_id, model)
        extended = self._is_extended(servo_id, model)
        if extended or self._turns:
            self._turns = self._turns or Turns()
            self._turns.identified(servo_id, model, extended)
        self.check_settings(servo_id, model)
        if self._maps is not None:
            self._maps.set_up(servo_id, model)

    def _is_extended(self, servo_id: int, model: ServoModel) -> bool:
        """Whether it is a Dynamixel X in extended position mode."""
        if series_of(model) is not X:
            return False
        return self._read_surely(servo_id, x.operating_mode) == x.EXTENDED_POSITION_MODE

    def check_settings(self, servo_id: int, model: ServoModel) -> None:
        """Raise ServoError unless it is set up to be driven, as a servo with this model's table is."""
        if warning := check_settings(self._single, servo_id, model):
            LOG.warning("%s: servo %d: %s", self.name, servo_id, warning)

    def goal(self, servo_id: int) -> int:
        """The goal position that the servo holds, in counts."""
        held = self._read_surely(servo_id, self._servos.series(servo_id).goal_position)
        return self._turns.goal(servo_id, held) if self._turns else held

    def position_limits(self, servo_id: int) -> tuple[int, int] | None:
        """The lowest and the highest goal that the servo's settings let it take, in counts.

        None where it has none: both 0 is a servo without such a setting, or a simulator's empty table. In extended
        position mode a servo does not look at them.
        """
        if self._turns and servo_id in self._turns:
            return None
        registers = self._servos.series(servo_id).position_limits
        lowest, highest = (self._read_surely(servo_id, register) for register in registers)
        return (lowest, highest) if (lowest, highest) != (0, 0) else None

    def torque_is_on(self, servo_id: int) -> bool:
        """Whether the servo drives its motor."""
        return self._read_surely(servo_id, self._servos.series(servo_id).torque_enable) == 1

    def torque_states(self, servo_ids: Sequence[int], deadline_s: float) -> dict[int, bool]:
        """Whether these servos drive their motors with the torque limit that they were given: a servo that was reset
        has another. As far as they answer by the deadline: one question and one attempt."""
        series = {i: self._servos.series(i) for i in servo_ids}
        held = self._reader.registers({i: one.torque_state for i, one in series.items()}, deadline_s)
        return {i: series[i].drives(value, self._limits.get(i)) for i, value in held.items()}

    def torque_on(self, servo_id: int) -> None:
        """Drive the motor. The caller has written the goal before.

        Told once: of a servo that does not acknowledge it nobody knows whether it was reset, and has its goal still.
        """
        if self._maps is not None:
            self._maps.restore(servo_id)
        series = self._servos.series(servo_id)
        for register, value in series.before_torque:
            self._write_surely(servo_id, register, value)
        if servo_id in self._position_p and series.position_p is not None:
            self._write_surely(servo_id, series.position_p, self._position_p[servo_id])
        self.write(servo_id, series.torque_enable, 1)

    def torque_off(self, servo_ids: Sequence[int]) -> list[ServoError]:
        """Let go of every servo, each tried whatever the others answer; returns what failed."""
        # All at once first, so that nobody waits for a dead one's time-out; then each, acknowledged, or else once more.
        if servo_ids:
            self._line.tell(self._servos.torque_off(servo_ids))
        failed: list[ServoError] = []
        for _ in range(ATTEMPTS):
            failed = []
            for servo_id in servo_ids:
                try:
                    self.write(servo_id, self._servos.series(servo_id).torque_enable, 0)
                except ServoError as error:
                    failed.append(error)
            servo_ids = [error.servo_id for error in failed]
        return failed

    def limit_torque(self, servo_id: int, share: float) -> None:
        """Limit the drive to a share (0 to 1) of full drive until power-off."""
        series = self._servos.series(servo_id)
        wanted, lasting, passing = round(share * series.full_torque), series.max_torque, series.torque_limit
        held, where = self._read_surely(servo_id, lasting), f"{lasting.name} (register {lasting.address}"
        # What lasts is the upper bound, and what a reset servo has: one less tells the two apart.
        limit = min(wanted, held - 1 if passing else held)
        if limit <= 0:
            raise ServoRefused(
                servo_id, f"would have no torque: {where}) is {held}, torque_limit {share:g}: raise what is too low"
            )
        if passing is not None:
            self._limits[servo_id] = limit
            self._write_surely(servo_id, passing, limit)
        elif share < 1.0:
            what = f"write {wanted} to {where}, EEPROM) and set torque_limit: 1.0 in the robot file"
            raise ServoRefused(servo_id, f"has no torque limit that ends with the power: {what}")

    def _read_surely(self, servo_id: int, register: Register) -> int:
        return retry(partial(self.read, servo_id, register))

    def _write_surely(self, servo_id: int, register: Register, value: int) -> None:
        """One register of RAM: written twice, it holds what it holds after once."""
        retry(partial(self.write, servo_id, register, value))

    @contextmanager
    def at_baud(self, baud: int, models: Mapping[int, ServoModel] | None = None) -> Iterator["Bus"]:
        """The same line at this rate, for these models, if any. Raises PortError where the adapter has no such rate.

        What is still on the way then is an answer to that bus's questions, and not to be heard at the next.
        """
        former = self._port.baud
        self._port.set_baud(baud)
        try:
            yield Bus(self._port, self._clock, models or self._servos.models, lent=True)
            self._let_pass()
        finally:
            self._port.set_baud(former)
            self._line.clean = False

    def _let_pass(self) -> None:
        """Throw away what comes until nothing comes any more, or somebody never stops."""
        end_s = self._line.now() + 4.0 * HELD_S
        while self._port.read(_AT_ONCE, min(self._line.now() + HELD_S, end_s)) and self._line.now() < end_s:
            pass

    def close(self) -> None:
        """Give the port back."""
        if not self._lent:
            self._port.close()
