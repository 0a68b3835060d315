"""Find a servo by its ID at any baud rate, for tools that work on a single servo.

with find_servo(port, clock, 3) as servo:  # the port is at the servo's rate
    print(servo.model.name, servo.bus.read(3, servo.series.torque_enable))
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from types import ModuleType
from typing import Final

from commissioning.commissioning_errors import CommissioningError
from commissioning.scan.examine import examine_servo
from commissioning.scan.identify import Identity, identify, retry_often
from commissioning.scan.steps import ScanStep, steps
from commissioning.scan.wire import Wire
from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.driver_errors import PortError, PortLost, ServoError, ServoRefused
from drivers.port import Port
from drivers.servos.catalog import series_of
from drivers.servos.register import Register, ServoModel
from drivers.servos.series import Series

PINGS: Final = 3


@dataclass(frozen=True, slots=True)
class FoundServo:
    """A servo that responds at the port's current baud rate."""

    port: Port
    clock: Clock
    packets: ModuleType
    servo_id: int
    identity: Identity

    @property
    def series(self) -> Series:
        """Series of the servo.

        If the model is unknown, its control table is also unknown, and CommissioningError is raised.
        """
        return series_of(self.model)

    @property
    def model(self) -> ServoModel:
        """Model of the servo. Raises CommissioningError if the model number is unknown."""
        if self.identity.model is not None:
            return self.identity.model
        raise CommissioningError(
            f"servo {self.servo_id}: the control table of its model (number {self.identity.number}) is unknown, so "
            "nothing was read or written by name. Pass --address and --size from the servo's manual to "
            "'servoloop register', or add the model: docs/add-a-servo.md"
        )

    @property
    def name(self) -> str:
        """Name of the model, or its number if the model is unknown."""
        return self.identity.model.name if self.identity.model else f"model number {self.identity.number}"

    @property
    def bus(self) -> Bus:
        """New bus object for the servo, at the port's current baud rate."""
        return Bus(self.port, self.clock, {self.servo_id: self.identity.stand_in})

    def read(self, register: Register) -> int:
        """Read a register, using many attempts."""
        return retry_often(partial(self.bus.read, self.servo_id, register))

    def holds_torque(self) -> bool:
        """Return whether torque is enabled."""
        return self.read(self.series.torque_enable) == 1


@contextmanager
def find_servo(port: Port, clock: Clock, servo_id: int, bauds: Iterable[int] = ()) -> Iterator[FoundServo]:
    """Find the servo with this ID, and keep the port at the servo's baud rate until the context ends.

    Raises CommissioningError if no servo with this ID responds at any baud rate (or at ``bauds``), or if two servos
    have this ID.
    """
    former = port.baud
    try:
        yield locate(port, clock, servo_id, tuple(bauds))
    finally:
        _set_back(port, former)


def answers(port: Port, clock: Clock, packets: ModuleType, servo_id: int) -> bool:
    """Return whether this ID responds at the port's current baud rate, even if the replies are corrupted."""
    wire = Wire(port, clock, packets)
    if servo_id > wire.largest_id:
        return False
    wire.learn_echo()
    return any(servo_id in heard.whole | heard.broken for heard in (wire.ping(servo_id) for _ in range(PINGS)))


def answering_step(port: Port, clock: Clock, servo_id: int, tried: Iterable[ScanStep]) -> ScanStep | None:
    """Return the first step in which the servo responds to pings, or None. The port stays at the baud rate of this
    step."""
    for step in tried:
        try:
            port.set_baud(step.baud)
        except PortLost:
            raise
        except PortError:  # The adapter does not support this rate.
            continue
        if answers(port, clock, step.packets, servo_id):
            return step
    return None


def locate(port: Port, clock: Clock, servo_id: int, bauds: tuple[int, ...] = ()) -> FoundServo:
    """Find the servo with this ID as ``find_servo`` does, but leave the port at the servo's baud rate."""
    if step := answering_step(port, clock, servo_id, steps(bauds=bauds)):
        return _sole(port, clock, step, servo_id)
    tried = f"{' or '.join(map(str, bauds))} baud" if bauds else "any baud rate"
    raise CommissioningError(
        f"no servo with ID {servo_id} responds at {tried}. Check its power and its cable, and list the servos on "
        f"the port with 'servoloop scan {port.name}'"
    )


def _sole(port: Port, clock: Clock, step: ScanStep, servo_id: int) -> FoundServo:
    """Return the servo with this ID.

    Raises CommissioningError if two servos have this ID, or if the servo cannot be read.
    """
    seen = examine_servo(port, clock, step, servo_id)
    for problem in seen.problems if seen else ():
        if problem.kind in ("collision", "no_reads", "late"):
            raise CommissioningError(f"servo {servo_id}: {problem.text}")
    try:
        return FoundServo(port, clock, step.packets, servo_id, identify(port, clock, step.packets, servo_id))
    except ServoRefused:
        raise
    except ServoError as error:
        raise CommissioningError(f"servo {servo_id}: {error.text}") from error


def _set_back(port: Port, baud: int) -> None:
    try:
        port.set_baud(baud)
    except PortError:  # The port has disappeared, so its next user gets an error.
        return
