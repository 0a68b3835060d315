"""Single-servo instructions of Feetech's protocols and Dynamixel protocol 1.0, by the makers' SDKs."""

from collections.abc import Callable
from contextlib import AbstractContextManager
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

from drivers.errors import DriverError, ServoCorrupt, ServoRefused
from drivers.registers import ByteOrder, Register
from drivers.sdk_port import SdkPort

_OVERHEAD = 2
"""What a reply's length counts beside its data."""


class SingleServo:
    """What one servo is asked and told, acknowledged. Both SDKs have the same calls."""

    def __init__(
        self,
        sdk: Any,
        port: SdkPort,
        byte_order: ByteOrder,
        refusals: int,
        alarms: Callable[[int], tuple[str, ...]],
        *,
        reboots: bool,
        before: Callable[[], None],
    ) -> None:
        """``refusals``: those bits of a reply's error byte that refuse the instruction. The others are alarms,
        which are states and no failure; ``alarms`` has the names of all. ``before`` is called before anything is sent.
        """
        self._sdk = sdk
        self._port = port
        self._byte_order = byte_order
        self._refusals = refusals
        self._alarms = alarms
        self._reboots = reboots
        self._before = before

    def until(self, servo_id: int, deadline_s: float | None) -> AbstractContextManager[None]:
        """A read that is given up at the deadline, if there is one."""
        return self._port.until(servo_id, deadline_s)

    def ping(self, servo_id: int) -> None:
        """Raise ServoSilent unless it is there."""
        # Not the SDK's ping, which reads the model number too: a servo may answer pings alone.
        request = [0, 0, servo_id, 2, INST_PING, 0]
        self._before()
        self._port.transact(servo_id, lambda: self._sdk.txRxPacket(self._port, request))

    def read(self, servo_id: int, register: Register) -> int:
        """One register."""
        # Not the SDK's readTxRx: of a reply that is too short, it takes the checksum for data.
        request = [0, 0, servo_id, 4, INST_READ, register.address, register.size, 0]
        return register.decode(self._told(servo_id, request, register.size, register.name), self._byte_order)

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
        self._told(servo_id, request, 0, register.name)

    def action(self) -> None:
        """Of all servos."""
        self._before()
        self._sdk.action(self._port, BROADCAST_ID)

    def reboot(self, servo_id: int) -> None:
        """Nobody answers to that (Feetech's protocol manual); Dynamixel protocol 1.0 has none."""
        if not self._reboots:
            raise ServoRefused(servo_id, "cannot be rebooted over the wire: switch its supply off and on")
        self._before()
        self._sdk.txPacket(self._port, [0, 0, servo_id, 2, INST_REBOOT, 0])
        self._port.owe(servo_id)  # should one answer after all

    def factory_reset(self, servo_id: int) -> None:
        """Acknowledged."""
        self._told(servo_id, [0, 0, servo_id, 2, INST_FACTORY_RESET, 0], 0, "a factory reset")

    def broadcast_ping(self) -> tuple[int, ...]:
        """There is none."""
        raise DriverError("servos of this protocol would all answer a broadcast ping at once: ping each ID by itself")

    def _told(self, servo_id: int, request: list[int], size: int, what: str) -> bytes:
        """The reply's data, which must be so many bytes."""
        self._before()
        reply, error = self._port.transact(servo_id, lambda: self._sdk.txRxPacket(self._port, request))
        refused = error & self._refusals
        if refused:
            names = " and ".join(self._alarms(refused))
            raise ServoRefused(servo_id, f"refused the instruction ({names} error)")
        data = bytes(reply[5 : reply[3] + 3])
        if reply[3] - _OVERHEAD != size:
            self._port.owe(servo_id)
            raise ServoCorrupt(servo_id, f"answered {len(data)} bytes for {what}")
        return data


class SingleCalls:
    """The calls of a ServoBus to one servo that go straight to the SDK."""

    def __init__(self, single: SingleServo) -> None:
        self._single = single

    def ping(self, servo_id: int) -> None:
        """Raise ServoSilent unless it is there."""
        self._single.ping(servo_id)

    def broadcast_ping(self) -> tuple[int, ...]:
        """Raise DriverError: there is none."""
        return self._single.broadcast_ping()

    def read(self, servo_id: int, register: Register) -> int:
        """One register."""
        return self._single.read(servo_id, register)

    def write(self, servo_id: int, register: Register, value: int) -> None:
        """One register, acknowledged."""
        self._single.write(servo_id, register, value)

    def reg_write(self, servo_id: int, register: Register, value: int) -> None:
        """``write`` at the next ``action``."""
        self._single.reg_write(servo_id, register, value)

    def action(self) -> None:
        """Of all servos."""
        self._single.action()

    def reboot(self, servo_id: int) -> None:
        """As if its supply were switched off and on."""
        self._single.reboot(servo_id)

    def factory_reset(self, servo_id: int) -> None:
        """All settings."""
        self._single.factory_reset(servo_id)
