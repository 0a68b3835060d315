"""One virtual servo other than STS: control table, firmware and instructions.

Assumed, because the manuals do not describe it: the reply to a write of the ID or the baud rate uses the old ID.
The servo does not reply to malformed or unknown instructions, or to reads of more bytes than fit into a reply. A
rebooting servo ignores all instructions.
"""

from typing import ClassVar

from drivers.servos import sts
from drivers.servos.register import Register, ServoModel
from sim_backend.packets.instructions import Instruction
from sim_backend.packets.sts import LONGEST_DATA, Code
from sim_backend.servos.generic.firmware import GenericFirmware
from sim_backend.servos.generic.memory import Memory, touches
from sim_backend.servos.generic.packet_servo import PacketServo


class GenericServo(PacketServo):
    """A servo whose table and firmware depend on its series."""

    REBOOTS: ClassVar[bool] = True
    """Whether the servo supports the reboot instruction."""

    def __init__(self, model: ServoModel, memory: Memory, firmware: GenericFirmware) -> None:
        super().__init__(model)
        self.memory: Memory = memory
        self.firmware: GenericFirmware = firmware

    @property
    def return_delay_s(self) -> float:
        """Delay from an instruction to its reply, in seconds: 2 us per unit, at least 2 us."""
        return 2e-6 * max(1, self.memory.get(sts.return_delay))

    def answer(self, instruction: Instruction) -> bytes | None:
        """Execute an instruction and return the reply, or None if the servo sends none."""
        servo_id, answers = self.servo_id, self.memory.answers
        parameters = instruction.parameters
        match instruction.code:
            case Code.PING:
                return self._status(servo_id)
            case Code.READ if len(parameters) == 2 and parameters[1] <= LONGEST_DATA:
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
                self.deaf_s = self.BOOT_S
                return None
            case _:
                return None
        return self._status(servo_id) if answers == 2 else None

    def read(self, address: int, size: int) -> bytes:
        """Return ``size`` bytes of the table from ``address``, with the present state."""
        self.firmware.publish()
        return self._reported(address, size)

    def write(self, address: int, data: bytes) -> None:
        """Write bytes that came over the wire and apply all side effects."""
        self.memory.write(address, data)
        if address < self.memory.EEPROM_END:
            self.firmware.load_settings()
        self.firmware.load_goal()
        if self._covers(address, data, sts.goal_position):
            self.firmware.goal_written()
        if self._covers(address, data, sts.torque_enable):
            self.firmware.torque_written()

    def power_cycle(self) -> None:
        """Switch the power off and on. Values that were not saved are lost, and the torque is disabled."""
        self._registered = None
        self.memory.power_up()
        self.firmware.restart()

    def _act(self) -> None:
        if self._registered is not None:
            address, data = self._registered
            self._registered = None
            self.memory.put(sts.async_write_flag, 0)
            self.write(address, data)

    def _covers(self, address: int, data: bytes, register: Register) -> bool:
        """Return whether a write of ``data`` at ``address`` includes a byte of ``register``."""
        own = self.memory.own(register)
        return own is not None and touches(address, len(data), own)
