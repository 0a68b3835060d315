"""One virtual X series servo: the control table, the firmware, and what the instructions do to them.

Assumed where the e-manual is silent: a write of the ID or the baud is answered as the servo was called;
a rebooting servo is deaf for 0.3 s; the torque cannot be switched on after a shutdown (result fail).
"""

from typing import Final

from drivers.protocol.v2 import ALERT
from drivers.servos import x
from drivers.servos.register import ServoModel
from sim_backend.dynamixel_firmware import XFirmware
from sim_backend.dynamixel_memory import ACCESS, EEPROM_END, SIZE, XMemory
from sim_backend.dynamixel_models import reads_fast
from sim_backend.dynamixel_wire import Code, fast_block, status_packet
from sim_backend.instructions import Instruction

REBOOT_S: Final = 0.3
RESULT_FAIL, UNKNOWN_INSTRUCTION = 1, 2
_KEEP: Final = {0xFF: (), 0x01: (x.servo_id,), 0x02: (x.servo_id, x.baud_rate)}
"""What a factory reset leaves alone, by its option."""


class VirtualXServo:
    """A servo below the wire. The bus hands it instructions and steps it."""

    def __init__(self, model: ServoModel, servo_id: int, firmware: int | None = None) -> None:
        """``firmware`` is the version, if not the usual one: where indirect registers lie depends on it."""
        self.model = x.MODELS[model.name]
        self.memory = XMemory(self.model, servo_id, firmware)
        self.firmware = XFirmware(self.memory, self.model)
        self._registered: tuple[int, bytes] | None = None
        self._deaf_s = 0.0

    @property
    def servo_id(self) -> int:
        """The ID that it answers to now."""
        return self.memory.servo_id

    @property
    def baud(self) -> int:
        """The bits per second that it listens and talks at."""
        return self.memory.baud

    @property
    def return_delay_s(self) -> float:
        """From an instruction to the reply: 2 us a unit, and 2 us at the least (assumed)."""
        return 2e-6 * max(1, self.memory.get(x.return_delay))

    @property
    def deaf(self) -> bool:
        """Whether it is rebooting."""
        return self._deaf_s > 0.0

    @property
    def answers_reads(self) -> bool:
        """Whether its status return level lets it answer more than pings."""
        return self.memory.get(x.status_return_level) > 0

    @property
    def reads_fast(self) -> bool:
        """Whether its firmware knows the fast reads."""
        return reads_fast(self.model, self.memory.get(x.firmware_version))

    def step(self, dt_s: float, angle_rad: float, velocity_rad_s: float) -> float:
        """Advance the firmware by ``dt_s``; returns the torque on the shaft, N m."""
        if self._deaf_s > 0.0:
            self._deaf_s -= dt_s
        return self.firmware.step(dt_s, angle_rad, velocity_rad_s)

    def answer(self, instruction: Instruction) -> bytes | None:
        """Do what one instruction says; the reply, if this servo makes one to it."""
        servo_id, level = self.servo_id, self.memory.get(x.status_return_level)
        parameters = instruction.parameters
        match instruction.code:
            case Code.PING:
                data = self.memory.read(x.model_number.address, 2) + self.memory.read(x.firmware_version.address, 1)
                return self._status(servo_id, 0, data)
            case Code.READ if len(parameters) == 4:
                return self.read_status(*_span(parameters)) if level else None
            case Code.WRITE if len(parameters) >= 3:
                error = self.write(_number(parameters[:2]), parameters[2:])
            case Code.REG_WRITE if len(parameters) >= 3:
                self._registered = (_number(parameters[:2]), parameters[2:])
                self.memory.put(x.registered_instruction, 1)
                error = 0
            case Code.ACTION:
                error = self._act()
            case Code.FACTORY_RESET if len(parameters) == 1 and parameters[0] in _KEEP:
                self.memory.restore_factory(*_KEEP[parameters[0]])
                self._reboot()
                error = 0
            case Code.REBOOT:
                self._reboot()
                error = 0
            case _:
                error = UNKNOWN_INSTRUCTION
        return self._status(servo_id, error) if level == 2 else None

    def read_status(self, address: int, size: int) -> bytes:
        """The status packet with ``size`` bytes from ``address``, the state as of now."""
        error, data = self._read(address, size)
        return self._status(self.servo_id, error, data)

    def read_block(self, address: int, size: int, before: bytes) -> bytes:
        """The same behind ``before`` in a fast reply; after an error zeros, to keep its length (assumed)."""
        error, data = self._read(address, size)
        return fast_block(before, self.servo_id, error | self._alert, data.ljust(size, b"\0"))

    def write(self, address: int, data: bytes) -> int:
        """A write from the wire and all that follows from it; returns the error number."""
        written = dict(zip(self.memory.resolved(address, len(data)), data, strict=True))
        if written.get(x.torque_enable.address) == 1 and self.firmware.protection.released:
            return RESULT_FAIL
        error = self.memory.write(address, data)
        if error:
            return error
        if address < EEPROM_END:
            self.firmware.load_settings()
        self.firmware.load_goal()
        return 0

    def power_cycle(self) -> None:
        """Power off and on again: RAM is as at the beginning, errors are gone, the motor is free."""
        self._registered = None
        self.memory.power_up()
        self.firmware.restart()
        self.memory.put(x.goal_position, int(self.firmware.position))
        self.firmware.load_goal()

    def _reboot(self) -> None:
        self.power_cycle()
        self._deaf_s = REBOOT_S

    def _act(self) -> int:
        if self._registered is None:
            return UNKNOWN_INSTRUCTION
        address, data = self._registered
        self._registered = None
        self.memory.put(x.registered_instruction, 0)
        return self.write(address, data)

    def _read(self, address: int, size: int) -> tuple[int, bytes]:
        """The error number, and ``size`` bytes from ``address`` if there is none."""
        if address + size > SIZE:
            return ACCESS, b""
        self.firmware.publish()
        return 0, self.memory.read(address, size)

    @property
    def _alert(self) -> int:
        return ALERT if self.firmware.protection.status else 0

    def _status(self, servo_id: int, error: int, data: bytes = b"") -> bytes:
        return status_packet(servo_id, error | self._alert, data)


def _number(data: bytes) -> int:
    return int.from_bytes(data, "little")


def _span(parameters: bytes) -> tuple[int, int]:
    """Address and size."""
    return _number(parameters[:2]), _number(parameters[2:4])
