"""Calls to one servo by itself, not for a cycle: through the maker's SDK, acknowledged, judged and counted."""

from typing import Final

from dynamixel_sdk import COMM_SUCCESS

from drivers.bus.counters import BusCounters
from drivers.bus.late_replies import LateReplies
from drivers.bus.sdk_adapter import CORRUPT, SdkAdapter
from drivers.errors import DriverError, ServoCorrupt, ServoRefused, ServoSilent
from drivers.port.line import Line
from drivers.port.owners import line_advice
from drivers.printable import counted
from drivers.servos.register import Register
from drivers.servos.series import WireProtocol

_MANY: Final = 4096  # more bytes than can come while a late reply is waited for


class SingleServo:
    """Calls to one servo. They raise ServoError, and PortLost once the line is gone."""

    def __init__(self, line: Line, protocol: WireProtocol, counters: BusCounters, late: LateReplies) -> None:
        self._line = line
        self._protocol = protocol
        self._packets = protocol.packets
        self._counters = counters
        self._late = late
        self._adapter = SdkAdapter(line)
        self._sdk = protocol.sdk()

    def ping(self, servo_id: int) -> None:
        """Raise ServoSilent unless the servo is there."""
        # Not the SDK's ping, which reads the model number too: a servo may answer pings alone.
        self._ask(servo_id, self._packets.PING, b"", None, "a ping")

    def read(self, servo_id: int, register: Register) -> int:
        """One register."""
        # Not the SDK's readTxRx: of a reply that is too short, it takes the checksum for data.
        where = self._packets.span(register.address, register.size)
        data = self._ask(servo_id, self._packets.READ, where, register.size, register.name)
        return register.decode(data, self._protocol.byte_order)

    def write(self, servo_id: int, register: Register, value: int) -> None:
        """One register, acknowledged. ValueError, and nothing is sent, where the value does not fit."""
        self._write(self._packets.WRITE, servo_id, register, value)

    def reg_write(self, servo_id: int, register: Register, value: int) -> None:
        """``write``, acknowledged, but done only at the next ``action``."""
        self._write(self._packets.REG_WRITE, servo_id, register, value)

    def _write(self, instruction: int, servo_id: int, register: Register, value: int) -> None:
        # Not the SDK's writeTxRx, which takes any reply of the servo for the acknowledgement, a late one too.
        data = self._packets.place(register.address) + register.encode(value, self._protocol.byte_order)
        self._ask(servo_id, instruction, data, 0, register.name)

    def action(self) -> None:
        """Every servo does what ``reg_write`` gave it, all at once. Nobody answers."""
        self._line.clean = False
        self._sdk.action(self._adapter, self._packets.BROADCAST_ID)

    def reboot(self, servo_id: int) -> None:
        """As if its supply were switched off and on: the torque goes off, and it is deaf for up to a second.

        Raises ServoRefused where its protocol has no such instruction.
        """
        if self._protocol.reboot == "none":
            raise ServoRefused(servo_id, "cannot be rebooted over the wire: switch its supply off and on")
        if self._protocol.reboot == "acknowledged":
            self._ask(servo_id, self._packets.REBOOT, b"", 0, "a reboot")
            return
        self._line.clean = False
        self._sdk.txPacket(self._adapter, self._packets.sdk_request(servo_id, self._packets.REBOOT, b""))
        self._late.add_single(servo_id, self._line.now())  # should one answer after all

    def factory_reset(self, servo_id: int) -> None:
        """Its settings become the factory's. All keep their ID but those of Dynamixel protocol 1.0, which get ID 1."""
        self._ask(servo_id, self._packets.FACTORY_RESET, self._protocol.factory_reset, 0, "a factory reset")

    def forget_turns(self, servo_id: int) -> None:
        """A Feetech STS counts its shaft's turns anew, from none; its torque goes off."""
        self._ask(servo_id, self._packets.FORGET_TURNS, b"", 0, "the order to forget its turns")

    def broadcast_ping(self) -> tuple[int, ...]:
        """The servos that answer one question to all. DriverError where they would all answer it at once."""
        if not self._protocol.broadcast_ping:
            raise DriverError("servos of this protocol all answer a broadcast ping at once: ping each ID by itself")
        self._line.clean = False
        found, _ = self._sdk.broadcastPing(self._adapter)  # within the SDK's 0.8 s at 1 Mbit/s
        return tuple(sorted(found))

    def _ask(self, servo_id: int, instruction: int, parameters: bytes, size: int | None, what: str) -> bytes:
        """One instruction by the SDK; the reply's data, which must be so many bytes (None: any).

        A reply does not say what it answers: while one of this servo may still come, nothing is sent to it.
        """
        self._line.clean = False
        self._let_pass(servo_id)
        request = self._packets.sdk_request(servo_id, instruction, parameters)
        try:
            reply, result, error = self._sdk.txRxPacket(self._adapter, request)
        except BaseException:  # an interrupt leaves the reply on its way
            self._late.add_single(servo_id, self._line.now())
            raise
        self._check_heard(servo_id, self._adapter.judged(result))
        return self._checked(servo_id, error, self._packets.sdk_data(reply), size, what)

    def _check_heard(self, servo_id: int, result: int) -> None:
        if result == COMM_SUCCESS:
            return
        self._late.add_single(servo_id, self._line.now())
        account = self._counters.of(servo_id)
        if result in CORRUPT:
            account.corrupt += 1
            raise ServoCorrupt(servo_id, f"answered with a broken packet: check {line_advice(self._line.port.name)}")
        account.silent += 1
        raise ServoSilent(servo_id, "does not answer: check its power and cable, its ID and the baud rate")

    def _checked(self, servo_id: int, error: int, data: bytes, size: int | None, what: str) -> bytes:
        """The data, if the reply is one to this question."""
        account = self._counters.of(servo_id)
        if refused := error & self._protocol.refusals:
            account.refused += 1
            self._late.answered(servo_id, self._line.now())
            error_of = ServoCorrupt if self._protocol.came_broken(refused) else ServoRefused
            raise error_of(servo_id, self._protocol.refusal(refused))
        if size is not None and len(data) != size:
            account.late += 1
            self._late.add_single(servo_id, self._line.now())
            raise ServoCorrupt(servo_id, f"answered {counted(len(data), 'byte')} for {what}")
        account.replies += 1
        account.alarms += error != 0
        self._late.answered(servo_id, self._line.now())
        return data

    def _let_pass(self, servo_id: int) -> None:
        """Wait until no reply to a former instruction can come any more."""
        until_s = self._late.single_until_s(servo_id)
        while self._line.now() < until_s:
            self._line.port.read(_MANY, until_s)
