"""Send requests to a single servo outside the control cycle, through the manufacturer's SDK."""

from typing import Final

from dynamixel_sdk import COMM_SUCCESS

from drivers.bus.counters import BusCounters
from drivers.bus.late_replies import LateReplyFilter
from drivers.bus.sdk_adapter import CORRUPT, SdkAdapter
from drivers.driver_errors import DriverError, ServoCorrupt, ServoRefused, ServoSilent
from drivers.port.line import Line
from drivers.port.owners import line_advice
from drivers.printable import counted
from drivers.servos.register import Register
from drivers.servos.series import WireProtocol

_MANY: Final = 4096  # more bytes than can arrive during the wait for a late reply


class SingleServo:
    """Requests to a single servo.

    A servo fault raises ServoError, and a port that has disappeared raises PortLost.
    """

    def __init__(self, line: Line, protocol: WireProtocol, counters: BusCounters, late: LateReplyFilter) -> None:
        self._line = line
        self._protocol = protocol
        self._packets = protocol.packets
        self._counters = counters
        self._late = late
        self._adapter = SdkAdapter(line)
        self._sdk = protocol.sdk()

    def ping(self, servo_id: int) -> None:
        """Ping a servo. Raises ServoSilent if the servo does not respond."""
        # The SDK's ping also reads the model number, but some servos respond only to pings.
        self._request(servo_id, self._packets.PING, b"", None, "a ping")

    def read(self, servo_id: int, register: Register) -> int:
        """Read a register."""
        # The SDK's readTxRx mistakes the checksum of a short reply for data.
        where = self._packets.span(register.address, register.size)
        data = self._request(servo_id, self._packets.READ, where, register.size, register.name)
        return register.decode(data, self._protocol.byte_order)

    def write(self, servo_id: int, register: Register, value: int) -> None:
        """Write a register and check the acknowledgment. Raises ValueError without sending if the value does not
        fit."""
        self._write(self._packets.WRITE, servo_id, register, value)

    def reg_write(self, servo_id: int, register: Register, value: int) -> None:
        """Prepare a write that the servo executes at the next ``action``, and check the acknowledgment."""
        self._write(self._packets.REG_WRITE, servo_id, register, value)

    def _write(self, instruction: int, servo_id: int, register: Register, value: int) -> None:
        # The SDK's writeTxRx mistakes any reply of the servo for the acknowledgment, even a late one.
        data = self._packets.place(register.address) + register.encode(value, self._protocol.byte_order)
        self._request(servo_id, instruction, data, 0, register.name)

    def action(self) -> None:
        """Execute the writes prepared by ``reg_write`` on all servos at once. Servos do not reply."""
        self._line.clean = False
        self._sdk.action(self._adapter, self._packets.BROADCAST_ID)

    def reboot(self, servo_id: int) -> None:
        """Restart a servo. Its torque is disabled, and it does not respond for up to a second.

        Raises ServoRefused if the servo's protocol has no reboot instruction.
        """
        if self._protocol.reboot == "none":
            raise ServoRefused(servo_id, "cannot be rebooted over the bus: switch its power off and on")
        if self._protocol.reboot == "acknowledged":
            self._request(servo_id, self._packets.REBOOT, b"", 0, "a reboot")
            return
        self._line.clean = False
        self._sdk.txPacket(self._adapter, self._packets.sdk_request(servo_id, self._packets.REBOOT, b""))
        # The servo should not reply, but a late reply must be recognized.
        self._late.add_single(servo_id, self._line.now())

    def factory_reset(self, servo_id: int) -> None:
        """Restore the factory settings except for the ID. Servos with Dynamixel protocol 1.0 also get ID 1."""
        self._request(servo_id, self._packets.FACTORY_RESET, self._protocol.factory_reset, 0, "a factory reset")

    def forget_turns(self, servo_id: int) -> None:
        """Reset the turn count of a Feetech STS servo to zero, which also disables its torque."""
        self._request(servo_id, self._packets.FORGET_TURNS, b"", 0, "a turn count reset")

    def broadcast_ping(self) -> tuple[int, ...]:
        """Return the servos that respond to a broadcast ping. Raises DriverError if the servos' replies would
        collide."""
        if not self._protocol.broadcast_ping:
            raise DriverError("the replies to a broadcast ping collide in this protocol: ping each ID separately")
        self._line.clean = False
        found, _ = self._sdk.broadcastPing(self._adapter)  # at 1 Mbit/s, the SDK waits 0.8 s for the replies
        return tuple(sorted(found))

    def _request(self, servo_id: int, instruction: int, parameters: bytes, size: int | None, what: str) -> bytes:
        """Send an instruction and return the data of the reply.

        The data must be ``size`` bytes long. If ``size`` is None, any size is valid.

        A reply does not identify its request. The call therefore waits until a late reply from this servo is no longer
        possible.
        """
        self._line.clean = False
        self._wait_for_late_replies(servo_id)
        request = self._packets.sdk_request(servo_id, instruction, parameters)
        try:
            reply, result, error = self._sdk.txRxPacket(self._adapter, request)
        except BaseException:  # after an interrupt the reply may still arrive
            self._late.add_single(servo_id, self._line.now())
            raise
        self._check_received(servo_id, self._adapter.corrected_result(result))
        return self._reply_data(servo_id, error, self._packets.sdk_data(reply), size, what)

    def _check_received(self, servo_id: int, result: int) -> None:
        if result == COMM_SUCCESS:
            return
        self._late.add_single(servo_id, self._line.now())
        account = self._counters.of(servo_id)
        if result in CORRUPT:
            account.corrupt += 1
            raise ServoCorrupt(servo_id, f"sent a corrupt packet: check {line_advice(self._line.port.name)}")
        account.silent += 1
        raise ServoSilent(servo_id, "does not respond: check its power and cable, its ID and the baud rate")

    def _reply_data(self, servo_id: int, error: int, data: bytes, size: int | None, what: str) -> bytes:
        account = self._counters.of(servo_id)
        if refused := error & self._protocol.refusals:
            account.refused += 1
            self._late.answered(servo_id, self._line.now())
            error_of = ServoCorrupt if self._protocol.arrived_corrupt(refused) else ServoRefused
            raise error_of(servo_id, self._protocol.refusal(refused))
        if size is not None and len(data) != size:
            account.late += 1
            self._late.add_single(servo_id, self._line.now())
            raise ServoCorrupt(servo_id, f"sent {counted(len(data), 'byte')} in reply to {what}")
        account.replies += 1
        account.alarms += error != 0
        self._late.answered(servo_id, self._line.now())
        return data

    def _wait_for_late_replies(self, servo_id: int) -> None:
        until_s = self._late.single_until_s(servo_id)
        while self._line.now() < until_s:
            self._line.port.read(_MANY, until_s)
