"""What one servo is asked and told by itself: through the SDK's packet handler, acknowledged."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from dynamixel_sdk import Protocol2PacketHandler

from drivers.dynamixel import wire
from drivers.dynamixel.models import SERIES
from drivers.dynamixel.servos import Servos
from drivers.errors import ServoError
from drivers.questions import Dialect, Questions
from drivers.registers import Register
from drivers.single_calls import SingleCalls
from drivers.tries import tried_with_each

ORDER: Final = "little"


def dialect() -> Dialect:
    """The alert bit is no refusal: alarms are states."""
    return Dialect(
        Protocol2PacketHandler(),
        data_of=lambda reply: bytes(reply[9 : reply[5] + (reply[6] << 8) + 5]),
        refusals=0xFF & ~wire.ALERT,
        refusal=wire.error_text,
        came_broken=lambda number: number == wire.CAME_BROKEN,
    )


class Wire:
    """Registers of one servo. Raises ServoError, and PortLost once the line is gone."""

    def __init__(self, questions: Questions) -> None:
        self._questions = questions
        self.until = questions.until

    def number(self, servo_id: int) -> int:
        """The servo's model number, by a ping."""
        # Not the SDK's ping, which ends in an IndexError where a late acknowledgement comes instead.
        said = self._questions.ask(servo_id, [0, 0, 0, 0, servo_id, 3, 0, wire.PING, 0, 0], 3, "a ping")
        return int.from_bytes(said[:2], ORDER)

    def ping(self, servo_id: int) -> None:
        """Raise ServoSilent unless it is there."""
        self.number(servo_id)

    def read(self, servo_id: int, register: Register) -> int:
        """What the register holds."""
        # Not the SDK's readTxRx: of a reply that is too short, it takes the checksum for data.
        request = [0, 0, 0, 0, servo_id, 7, 0, wire.READ, *wire.span(register.address, register.size), 0, 0]
        return register.decode(self._questions.ask(servo_id, request, register.size, register.name), ORDER)

    def broadcast_ping(self) -> tuple[int, ...]:
        """Who answers, within the SDK's 0.8 s at 1 Mbit/s."""
        found, _ = self._questions.say(lambda sdk, port: sdk.broadcastPing(port))
        return tuple(sorted(found))

    def action(self) -> None:
        """All servos do what they hold back."""
        self._questions.say(lambda sdk, port: sdk.action(port, wire.BROADCAST_ID))

    def reboot(self, servo_id: int) -> None:
        """Acknowledged, then the servo is deaf for a while."""
        self._questions.ask(servo_id, [0, 0, 0, 0, servo_id, 3, 0, wire.REBOOT, 0, 0], 0, "a reboot")

    def factory_reset(self, servo_id: int) -> None:
        """All but ID and baud rate."""
        request = [0, 0, 0, 0, servo_id, 4, 0, wire.FACTORY_RESET, wire.KEEP_ID_AND_BAUD, 0, 0]
        self._questions.ask(servo_id, request, 0, "a factory reset")

    def write(self, servo_id: int, register: Register, value: int) -> None:
        """Make the register hold ``value``. ValueError, and nothing is sent, where it does not fit."""
        self._write(wire.WRITE, servo_id, register, value)

    def reg_write(self, servo_id: int, register: Register, value: int) -> None:
        """``write`` at the next ``action``."""
        self._write(wire.REG_WRITE, servo_id, register, value)

    def _write(self, instruction: int, servo_id: int, register: Register, value: int) -> None:
        # Not the SDK's writeTxRx, which takes any reply of the servo for the acknowledgement, a late one too.
        # Stuffed here, for the SDK computes that and then sends the packet without it.
        data = wire.stuffed(register.encode(value, ORDER))
        head = [0, 0, 0, 0, servo_id, *(len(data) + 5).to_bytes(2, ORDER), instruction]
        self._questions.ask(servo_id, [*head, *register.address.to_bytes(2, ORDER), *data, 0, 0], 0, register.name)


class ServoCalls(SingleCalls):
    """The single-servo calls of a ServoBus: each servo's goal, torque and limit in the registers that it has for it."""

    def __init__(self, single: Wire, servos: Servos, send: Callable[[bytes], None], gains: Mapping[int, int]) -> None:
        """``send`` takes a packet that nobody answers; ``gains`` are position P gains by ID."""
        super().__init__(single)
        self._single = single
        self._servos = servos
        self._send = send
        self._gains = dict(gains)

    def goal(self, servo_id: int) -> int:
        """The goal position that the servo holds, in counts."""
        return self._read_surely(servo_id, self._servos.series(servo_id).goal_position)

    def position_limits(self, servo_id: int) -> tuple[int, int] | None:
        """The lowest and the highest goal that its settings let it take, in counts."""
        return self._limits(servo_id, self._servos.series(servo_id).position_limits)

    def torque_is_on(self, servo_id: int, deadline_s: float | None = None) -> bool:
        """Whether the servo drives its motor, if that can be known by the deadline."""
        return self._read_surely(servo_id, self._servos.series(servo_id).torque_enable, deadline_s) == 1

    def torque_on(self, servo_id: int) -> None:
        """Drive the motor, with the gain that it is to have."""
        series = self._servos.series(servo_id)
        for register, value in series.before_torque:
            self._write_surely(servo_id, register, value)
        if servo_id in self._gains:
            self._write_surely(servo_id, series.position_p, self._gains[servo_id])
        self.write(servo_id, series.torque_enable, 1)

    def torque_off(self, servo_ids: Sequence[int]) -> list[ServoError]:
        """Let go of all; what failed."""
        # All at once first, so that nobody waits for a dead one's time-out; then each, acknowledged.
        for kind in SERIES:
            register = kind.torque_enable
            off = {i: register.encode(0, ORDER) for i in servo_ids if self._servos.series(i) is kind}
            if off:
                self._send(wire.sync_write(register.address, register.size, off))
        return tried_with_each(servo_ids, lambda i: self.write(i, self._servos.series(i).torque_enable, 0))

    def limit_torque(self, servo_id: int, share: float) -> None:
        """Limit the drive to a share (0 to 1) of full drive until power-off."""
        # Beyond its ceiling the servo would refuse.
        series = self._servos.series(servo_id)
        limit = self._read_surely(servo_id, series.torque_ceiling)
        self._write_surely(servo_id, series.torque_limit, min(round(share * series.full_torque), limit))
