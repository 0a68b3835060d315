"""Base classes of all virtual servos, and of servos with Feetech or Dynamixel protocol 1.0 packets."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar, Protocol

from drivers.servos import sts
from drivers.servos.register import Register, ServoModel
from sim_backend.flash import Flash, Kept
from sim_backend.mechanics.gears import Gears
from sim_backend.packets.instructions import Instruction
from sim_backend.packets.sts import Code, status_packet


class Table(Protocol):
    """The part of the control table interface that a servo bus uses."""

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


class Fed(Protocol):
    """The part of a servo's firmware that a rig uses."""

    voltage_v: float

    @property
    def supply_current_a(self) -> float: ...

    def observe(self, angle_rad: float) -> None: ...


class Driven(Fed, Protocol):
    """The part of the firmware interface that a bus uses."""

    @property
    def status(self) -> int: ...

    def step(self, dt_s: float, angle_rad: float, velocity_rad_s: float) -> float: ...


class WiredServo(ABC):
    """A servo on a virtual bus. The bus passes instructions to the servo and advances it."""

    BOOT_S: ClassVar[float] = 0.8
    """Time from power-on to the first reply, in seconds. Feetech's protocol manual specifies this time for a reboot."""
    PRESENT_POSITION: ClassVar[Register] = sts.present_position
    memory: Table
    firmware: Driven

    def __init__(self, model: ServoModel, gears: Gears | None = None) -> None:
        """Create a servo. ``gears`` are the identified gears, if they are known."""
        self.model = model
        self.gears = gears
        self.on_read: list[Callable[[int, int, bytes], bytes]] = []
        """Functions that replace the data of a reply with false data. Each function accepts the address, the size and
        the true bytes, and returns the bytes to send."""
        self.on_status: list[Callable[[int], int]] = []
        """Functions that replace the error byte of a reply with a false error byte. Each function accepts the true
        status and returns the status to send."""
        self._registered: tuple[int, bytes] | None = None
        self._deaf_s = 0.0

    @property
    def servo_id(self) -> int:
        """Current ID of the servo."""
        return self.memory.servo_id

    @property
    def baud(self) -> int:
        """Baud rate of the servo, in bits per second."""
        return self.memory.baud

    @property
    @abstractmethod
    def return_delay_s(self) -> float:
        """Delay from an instruction to its reply, in seconds."""

    @property
    def deaf_s(self) -> float:
        """Remaining time of a restart, in seconds; during this time, the servo ignores all instructions."""
        return self._deaf_s

    @deaf_s.setter
    def deaf_s(self, seconds: float) -> None:
        self._deaf_s = seconds

    @property
    def deaf(self) -> bool:
        """Whether the servo is rebooting."""
        return self.deaf_s > 0.0

    def step(self, dt_s: float, angle_rad: float, velocity_rad_s: float) -> float:
        """Advance the firmware by ``dt_s``. Return the torque on the shaft (N m)."""
        if self._deaf_s > 0.0:
            self._deaf_s -= dt_s
        return self.firmware.step(dt_s, angle_rad, velocity_rad_s)

    @abstractmethod
    def answer(self, instruction: Instruction) -> bytes | None:
        """Execute an instruction and return the reply, or None if the servo does not reply."""

    @abstractmethod
    def read_status(self, address: int, size: int) -> bytes:
        """Return the status packet that contains the current values of ``size`` bytes from ``address``."""

    def _reported(self, address: int, size: int) -> bytes:
        """Return bytes of the table as they appear in a reply, including the effects of injected faults."""
        data = self.memory.read(address, size)
        for falsify in self.on_read:
            data = falsify(address, size, data)
        return data

    @abstractmethod
    def power_cycle(self) -> None:
        """Switch the power off and on. Values that were not saved are lost, and the torque is disabled."""


class PacketServo(WiredServo):
    """A servo that uses Feetech or Dynamixel protocol 1.0 status packets."""

    GROUP_READ: ClassVar[Code | None]
    """Instruction that reads this servo together with other servos; None if there is no such instruction."""

    @abstractmethod
    def read(self, address: int, size: int) -> bytes:
        """Return ``size`` bytes of the table at ``address``, updated with the present state."""

    @abstractmethod
    def write(self, address: int, data: bytes) -> None:
        """Write bytes that came over the wire and apply all side effects."""

    def read_status(self, address: int, size: int) -> bytes:
        return self._status(self.servo_id, self.read(address, size))

    def _status(self, servo_id: int, data: bytes = b"") -> bytes:
        status = self.firmware.status
        for falsify in self.on_status:
            status = falsify(status)
        return status_packet(servo_id, status, data)
