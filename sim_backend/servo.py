"""One virtual servo: the control table, the firmware, and what the instructions do to them.

An STS servo; those with other tables on the same packets derive from it.

Assumed where Feetech's manual is silent: a write of the ID or the baud is answered as the servo was
called; instructions that are malformed or unknown are not answered; a rebooting servo is deaf.
"""

from typing import ClassVar, Final

from drivers.servos import sts
from drivers.servos.register import Register, ServoModel
from sim_backend.firmware import Firmware
from sim_backend.instructions import Instruction
from sim_backend.motor import MotorConstants
from sim_backend.sts_memory import Memory
from sim_backend.sts_wire import Code, status_packet

SET_MIDDLE: Final = 128
"""Written to the torque switch: call the present position the middle, 2048."""
REBOOT_S: Final = 0.8
"""How long a reboot takes, says the protocol manual."""


class VirtualServo:
    """A servo below the wire. The bus hands it instructions and steps it."""

    MEMORY: ClassVar[type[Memory]] = Memory
    FIRMWARE: ClassVar[type[Firmware]] = Firmware
    GROUP_READ: ClassVar[Code | None] = Code.SYNC_READ
    """The instruction that asks it together with others."""
    REBOOTS: ClassVar[bool] = True
    """Whether it knows that instruction."""

    def __init__(self, model: ServoModel, servo_id: int, motor: MotorConstants | None = None) -> None:
        self.model = model
        self.memory = self.MEMORY(model, servo_id)
        self.firmware = self.FIRMWARE(self.memory, model, motor or MotorConstants.of(model))
        self.goal_write_energises = True
        """Whether an order to move is one to drive the motor, in position mode."""
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
        """From an instruction to the reply: 2 us a unit, and 2 us at the least."""
        return 2e-6 * max(1, self.memory.get(sts.return_delay))

    @property
    def deaf(self) -> bool:
        """Whether it is rebooting."""
        return self._deaf_s > 0.0

    def step(self, dt_s: float, angle_rad: float, velocity_rad_s: float) -> float:
        """Advance the firmware by ``dt_s``; returns the torque on the shaft, N m."""
        if self._deaf_s > 0.0:
            self._deaf_s -= dt_s
        return self.firmware.step(dt_s, angle_rad, velocity_rad_s)

    def answer(self, instruction: Instruction) -> bytes | None:
        """Do what one instruction says; the reply, if this servo makes one to it."""
        servo_id, answers = self.servo_id, self.memory.answers
        parameters = instruction.parameters
        match instruction.code:
            case Code.PING:
                return self._status(servo_id)
            case Code.READ if len(parameters) == 2:
                return self._status(servo_id, self.read(*parameters)) if answers else None
            case Code.WRITE if len(parameters) >= 2:
                self.write(parameters[0], parameters[1:])
            case Code.REG_WRITE if len(parameters) >= 2:
                self._registered = (parameters[0], parameters[1:])
                self.memory.put(sts.async_write_flag, 1)
            case Code.ACTION:
                self._act()
            case Code.RESET:
                self.memory.restore_factory()
                self.firmware.load_settings()
            case Code.REBOOT if self.REBOOTS:
                self.power_cycle()
                self._deaf_s = REBOOT_S
                return None
            case _:
                return None
        return self._status(servo_id) if answers == 2 else None

    def read(self, address: int, size: int) -> bytes:
        """``size`` bytes of the table from ``address``, the state as of now."""
        self.firmware.publish()
        return self.memory.read(address, size)

    def read_status(self, address: int, size: int) -> bytes:
        """The status packet with ``size`` bytes from ``address``."""
        return self._status(self.servo_id, self.read(address, size))

    def write(self, address: int, data: bytes) -> None:
        """A write from the wire and all that follows from it."""
        torque = self.memory.get(sts.torque_enable)
        self.memory.write(address, data)
        if address < self.memory.EEPROM_END:
            self.firmware.load_settings()
        if self.memory.get(sts.torque_enable) == SET_MIDDLE:
            self.memory.put(sts.torque_enable, torque)
            self.set_middle()
        moves = self._covers(address, data, sts.goal_position) and self.memory.get(sts.operating_mode) == 0
        if moves and self.goal_write_energises:
            self.memory.put(sts.torque_enable, 1)
        self.firmware.load_goal()
        if self._covers(address, data, sts.goal_position):
            self.firmware.goal_written()
        if self._covers(address, data, sts.torque_enable):
            self.firmware.torque_written()

    def set_middle(self) -> None:
        """Choose the homing offset so that the servo now stands at the middle of its range.

        Saved whatever the lock says, as Feetech's own calibration never opens it; the goal follows,
        so that a servo under torque stays where it is (both assumed).
        """
        middle = self.model.counts_per_turn // 2
        self.memory.save(sts.homing_offset, self.firmware.raw_count - middle)
        self.memory.put(sts.goal_position, middle)
        self.firmware.load_settings()
        self.firmware.profile.restart(float(middle))

    def power_cycle(self) -> None:
        """Power off and on again: what was not saved is gone, the motor is free."""
        self._registered = None
        self.memory.power_up()
        self.firmware.restart()

    def _act(self) -> None:
        if self._registered is not None:
            address, data = self._registered
            self._registered = None
            self.memory.put(sts.async_write_flag, 0)
            self.write(address, data)

    def _status(self, servo_id: int, data: bytes = b"") -> bytes:
        return status_packet(servo_id, self.firmware.protection.status, data)

    def _covers(self, address: int, data: bytes, register: Register) -> bool:
        """Whether a write of ``data`` at ``address`` touches ``register``."""
        own = self.memory.own(register)
        return own is not None and address < own.address + own.size and own.address < address + len(data)
