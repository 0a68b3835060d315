"""One virtual STS servo: control table, firmware and instructions.

``scs_servo`` and ``protocol1_servo`` contain servos that use the same packets but different tables. docs/simulation.md
describes the known behavior of an STS servo, with sources. Also assumed: the servo does not reply to a malformed read.
"""

from typing import ClassVar, Final

from drivers.port.line import BITS_PER_BYTE
from drivers.servos import sts
from drivers.servos.register import ServoModel
from sim_backend.mechanics.motor import MotorConstants, sts_motor
from sim_backend.packets.instructions import Instruction
from sim_backend.packets.sts import Code
from sim_backend.servos.generic.memory import touches
from sim_backend.servos.generic.packet_servo import PacketServo
from sim_backend.servos.sts.firmware import AS_REIMPLEMENTED, StsFirmware, StsVariant, sts_states
from sim_backend.servos.sts.memory import OFFSET_WORD, StsMemory, offset_word
from sim_backend.servos.sts.state import TABLE_SIZE

SET_MIDDLE: Final = 128
"""Value of the torque switch that defines the current position as the middle position (2048)."""
MIDDLE: Final = 2048
REBOOT_S: Final = 0.8
"""Duration of a reboot according to the protocol manual, in seconds."""
RETURN_DELAY_UNIT_S: Final = 2e-6


class VirtualServo(PacketServo):
    """An STS servo on a virtual bus."""

    GROUP_READ: ClassVar[Code | None] = Code.SYNC_READ

    def __init__(
        self,
        model: ServoModel,
        servo_id: int,
        motor: MotorConstants | None = None,
        variant: StsVariant = AS_REIMPLEMENTED,
    ) -> None:
        """Create a servo. ``motor`` defaults to the motor of ``model``."""
        motor = motor or sts_motor(model)
        super().__init__(model, motor.gears)
        states = sts_states(motor, variant)
        self.memory: StsMemory = StsMemory(model, servo_id, states)
        self.firmware: StsFirmware = StsFirmware(self.memory, states, model.rated_voltage_v, variant)

    @property
    def deaf_s(self) -> float:
        """Remaining time during which the servo ignores all instructions, in seconds. The compiled firmware decrements
        this time."""
        return self.firmware.deaf_s

    @deaf_s.setter
    def deaf_s(self, seconds: float) -> None:
        self.firmware.deaf_s = seconds

    @property
    def return_delay_s(self) -> float:
        """Delay between an instruction and its reply, in seconds: the duration of one byte without traffic, plus the
        return delay register."""
        return BITS_PER_BYTE / self.baud + RETURN_DELAY_UNIT_S * self.memory.get(sts.return_delay)

    def answer(self, instruction: Instruction) -> bytes | None:
        """Execute an instruction and return the reply, or None if the servo sends none."""
        parameters, named = instruction.parameters, self.servo_id
        if instruction.code == Code.PING:
            return self._status(named)
        if instruction.code == Code.READ:
            if len(parameters) != 2 or parameters[0] >= TABLE_SIZE:
                return None
            return self._status(named, self.read(*parameters))
        if instruction.code == Code.REBOOT:
            self.power_cycle()
            self.deaf_s = REBOOT_S
            return None
        self._execute(instruction.code, parameters)
        return self._status(named) if self.memory.answers == 2 else None  # The write may have changed the status level.

    def _execute(self, code: int, parameters: bytes) -> None:
        """Execute an instruction whose reply is an empty status packet. Unknown instructions have the same reply."""
        match code:
            case Code.WRITE if len(parameters) >= 2:
                self.write(parameters[0], parameters[1:])
            case Code.REG_WRITE:
                self._registered = (int.from_bytes(parameters[:1], "little"), parameters[1:])
                self.memory.put(sts.async_write_flag, 1)
            case Code.ACTION if self._registered is not None:
                registered, self._registered = self._registered, None
                self.memory.put(sts.async_write_flag, 0)
                if registered[1]:
                    self.write(*registered)
            case Code.RESET:
                self.memory.restore_defaults()
                self.power_cycle()
            case Code.SAVE_DEFAULTS:
                self.memory.save_defaults()
            case Code.FORGET_TURNS:
                self.firmware.forget_turns()
                self.memory.put(sts.torque_enable, 0)
            case Code.SET_MIDDLE if len(parameters) in (0, 2):
                count = int.from_bytes(parameters, "little", signed=True) if parameters else MIDDLE
                if abs(count) < self.model.counts_per_turn:
                    self.call_this_angle(count)

    def read(self, address: int, size: int) -> bytes:
        """Return ``size`` bytes of the control table at ``address``, with the values from the last millisecond."""
        return self._reported(address, TABLE_SIZE if address == size == 0 else size)

    def write(self, address: int, data: bytes) -> None:
        """Write bytes that came over the wire and apply all side effects. A write beyond the table has no effect."""
        if address >= TABLE_SIZE:
            return
        mode = self.memory.get(sts.operating_mode) if touches(address, len(data), sts.operating_mode) else None
        self.memory.write(address, data)
        self.firmware.note_write(address, len(data))
        if mode is not None and self.memory.get(sts.operating_mode) != mode:
            self.firmware.forget_turns()
            for register in (sts.torque_enable, sts.acceleration, sts.goal_velocity):
                self.memory.put(register, 0)
        if touches(address, len(data), sts.torque_enable) and self.memory.get(sts.torque_enable) == SET_MIDDLE:
            self.call_this_angle(MIDDLE)
            self.memory.put(sts.torque_enable, 0)

    def call_this_angle(self, count: int) -> None:
        """Set the homing offset so that the current shaft angle is reported as ``count``, and save the offset
        regardless of the lock."""
        self.memory.save(OFFSET_WORD, offset_word(self.firmware.raw_count - count))
        self.firmware.forget_turns()

    def power_cycle(self) -> None:
        """Switch the power off and on. Values that were not saved are lost, and the torque is disabled."""
        self._registered = None
        self.memory.power_up()
        self.firmware.restart()
