"""Single-servo instructions of Feetech's protocols and Dynamixel protocol 1.0, by the makers' SDKs."""

from collections.abc import Callable
from typing import Any

from dynamixel_sdk import (
    BROADCAST_ID,
    INST_FACTORY_RESET,
    INST_PING,
    INST_READ,
    INST_REBOOT,
    INST_REG_WRITE,
    INST_WRITE,
)

from drivers.errors import DriverError, ServoRefused
from drivers.questions import Dialect, Questions
from drivers.registers import ByteOrder, Register


def dialect(sdk: Any, refusals: int, alarms: Callable[[int], tuple[str, ...]], broken: int) -> Dialect:
    """The same for all of these protocols but for what refuses an instruction; ``alarms`` names the error bits.

    ``broken``: the bit that says that the instruction's checksum was wrong, 0 where there is none.
    """
    return Dialect(
        sdk,
        data_of=lambda reply: bytes(reply[5 : reply[3] + 3]),
        refusals=refusals,
        refusal=lambda error: f"refused the instruction ({' and '.join(alarms(error))} error)",
        came_broken=lambda error: bool(error & broken),
    )


class SingleServo:
    """What one servo is asked and told, acknowledged. Both SDKs have the same calls."""

    def __init__(self, questions: Questions, byte_order: ByteOrder, *, reboots: bool) -> None:
        """``reboots``: whether the protocol has that instruction."""
        self._questions = questions
        self._byte_order = byte_order
        self._reboots = reboots
        self.until = questions.until

    def ping(self, servo_id: int) -> None:
        """Raise ServoSilent unless it is there."""
        # Not the SDK's ping, which reads the model number too: a servo may answer pings alone.
        self._questions.ask(servo_id, [0, 0, servo_id, 2, INST_PING, 0], None, "a ping")

    def read(self, servo_id: int, register: Register) -> int:
        """One register."""
        # Not the SDK's readTxRx: of a reply that is too short, it takes the checksum for data.
        request = [0, 0, servo_id, 4, INST_READ, register.address, register.size, 0]
        return register.decode(self._questions.ask(servo_id, request, register.size, register.name), self._byte_order)

    def write(self, servo_id: int, register: Register, value: int) -> None:
        """One register."""
        self._write(INST_WRITE, servo_id, register, value)

    def reg_write(self, servo_id: int, register: Register, value: int) -> None:
        """One register, at the next ``action``."""
        self._write(INST_REG_WRITE, servo_id, register, value)

    def _write(self, instruction: int, servo_id: int, register: Register, value: int) -> None:
        # Not the SDK's writeTxRx, which takes any reply of the servo for the acknowledgement, a late one too.
        data = register.encode(value, self._byte_order)
        request = [0, 0, servo_id, 3 + len(data), instruction, register.address, *data, 0]
        self._questions.ask(servo_id, request, 0, register.name)

    def action(self) -> None:
        """Of all servos."""
        self._questions.say(lambda sdk, port: sdk.action(port, BROADCAST_ID))

    def reboot(self, servo_id: int) -> None:
        """Nobody answers to that (Feetech's protocol manual); Dynamixel protocol 1.0 has none."""
        if not self._reboots:
            raise ServoRefused(servo_id, "cannot be rebooted over the wire: switch its supply off and on")
        request = [0, 0, servo_id, 2, INST_REBOOT, 0]
        self._questions.say(lambda sdk, port: sdk.txPacket(port, request))
        self._questions.owe(servo_id)  # should one answer after all

    def factory_reset(self, servo_id: int) -> None:
        """Acknowledged."""
        self._questions.ask(servo_id, [0, 0, servo_id, 2, INST_FACTORY_RESET, 0], 0, "a factory reset")

    def broadcast_ping(self) -> tuple[int, ...]:
        """There is none."""
        raise DriverError("servos of this protocol would all answer a broadcast ping at once: ping each ID by itself")
