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
from drivers.bus.late_replies import HELD_S, LateReplyFilter
from drivers.bus.retry import ATTEMPTS, retry
from drivers.bus.separate import SeparateServos
from drivers.bus.single_servo import SingleServo
from drivers.bus.state_reader import StateReader
from drivers.bus.turns import Turns
from drivers.clock import Clock
from drivers.driver_errors import ServoError, ServoRefused
from drivers.port import Port
from drivers.port.line import Line
from drivers.protocol import v2
from drivers.servos import x
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import ALARMED, X
from drivers.servos.register import Register, ServoModel
from drivers.types import Reading, ServoGoal, ServoState

LOG = logging.getLogger("servoloop.drivers")

_DRAIN_SIZE: Final = 256  # maximum number of bytes to discard in one read


class Bus:
    """All servos on one serial bus. The servos share one wire protocol. Use a bus from one thread only.

    A control cycle calls ``request``, ``receive`` and ``write_goals``. Calls to a single servo raise ServoError. All
    calls raise PortLost once the port has disappeared. The setup calls repeat lost requests: ``identify``, ``goal``,
    ``position_limits``, ``torque_is_on``, ``limit_torque`` and ``torque_off``.
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
        """Create a bus on a port.

        Args:
            port: The line.
            clock: Clock for the deadlines.
            models: Servo models, keyed by ID. If None, all servos are STS servos.
            position_p: Position P gains, keyed by ID, for Dynamixels whose gain differs from the factory value. The
                gain is in RAM, so it is written whenever torque is enabled.
            lent: Whether the port belongs to another bus. ``close`` then leaves it open.

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
        """Replies and faults since the bus was opened, by servo and type."""
        late, protocol = LateReplyFilter(), servos.protocol
        self._line = line = Line(port, clock)
        group = GroupRead(line, protocol, self.counters, late)
        self._reader = StateReader(line, group, servos, self.counters, late)
        self._separate = SeparateServos(line, servos, self._reader, group, self.counters)
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
        """Whether one packet requests the states of all servos. Otherwise a separate request is sent to each servo."""
        return self._servos.read_together

    def request(self, servo_ids: Sequence[int], deadline_s: float) -> None:
        """Request the states of servos. ``receive`` waits for the replies.

        Request the states on all buses before you receive from any of them, so that all buses transfer data
        simultaneously. An earlier request whose replies have not been received is abandoned.

        Args:
            servo_ids: IDs of the servos.
            deadline_s: Time until which ``receive`` waits, in seconds on the bus's clock.
        """
        self._reader.request(tuple(servo_ids), deadline_s)

    def receive(self) -> Mapping[int, Reading]:
        """Receive the requested states.

        Missing replies are requested again if there is time. A servo that is known to be silent is not asked in every
        cycle.

        Returns:
            The state of each requested servo, or its fault, keyed by ID.
        """
        readings, deadline_s = self._reader.receive(), self._reader.deadline_s
        return readings if self._maps is None else self._name_alarms(readings, deadline_s)

    def write_goals(self, goals: Mapping[int, ServoGoal]) -> None:
        """Send the goals of all servos in one packet, which is not acknowledged.

        Each servo that does not support group writes gets a separate packet and acknowledges it.

        Args:
            goals: Goals, keyed by ID, in counts.

        Raises:
            ValueError: A goal does not fit into its register.
        """
        if goals:
            counted = self._turns.goals(goals) if self._turns else goals
            if packet := self._servos.goals(counted):
                self._line.send(packet)
            if self._servos.written_alone:
                for servo_id in self._servos.written_alone.intersection(counted):
                    self._separate.write_goal(servo_id, counted[servo_id])

    def write_unacknowledged(self, servo_id: int, register: Register, value: int) -> None:
        """Write a register of one servo with a packet that is not acknowledged, so that no cycle waits for a reply.

        Args:
            servo_id: ID of the servo.
            register: The register.
            value: Raw value.

        Raises:
            ValueError: The servo would reject the value.
        """
        register.check(value)
        protocol = self._servos.protocol
        entry = bytes([servo_id]) + register.encode(value, self._servos.model(servo_id).byte_order)
        self._line.send(protocol.packets.sync_write(register.address, register.size, entry))

    def read_registers(self, registers: Mapping[int, Register], deadline_s: float) -> dict[int, int]:
        """Read one register of each servo once.

        Args:
            registers: Registers, keyed by ID.
            deadline_s: Time to stop waiting, in seconds on the bus's clock.

        Returns:
            The raw values, keyed by ID. Servos that did not respond are missing.
        """
        return self._reader.registers(registers, deadline_s)

    def read_states(self, servo_ids: Sequence[int], deadline_s: float | None = None) -> Mapping[int, Reading]:
        """Request and receive the states of servos.

        Args:
            servo_ids: IDs of the servos.
            deadline_s: Time to stop waiting, in seconds on the bus's clock. If None, the call waits for every servo; do
                not use None in a control cycle.

        Returns:
            The state of each servo, or its fault, keyed by ID.
        """
        if deadline_s is None:
            readings = self._reader.read_without_deadline(tuple(servo_ids))
            if self._separate.found(readings):
                readings = self._reader.read_without_deadline(tuple(servo_ids))
            self._separate.report(servo_ids)
            return readings if self._maps is None else self._name_alarms(readings, math.inf)
        self.request(servo_ids, deadline_s)
        return self.receive()

    def exchange_size(self, goals: Mapping[int, ServoGoal], servo_ids: Sequence[int]) -> int:
        """Return the number of bytes of a cycle without errors.

        Args:
            goals: Goals to write, keyed by ID.
            servo_ids: IDs of the servos whose states to read.

        Returns:
            Number of bytes on the wire, including requests and replies.
        """
        written = len(self._servos.goals(goals)) + self._separate.size(goals)
        return written + self._reader.exchange_size(tuple(servo_ids))

    def needs_single_reads(self, servo_id: int) -> bool:
        """Determine whether a servo answers single reads but not group reads.

        Such a servo is then read and written separately.

        Args:
            servo_id: ID of the servo.

        Returns:
            Whether this servo does not support group reads.
        """
        return self._separate.examine(servo_id)

    def write_goals_alone(self, servo_ids: Sequence[int], alone: bool = True) -> None:
        """Switch servos to separate, acknowledged goal writes, or back to group writes.

        Args:
            servo_ids: IDs of the servos.
            alone: Whether each servo gets a separate packet.
        """
        for servo_id in servo_ids:
            self._servos.set_written_alone(servo_id, alone)

    def _name_alarms(self, readings: Mapping[int, Reading], deadline_s: float) -> Mapping[int, Reading]:
        """Read the hardware errors of the servos if there is time, and record servos that were reset."""
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
        """Check that a servo responds, is the expected model, and is configured so that it can be driven.

        Args:
            servo_id: ID of the servo.
            model: Expected model.

        Raises:
            ServoSilent: The servo does not respond.
            ServoRefused: The servo is a different model, or its settings do not allow it to be driven.
        """
        check_model_number(self._single, servo_id, model)
        self._servos.identified(servo_id, model)
        self._separate.identified(servo_id)
        extended = self._is_extended(servo_id, model)
        if extended or self._turns:
            self._turns = self._turns or Turns()
            self._turns.identified(servo_id, model, extended, self._held(servo_id) if extended else None)
        self.check_settings(servo_id, model)
        if self._maps is not None:
            self._maps.set_up(servo_id, model)

    def _is_extended(self, servo_id: int, model: ServoModel) -> bool:
        if series_of(model) is not X:
            return False
        return self._read_with_retries(servo_id, x.operating_mode) in x.MODES_WITH_TURNS

    def _held(self, servo_id: int) -> int | None:
        """Return the goal of an X servo with all its turns, in counts, or None if the torque is disabled."""
        enabled = self._read_with_retries(servo_id, x.torque_enable)
        return self._read_with_retries(servo_id, x.goal_position) if enabled else None

    def check_settings(self, servo_id: int, model: ServoModel) -> None:
        """Check that the settings of a servo allow it to be driven.

        Args:
            servo_id: ID of the servo.
            model: Model whose control table the servo uses.

        Raises:
            ServoError: The servo does not respond, or a setting does not allow it to be driven.
        """
        if warning := check_settings(self._single, servo_id, model):
            LOG.warning("%s: servo %d: %s", self.name, servo_id, warning)

    def goal(self, servo_id: int) -> int:
        """Read the goal position of a servo.

        Args:
            servo_id: ID of the servo.

        Returns:
            The goal position, in counts.
        """
        held = self._read_with_retries(servo_id, self._servos.series(servo_id).goal_position)
        return self._turns.goal(servo_id, held) if self._turns else held

    def position_limits(self, servo_id: int) -> tuple[int, int] | None:
        """Read the configured position limits of a servo.

        Args:
            servo_id: ID of the servo.

        Returns:
            The lowest and the highest goal, in counts. None if there are no limits: the servo has no such setting, both
            limits are 0 (as in a simulator), or the servo ignores the limits in a multi-turn mode.
        """
        if self._turns and servo_id in self._turns:
            return None
        registers = self._servos.series(servo_id).position_limits
        lowest, highest = (self._read_with_retries(servo_id, register) for register in registers)
        return (lowest, highest) if (lowest, highest) != (0, 0) else None

    def torque_is_on(self, servo_id: int) -> bool:
        """Read whether the torque of a servo is enabled.

        Args:
            servo_id: ID of the servo.

        Returns:
            Whether the servo drives its motor.
        """
        return self._read_with_retries(servo_id, self._servos.series(servo_id).torque_enable) == 1

    def torque_states(self, servo_ids: Sequence[int], deadline_s: float) -> dict[int, bool]:
        """Read whether servos drive their motors with the configured torque limit.

        After a reset, a servo has a different torque limit. The request is sent once, without retries.

        Args:
            servo_ids: IDs of the servos.
            deadline_s: Time to stop waiting, in seconds on the bus's clock.

        Returns:
            Whether each servo drives its motor, keyed by ID. Servos that did not answer are missing.
        """
        series = {i: self._servos.series(i) for i in servo_ids}
        held = self._reader.registers({i: one.torque_state for i, one in series.items()}, deadline_s)
        return {i: series[i].drives(value, self._limits.get(i)) for i, value in held.items()}

    def prepare_torque(self, servo_id: int) -> None:
        """Write the registers that a servo needs before its torque is enabled.

        Lost requests are repeated, which takes up to a second each. If the joint is limp, measure its position after
        this call.

        Args:
            servo_id: ID of the servo.
        """
        if self._maps is not None:
            self._maps.restore(servo_id)
        series = self._servos.series(servo_id)
        for register, value in series.before_torque:
            self._write_with_retries(servo_id, register, value)
        if servo_id in self._position_p and series.position_p is not None:
            self._write_with_retries(servo_id, series.position_p, self._position_p[servo_id])

    def torque_on(self, servo_id: int, *, prepared: bool = False) -> None:
        """Enable the torque of a servo. Write its goal first.

        The torque switch is written only once. A servo that does not acknowledge this write may have been reset, and
        may have lost its goal.

        Args:
            servo_id: ID of the servo.
            prepared: Whether ``prepare_torque`` was called before writing the goal.
        """
        if not prepared:
            self.prepare_torque(servo_id)
        self.write(servo_id, self._servos.series(servo_id).torque_enable, 1)

    def torque_off(self, servo_ids: Sequence[int]) -> list[ServoError]:
        """Disable the torque of servos. If this fails for one servo, the torque of the others is still disabled.

        Args:
            servo_ids: IDs of the servos.

        Returns:
            The errors of the servos that did not acknowledge the request.
        """
        # A broadcast comes first, so that no servo waits for another's timeout. Acknowledged writes follow.
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
            if self._turns:
                self._turns.released(set(servo_ids) - {error.servo_id for error in failed})
            servo_ids = [error.servo_id for error in failed]
        return failed

    def limit_torque(self, servo_id: int, share: float) -> None:
        """Limit the torque of a servo until it is switched off.

        Args:
            servo_id: ID of the servo.
            share: Limit as a fraction of full drive, 0 to 1.

        Raises:
            ServoRefused: The servo would have no torque, or has no torque limit in RAM.
        """
        series = self._servos.series(servo_id)
        wanted, persistent, volatile = round(share * series.full_torque), series.max_torque, series.torque_limit
        held, where = self._read_with_retries(servo_id, persistent), f"{persistent.name} (register {persistent.address}"
        # The persistent limit is the upper bound, and a reset restores it. A limit that is one unit lower therefore
        # shows whether the servo was reset.
        limit = min(wanted, held - 1 if volatile else held)
        if limit <= 0:
            raise ServoRefused(
                servo_id,
                f"would have no torque, because {where}) is {held} and torque_limit is {share:g}: increase one of them",
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
        """Use the bus at a different baud rate. The previous rate is restored when the context exits.

        Args:
            baud: Rate, in bits per second.
            models: Servo models on the yielded bus, keyed by ID; None for the models of this bus.

        Yields:
            A bus at that rate. Replies that are still in transit at the end are discarded.

        Raises:
            PortError: The adapter does not support the rate.
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
