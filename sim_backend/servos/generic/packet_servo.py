"""What all virtual servos have in common, and those asked by Feetech's packets or Dynamixel's of protocol 1.0."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar, Protocol

from drivers.servos import sts
from drivers.servos.register import Register, ServoModel
from sim_backend.flash import Flash, Kept
from sim_backend.line.rig import Fed
from sim_backend.mechanics.gears import Gears
from sim_backend.packets.instructions import Instruction
from sim_backend.packets.sts import Code, status_packet


class Table(Protocol):
    """The control table, as far as a line of servos asks for it."""

    @property
    def servo_id(self) -> int: ...

    @property
    def baud(self) -> int: ...

    def get(self, register: Register) -> int: ...

    def put(self, register: Register, value: int) -> None: ...

    def save(self, register: Register, value: int) -> None: ...

    def read(self, address: int, size: int) -> bytes: ...

    @property
    def flash(self) -> Flash: ...

    @flash.setter
    def flash(self, flash: Flash) -> None: ...

    @property
    def kept(self) -> Kept: ...


class Driven(Fed, Protocol):
    """The firmware, as far as the line asks for it."""

    @property
    def status(self) -> int: ...

    def step(self, dt_s: float, angle_rad: float, velocity_rad_s: float) -> float: ...


class WiredServo(ABC):
    """A servo below the wire. The bus hands it instructions and steps it."""

    BOOT_S: ClassVar[float] = 0.8
    """From power-on to the first answer: Feetech's protocol manual says it of a reboot."""
    PRESENT_POSITION: ClassVar[Register] = sts.present_position
    memory: Table
    firmware: Driven

    def __init__(self, model: ServoModel, gears: Gears | None = None) -> None:
        """``gears``: where anybody has identified them."""
        self.model = model
        self.gears = gears
        self.on_read: list[Callable[[int, int, bytes], bytes]] = []
        """Faults of a reply's data: address, size and the true bytes in, the bytes of the reply out."""
        self.on_status: list[Callable[[int], int]] = []
        """Faults of the error byte: the true alarms in, those of the reply out."""
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
    @abstractmethod
    def return_delay_s(self) -> float:
        """From an instruction to the reply."""

    @property
    def deaf_s(self) -> float:
        """For how long it will not hear anything, because it starts."""
        return self._deaf_s

    @deaf_s.setter
    def deaf_s(self, seconds: float) -> None:
        self._deaf_s = seconds

    @property
    def deaf(self) -> bool:
        """Whether it is rebooting."""
        return self.deaf_s > 0.0

    def step(self, dt_s: float, angle_rad: float, velocity_rad_s: float) -> float:
        """Advance the firmware by ``dt_s``; returns the torque on the shaft, N m."""
        if self._deaf_s > 0.0:
            self._deaf_s -= dt_s
        return self.firmware.step(dt_s, angle_rad, velocity_rad_s)

    @abstractmethod
    def answer(self, instruction: Instruction) -> bytes | None:
        """Do what one instruction says; the reply, if this servo makes one to it."""

    @abstractmethod
    def read_status(self, address: int, size: int) -> bytes:
        """The status packet with ``size`` bytes from ``address``, the state as of now."""

    def _reported(self, address: int, size: int) -> bytes:
        """Bytes of the table as a reply carries them."""
        data = self.memory.read(address, size)
        for falsify in self.on_read:
            data = falsify(address, size, data)
        return data

    @abstractmethod
    def power_cycle(self) -> None:
        """Power off and on again: what was not saved is gone, the motor is free."""


class PacketServo(WiredServo):
    """A servo whose status packets are Feetech's, or those of protocol 1.0."""

    GROUP_READ: ClassVar[Code | None]
    """The instruction that asks it together with others."""

    @abstractmethod
    def read(self, address: int, size: int) -> bytes:
        """``size`` bytes of the table from ``address``, the state as of now."""

    @abstractmethod
    def write(self, address: int, data: bytes) -> None:
        """A write from the wire and all that follows from it."""

    def read_status(self, address: int, size: int) -> bytes:
        return self._status(self.servo_id, self.read(address, size))

    def _status(self, servo_id: int, data: bytes = b"") -> bytes:
        status = self.firmware.status
        for falsify in self.on_status:
            status = falsify(status)
        return status_packet(servo_id, status, data)
