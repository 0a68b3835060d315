"""One virtual X series servo with its control table and firmware."""

from collections.abc import Sequence
from typing import ClassVar, Final

from drivers.servos import x
from drivers.servos.register import ServoModel
from sim_backend.packets.dynamixel import Code
from sim_backend.packets.instructions import Instruction
from sim_backend.servos.dynamixel.firmware import XFirmware
from sim_backend.servos.dynamixel.memory import XMemory
from sim_backend.servos.dynamixel.models import follows_42, reads_fast
from sim_backend.servos.dynamixel.modes import MODE_GOALS
from sim_backend.servos.dynamixel.motors import motor_of
from sim_backend.servos.dynamixel.protocol2_servo import (
    RESULT_FAIL,
    UNKNOWN_INSTRUCTION,
    Protocol2Servo,
    Registers,
)

CLEAR_KEY: Final = bytes((0x44, 0x58, 0x4C, 0x22))
BACKUP_KEY: Final = b"CTRL"
PROTOCOL_2: Final = 2
LARGEST_ID: Final = 252


class VirtualXServo(Protocol2Servo):
    """A servo of the X series, or an MX with the same firmware."""

    REGISTERS: ClassVar[Registers] = Registers(*x.REGISTERS)
    PRESENT_POSITION = x.present_position

    def __init__(self, model: ServoModel, servo_id: int, firmware: int | None = None) -> None:
        """Create a servo.

        ``firmware`` is the firmware version, if it differs from the usual version; it determines the indirect
        registers.
        """
        own = x.MODELS[model.name]
        motor = motor_of(own)
        super().__init__(own, motor.gears)
        self.memory: XMemory = XMemory(own, servo_id, firmware)
        self.firmware: XFirmware = XFirmware(self.memory, own, motor)

    def write(self, address: int, data: bytes) -> int:
        mode = self.memory.get(x.operating_mode)
        error = super().write(address, data)
        if mode != self.memory.get(x.operating_mode):
            self.memory.reset_mode()
            self.firmware.mode_changed()
        if not error and self._enables_torque(self.memory.resolved(address, len(data))):
            self.memory.put(x.torque_enable, 1)
            self.firmware.load_goal()
        return error

    def _enables_torque(self, written: Sequence[int]) -> bool:
        """Return whether a write to these addresses enables torque because it includes the goal of the current
        operating mode."""
        get = self.memory.get
        goal = MODE_GOALS.get(get(x.operating_mode), x.goal_position)
        by_goal = get(x.drive_mode) & x.TORQUE_ON_BY_GOAL and self.reads_fast
        return bool(by_goal) and goal.address in written and not self.firmware.protection.released

    def heard(self) -> None:
        self.firmware.heard()

    def power_cycle(self) -> None:
        super().power_cycle()
        if self.reads_fast and self.memory.get(x.startup_configuration) & x.STARTUP_TORQUE_ON:
            self.memory.put(x.torque_enable, 1)
            self.firmware.load_goal()

    def _answer_rare(self, instruction: Instruction) -> int:
        option, key = instruction.parameters[:1], instruction.parameters[1:]
        match instruction.code:
            case Code.CLEAR if option == b"\x01" and key == CLEAR_KEY and self._follows_42:
                return 0 if self.firmware.clear_turns() else RESULT_FAIL
            case Code.BACKUP if option == b"\x01" and key == BACKUP_KEY and self.reads_fast:
                return 0 if self.memory.store_backup() else RESULT_FAIL
            case Code.BACKUP if option == b"\x02" and key == BACKUP_KEY and self.reads_fast:
                if not self.memory.restore_backup():
                    return RESULT_FAIL
                self._reboot()
                return 0
        return UNKNOWN_INSTRUCTION

    @property
    def _follows_42(self) -> bool:
        return follows_42(x.MODELS[self.model.name], self.memory.get(x.firmware_version))

    @property
    def reads_fast(self) -> bool:
        return reads_fast(x.MODELS[self.model.name], self.memory.get(x.firmware_version))

    @property
    def ignores_broadcast_reset(self) -> bool:
        return self._follows_42

    @property
    def secondary_id(self) -> int | None:
        secondary = self.memory.get(x.secondary_id)
        return secondary if secondary <= LARGEST_ID else None

    @property
    def speaks(self) -> bool:
        return self.memory.get(x.protocol_type) == PROTOCOL_2
