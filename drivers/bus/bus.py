"""Interface to all servos on one serial bus."""

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

_DRAIN_SIZE: Final = 256  # maximum number of bytes that are discarded in one read


class Bus:
    """All servos on one serial bus. They share one wire protocol. Use a bus from one thread only.

    A control cycle calls ``request``, ``receive`` and ``write_goals``. Calls to a single servo raise ServoError. All
    calls raise PortLost after the port has disappeared. The calls for set-up repeat lost requests: ``identify``,
    ``goal``, ``position_limits``, ``torque_is_on``, ``limit_torque`` and ``torque_off``.
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
        """Create a bus on an open port.

        Args:
            port: The port.
            clock: Clock of all deadlines.
            models: Model of each servo, by ID; STS servos by default.
            position_p: Position P gains of Dynamixel servos, by ID, written to RAM each time torque is enabled.
            lent: Whether the port belongs to another bus; ``close`` then leaves it open.

        Raises:
            ValueError: The models cannot share a bus.
        """
        self._port, self._clock, self._lent = port, clock, lent
        self._position_p = dict(position_p or {})
        self._limits: dict[int, int] = {}
        self._turns: Turns | None = None
        """Whole turns of the servos in extended position mode. None if there are no such servos."""
        try:
            self._servos = servos = KnownServos(models or {})
        except ValueError as error:
            raise ValueError(f"{port.name}: {error}") from error
        self.counters = BusCounters()
        """Replies and faults since the bus was opened, by servo and kind."""
        late, protocol = LateReplies(), servos.protocol
        self._line = line = Line(port, clock)
        self._reader = StateReader(line, GroupRead(line, protocol, self.counters, late), servos, self.counters, late)
        self._single = single = SingleServo(line, protocol, self.counters, late)
        self._maps = IndirectMaps(servos, single, port.name) if protocol.packets is v2 else None
        # These requests to single servos are passed to the SDK without retries.
        self.ping, self.read, self.write = single.ping, single.read, single.write
        self.reg_write, self.action, self.broadcast_ping = single.reg_write, single.action, single.broadcast_ping
        self.reboot, self.factory_reset, self.forget_turns = single.reboot, single.factory_reset, single.forget_turns

    @property
    def name(self) -> str:
        """Name of the port."""
        return self._port.name

    @property
    def baud(self) -> int:
        """Baud rate, in bits per second."""
        return self._port.baud

    @property
    def read_together(self) -> bool:
        """Whether one packet requests the states of all servos. Otherwise each servo gets a request of its own."""
        return self._servos.read_together

    def request(self, servo_ids: Sequence[int], deadline_s: float) -> None:
        """Request servo states without waiting. Request all buses before you receive the first, so that they overlap.

        A previous request that was not received is abandoned.

        Args:
            servo_ids: The servos.
            deadline_s: Time on the clock until which ``receive`` waits.
        """
        self._reader.request(tuple(servo_ids), deadline_s)

    def receive(self) -> Mapping[int, Reading]:
        """Wait for the requested states. Return the state or the fault of each servo, by ID.

        Missing states are requested again if there is time. A servo known to be silent is not asked in every cycle.
        """
        readings, deadline_s = self._reader.receive(), self._reader.deadline_s
        return readings if self._maps is None else self._name_alarms(readings, deadline_s)

    def write_goals(self, goals: Mapping[int, ServoGoal]) -> None:
        """Write the goals of several servos, by ID, in one packet. Servos do not acknowledge it.

        Raises:
            ValueError: A goal does not fit its register. No goal is written.
        """
        if goals:
            self._line.send(self._servos.goals(self._turns.goals(goals) if self._turns else goals))

    def read_states(self, servo_ids: Sequence[int], deadline_s: float | None = None) -> Mapping[int, Reading]:
        """Request and receive servo states.

        Args:
            servo_ids: The servos.
            deadline_s: Time on the clock until which to wait; None waits for every servo, too long for a control cycle.

        Returns:
            The state or the fault of each servo, by ID.
        """
        if deadline_s is None:
            readings = self._reader.read_without_deadline(tuple(servo_ids))
            return readings if self._maps is None else self._name_alarms(readings, math.inf)
        self.request(servo_ids, deadline_s)
        return self.receive()

    def exchange_size(self, goals: Mapping[int, ServoGoal], servo_ids: Sequence[int]) -> int:
        """Return the number of bytes that a control cycle without faults sends and receives."""
        return len(self._servos.goals(goals)) + self._reader.exchange_size(tuple(servo_ids))

    def _name_alarms(self, readings: Mapping[int, Reading], deadline_s: float) -> Mapping[int, Reading]:
        """Read which hardware errors the servos have, if there is time, and record servos that were reset."""
        readings = self._turns.readings(readings) if self._turns else readings
        alarmed: dict[int, ServoState] = {}
        for servo_id, reading in readings.items():
            if isinstance(reading, ServoState):
                if reading.alarms == ALARMED:
                    alarmed[servo_id] = reading
            elif reading.kind == "reset" and self._maps is not None:
                self._maps.mark_lost(servo_id)
        if not alarmed:
            return readings
        sources = {i: source for i in alarmed if (source := self._servos.series(i).hardware_error)}
        error_bits = self._reader.registers({i: register for i, (register, _) in sources.items()}, deadline_s)
        named = {i: alarmed[i]._replace(alarms=sources[i][1](bits) or ALARMED) for i, bits in error_bits.items()}
        return {**readings, **named}

    def identify(self, servo_id: int, model: ServoModel) -> None:
        """Check that a servo answers, is of this model and has usable settings.

        Raises:
            ServoSilent: The servo does not answer.
            ServoRefused: The servo is of a different model, or must not be used with its settings.
        """
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
        if series_of(model) is not X:
            return False
        return self._read_with_retries(servo_id, x.operating_mode) == x.EXTENDED_POSITION_MODE

    def check_settings(self, servo_id: int, model: ServoModel) -> None:
        """Check that the settings of a servo with this model's control table are usable. Raise ServoError otherwise."""
        if warning := check_settings(self._single, servo_id, model):
            LOG.warning("%s: servo %d: %s", self.name, servo_id, warning)

    def goal(self, servo_id: int) -> int:
        """Return the goal position of a servo, in counts."""
        held = self._read_with_retries(servo_id, self._servos.series(servo_id).goal_position)
        return self._turns.goal(servo_id, held) if self._turns else held

    def position_limits(self, servo_id: int) -> tuple[int, int] | None:
        """Return the lowest and the highest goal that the servo's settings allow, in counts.

        The result is None if both registers are 0, as in a simulator's empty table, and for servos in extended
        position mode, which ignore these registers.
        """
        if self._turns and servo_id in self._turns:
            return None
        registers = self._servos.series(servo_id).position_limits
        lowest, highest = (self._read_with_retries(servo_id, register) for register in registers)
        return (lowest, highest) if (lowest, highest) != (0, 0) else None

    def torque_is_on(self, servo_id: int) -> bool:
        """Return whether the servo's torque is enabled."""
        return self._read_with_retries(servo_id, self._servos.series(servo_id).torque_enable) == 1

    def torque_states(self, servo_ids: Sequence[int], deadline_s: float) -> dict[int, bool]:
        """Return whether each servo has torque enabled with the torque limit that ``limit_torque`` wrote.

        A servo that was reset has a different limit. Servos that do not reply before the deadline are left out.
        """
        series = {i: self._servos.series(i) for i in servo_ids}
        held = self._reader.registers({i: one.torque_state for i, one in series.items()}, deadline_s)
        return {i: series[i].drives(value, self._limits.get(i)) for i, value in held.items()}

    def torque_on(self, servo_id: int) -> None:
        """Enable torque. The goal must be written before this call.

        The write is not repeated: a servo that does not acknowledge it may have been reset and have lost its goal.
        """
        if self._maps is not None:
            self._maps.restore(servo_id)
        series = self._servos.series(servo_id)
        for register, value in series.before_torque:
            self._write_with_retries(servo_id, register, value)
        if servo_id in self._position_p and series.position_p is not None:
            self._write_with_retries(servo_id, series.position_p, self._position_p[servo_id])
        self.write(servo_id, series.torque_enable, 1)

    def torque_off(self, servo_ids: Sequence[int]) -> list[ServoError]:
        """Disable torque of all these servos and return the errors of those that failed."""
        # A packet to all servos comes first, so that no servo waits for another's timeout. Acknowledged writes follow.
        if servo_ids:
            self._line.send(self._servos.torque_off(servo_ids))
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
        """Limit the torque of a servo to a share (0 to 1) of its full torque until power-off.

        Raises:
            ServoRefused: The servo would have no torque, or it has no torque limit in RAM.
        """
        series = self._servos.series(servo_id)
        wanted, persistent, volatile = round(share * series.full_torque), series.max_torque, series.torque_limit
        held, where = self._read_with_retries(servo_id, persistent), f"{persistent.name} (register {persistent.address}"
        # The persistent limit is the upper bound and returns after a reset. One less shows whether the servo was reset.
        limit = min(wanted, held - 1 if volatile else held)
        if limit <= 0:
            raise ServoRefused(
                servo_id,
                f"would have no torque: {where}) is {held}, torque_limit is {share:g}: increase one of them",
            )
        if volatile is not None:
            self._limits[servo_id] = limit
            self._write_with_retries(servo_id, volatile, limit)
        elif share < 1.0:
            what = f"write {wanted} to {where}, EEPROM) and set torque_limit: 1.0 in the robot file"
            raise ServoRefused(servo_id, f"has no torque limit in RAM: {what}")

    def _read_with_retries(self, servo_id: int, register: Register) -> int:
        return retry(partial(self.read, servo_id, register))

    def _write_with_retries(self, servo_id: int, register: Register, value: int) -> None:
        retry(partial(self.write, servo_id, register, value))

    @contextmanager
    def at_baud(self, baud: int, models: Mapping[int, ServoModel] | None = None) -> Iterator["Bus"]:
        """Use the port at a different baud rate within a ``with`` block.

        Args:
            baud: Baud rate, in bits per second.
            models: Model of each servo at this rate, by ID; the models of this bus by default.

        Raises:
            PortError: The adapter does not support this rate.
        """
        former = self._port.baud
        self._port.set_baud(baud)
        try:
            yield Bus(self._port, self._clock, models or self._servos.models, lent=True)
            self._drain()
        finally:
            self._port.set_baud(former)
            self._line.clean = False

    def _drain(self) -> None:
        """Discard replies that are still arriving, for a limited time."""
        end_s = self._line.now() + 4.0 * HELD_S
        while self._port.read(_DRAIN_SIZE, min(self._line.now() + HELD_S, end_s)) and self._line.now() < end_s:
            pass

    def close(self) -> None:
        """Close the port, unless it belongs to another bus."""
        if not self._lent:
            self._port.close()
