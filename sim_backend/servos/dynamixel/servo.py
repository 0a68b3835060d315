"""One virtual X series servo with its control table and firmware."""

from collections.abc import Sequence
from typing import ClassVar

from drivers.servos import x
from drivers.servos.register import ServoModel
from sim_backend.servos.dynamixel.firmware import XFirmware
from sim_backend.servos.dynamixel.memory import XMemory
from sim_backend.servos.dynamixel.models import reads_fast
from sim_backend.servos.dynamixel.modes import MODE_GOALS
from sim_backend.servos.dynamixel.motors import motor_of
from sim_backend.servos.dynamixel.protocol2_servo import Protocol2Servo, Registers


class VirtualXServo(Protocol2Servo):
    """A servo of the X series, or an MX with the same firmware."""

    REGISTERS: ClassVar[Registers] = Registers(*x.REGISTERS)
    PRESENT_POSITION = x.present_position

    def __init__(self, model: ServoModel, servo_id: int, firmware: int | None = None) -> None:
        """Create a servo.

        ``firmware`` is a version that differs from the usual one; it determines the indirect registers.
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
        """Whether a write to these addresses enables the torque, because it includes the goal of the mode."""
        get = self.memory.get
        goal = MODE_GOALS.get(get(x.operating_mode), x.goal_position)
        by_goal = get(x.drive_mode) & x.TORQUE_ON_BY_GOAL and self.reads_fast
        return bool(by_goal) and goal.address in written and not self.firmware.protection.released

    def heard(self) -> None:
        self.firmware.heard()

    @property
    def reads_fast(self) -> bool:
        return reads_fast(x.MODELS[self.model.name], self.memory.get(x.firmware_version))
