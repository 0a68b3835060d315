"""Single-servo instructions by the makers' SDKs, and their results as errors."""

from typing import Any

from dynamixel_sdk import INST_PING, INST_READ

from drivers.errors import ServoCorrupt, ServoRefused
from drivers.read_each.series import Series
from drivers.registers import Register
from drivers.sdk_port import SdkPort, raise_for


class SingleServo:
    """Ping, read and write of one servo, acknowledged. Both SDKs have the same calls."""

    def __init__(self, series: Series, port: SdkPort) -> None:
        self._series = series
        self._port = port
        self._sdk: Any = series.sdk()

    def ping(self, servo_id: int) -> None:
        """Raise ServoSilent unless it is there."""
        # Not the SDK's ping, which reads the model number too: a servo may answer pings alone.
        _, result, _ = self._sdk.txRxPacket(self._port, [0, 0, servo_id, 2, INST_PING, 0])
        raise_for(servo_id, result)

    def read(self, servo_id: int, register: Register) -> int:
        """One register."""
        # Not the SDK's readTxRx: of a reply that is too short, it takes the checksum for data.
        request = [0, 0, servo_id, 4, INST_READ, register.address, register.size, 0]
        reply, result, error = self._sdk.txRxPacket(self._port, request)
        self._check(servo_id, result, error)
        data = reply[5 : reply[3] + 3]
        if len(data) != register.size:
            raise ServoCorrupt(servo_id, f"answered {len(data)} bytes for {register.name}")
        return register.decode(bytes(data), self._series.byte_order)

    def write(self, servo_id: int, register: Register, value: int) -> None:
        """One register."""
        data = list(register.encode(value, self._series.byte_order))
        result, error = self._sdk.writeTxRx(self._port, servo_id, register.address, register.size, data)
        self._check(servo_id, result, error)

    def _check(self, servo_id: int, result: int, error: int) -> None:
        """A bit that speaks of the instruction refuses it; the others are no failure: alarms are states."""
        raise_for(servo_id, result)
        refused = error & self._series.refusals
        if refused:
            names = " and ".join(self._series.alarms(refused))
            raise ServoRefused(servo_id, f"refused the instruction ({names} error)")
