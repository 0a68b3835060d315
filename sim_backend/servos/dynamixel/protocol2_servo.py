"""Protocol 2.0 instructions on a virtual servo with any control table.

Assumed, because the e-manual does not describe it: the reply to a write of the ID or the baud rate uses the old ID. A
rebooting servo ignores all instructions for 0.3 s. After a shutdown, the torque cannot be enabled (the result is
"fail").
"""

from typing import ClassVar, Final

from drivers.protocol.v2 import ALERT
from drivers.servos.register import Register
from sim_backend.packets.dynamixel import BROADCAST, Code, fast_block, status_packet
from sim_backend.packets.instructions import Instruction
from sim_backend.servos.dynamixel.protocol2_firmware import Protocol2Firmware
from sim_backend.servos.dynamixel.protocol2_memory import ACCESS, Protocol2Memory
from sim_backend.servos.generic.packet_servo import WiredServo

REBOOT_S: Final = 0.3
RESULT_FAIL, UNKNOWN_INSTRUCTION = 1, 2
RESET_ALL: Final = 0xFF
"""Option of a factory reset that resets everything, including the ID and the baud rate."""


class Registers:
    """Registers that exist in all protocol 2.0 tables, at different addresses."""

    def __init__(self, *listed: Register) -> None:
        named = {register.name: register for register in listed}
        self.model_number = named["model_number"]
        self.firmware_version = named["firmware_version"]
        self.servo_id = named["id"]
        self.baud_rate = named["baud_rate"]
        self.return_delay = named["return_delay"]
        self.status_return_level = named["status_return_level"]
        self.torque_enable = named["torque_enable"]
        self.registered_instruction = named["registered_instruction"]
        self.goal_position = named["goal_position"]


class Protocol2Servo(WiredServo):
    """A servo whose table and firmware depend on its series."""

    REGISTERS: ClassVar[Registers]
    BOOT_S = REBOOT_S
    memory: Protocol2Memory
    firmware: Protocol2Firmware

    @property
    def reads_fast(self) -> bool:
        """Whether the firmware supports fast reads."""
        return False

    @property
    def ignores_broadcast_reset(self) -> bool:
        """Whether the firmware ignores a broadcast factory reset of all values."""
        return False

    @property
    def secondary_id(self) -> int | None:
        """Secondary ID on which the servo receives instructions without replying; None if there is none."""
        return None

    @property
    def speaks(self) -> bool:
        """Whether the servo uses this protocol."""
        return True

    @property
    def return_delay_s(self) -> float:
        """Delay from an instruction to its reply, in seconds: 2 us per unit, at least 2 us (assumed)."""
        return 2e-6 * max(1, self.memory.get(self.REGISTERS.return_delay))

    @property
    def _level(self) -> int:
        return self.memory.get(self.REGISTERS.status_return_level)

    @property
    def answers_reads(self) -> bool:
        """Whether the status return level allows replies to instructions other than pings."""
        return self._level > 0

    def heard(self) -> None:
        """Record that an instruction was sent on the bus, to this servo or to another servo."""

    def answer(self, instruction: Instruction) -> bytes | None:
        servo_id, level = self.servo_id, self._level
        parameters = instruction.parameters
        match instruction.code:
            case Code.PING:
                return self._status(servo_id, 0, self._introduction())
            case Code.READ if len(parameters) == 4:
                return self.read_status(*_span(parameters)) if level else None
            case Code.WRITE if len(parameters) >= 3:
                error = self.write(_number(parameters[:2]), parameters[2:])
            case Code.REG_WRITE if len(parameters) >= 3:
                self._registered = (_number(parameters[:2]), parameters[2:])
                self.memory.put(self.REGISTERS.registered_instruction, 1)
                error = 0
            case Code.ACTION:
                error = self._act()
            case Code.FACTORY_RESET if self._resets(instruction):
                self.memory.restore_factory(*self._kept()[parameters[0]])
                self._reboot()
                error = 0
            case Code.REBOOT:
                self._reboot()
                error = 0
            case _:
                error = self._answer_rare(instruction)
        return self._status(servo_id, error) if level == 2 else None

    def _resets(self, instruction: Instruction) -> bool:
        """Return whether the servo executes this factory reset. Newer firmware ignores a broadcast factory reset of all
        values."""
        parameters, broadcast = instruction.parameters, instruction.servo_id == BROADCAST
        ignored = broadcast and parameters == bytes((RESET_ALL,)) and self.ignores_broadcast_reset
        return len(parameters) == 1 and parameters[0] in self._kept() and not ignored

    def _answer_rare(self, instruction: Instruction) -> int:
        """Execute an instruction that only some series support, and return its error number."""
        return UNKNOWN_INSTRUCTION

    def write_by_secondary_id(self, address: int, data: bytes) -> None:
        """Write bytes that were sent to the secondary ID. Such writes cannot change the EEPROM."""
        if min(self.memory.resolved(address, len(data)), default=0) >= self.memory.EEPROM_END:
            self.write(address, data)

    def _kept(self) -> dict[int, tuple[Register, ...]]:
        """Return the registers that a factory reset keeps, keyed by the option of the reset."""
        servo_id, baud_rate = self.REGISTERS.servo_id, self.REGISTERS.baud_rate
        return {RESET_ALL: (), 0x01: (servo_id,), 0x02: (servo_id, baud_rate)}

    def _introduction(self) -> bytes:
        """Return the data for a ping reply."""
        number, version = self.REGISTERS.model_number.address, self.REGISTERS.firmware_version.address
        return self.memory.read(number, 2) + self.memory.read(version, 1)

    def read_status(self, address: int, size: int) -> bytes:
        error, data = self._read(address, size)
        return self._status(self.servo_id, error, data)

    def read_block(self, address: int, size: int, before: bytes) -> bytes:
        """Return the servo's block of a fast reply after ``before``. After an error, all data bytes are 0 (assumed)."""
        error, data = self._read(address, size)
        return fast_block(before, self.servo_id, error | self._alert, data.ljust(size, b"\0"))

    def write(self, address: int, data: bytes) -> int:
        """Write bytes received over the bus and apply all side effects. Return the error number, or 0 if there is no
        error."""
        written = dict(zip(self.memory.resolved(address, len(data)), data, strict=True))
        if written.get(self.REGISTERS.torque_enable.address) == 1 and self.firmware.protection.released:
            return RESULT_FAIL
        error = self.memory.write(address, data)
        if error:
            return error
        if address < self.memory.EEPROM_END:
            self.firmware.load_settings()
        self.firmware.load_goal()
        return 0

    def power_cycle(self) -> None:
        """Switch the servo off and on again. The RAM is reset, errors are cleared, and torque is disabled."""
        self._registered = None
        self.memory.power_up()
        self.firmware.restart()
        self.memory.put(self.REGISTERS.goal_position, int(self.firmware.position))
        self.firmware.load_goal()

    def _reboot(self) -> None:
        self.power_cycle()
        self.deaf_s = REBOOT_S

    def _act(self) -> int:
        if self._registered is None:
            return UNKNOWN_INSTRUCTION
        address, data = self._registered
        self._registered = None
        self.memory.put(self.REGISTERS.registered_instruction, 0)
        return self.write(address, data)

    def _read(self, address: int, size: int) -> tuple[int, bytes]:
        """Return the error number and, if there is no error, ``size`` bytes starting at ``address``."""
        if address + size > self.memory.SIZE:
            return ACCESS, b""
        self.firmware.publish()
        return 0, self._reported(address, size)

    @property
    def _alert(self) -> int:
        return ALERT if self.firmware.protection.status else 0

    def _status(self, servo_id: int, error: int, data: bytes = b"") -> bytes:
        return status_packet(servo_id, error | self._alert, data)


def _number(data: bytes) -> int:
    return int.from_bytes(data, "little")


def _span(parameters: bytes) -> tuple[int, int]:
    """Return the address and size."""
    return _number(parameters[:2]), _number(parameters[2:4])
