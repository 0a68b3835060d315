"""One servo on a line, found by its ID at whatever rate it answers: what the tools for single servos begin with.

with find_servo(port, clock, 3) as servo:  # the port is at the servo's rate
    print(servo.model.name, servo.bus.read(3, servo.series.torque_enable))
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from types import ModuleType
from typing import Final

from commissioning.errors import CommissioningError
from commissioning.scan.examine import look
from commissioning.scan.identify import Identity, identify, surely
from commissioning.scan.steps import Step, steps
from commissioning.scan.wire import Wire
from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.errors import PortError, PortLost, ServoError, ServoRefused
from drivers.port import Port
from drivers.servos.register import Register, ServoModel
from drivers.servos.series import Series

PINGS: Final = 3


@dataclass(frozen=True, slots=True)
class FoundServo:
    """One servo that answers, and the bus to it at its rate."""

    port: Port
    clock: Clock
    packets: ModuleType
    servo_id: int
    identity: Identity

    @property
    def series(self) -> Series:
        """Its table."""
        return self.identity.series

    @property
    def model(self) -> ServoModel:
        """Its model, or one of its series where its number is unknown."""
        return self.identity.stand_in

    @property
    def name(self) -> str:
        """What to call it."""
        return self.identity.model.name if self.identity.model else f"model number {self.identity.number}"

    @property
    def bus(self) -> Bus:
        """A bus to it at the port's present rate."""
        return Bus(self.port, self.clock, {self.servo_id: self.model})

    def read(self, register: Register) -> int:
        """One register, however bad the line."""
        return surely(partial(self.bus.read, self.servo_id, register))

    def holds_torque(self) -> bool:
        """Whether it drives its motor."""
        return self.read(self.series.torque_enable) == 1


@contextmanager
def find_servo(port: Port, clock: Clock, servo_id: int, bauds: Iterable[int] = ()) -> Iterator[FoundServo]:
    """The servo with this ID, the port at its rate until the end.

    Raises CommissioningError where nobody answers at any rate (``bauds``: at these), or two servos do.
    """
    former = port.baud
    try:
        yield locate(port, clock, servo_id, tuple(bauds))
    finally:
        _set_back(port, former)


def answers(port: Port, clock: Clock, packets: ModuleType, servo_id: int) -> bool:
    """Whether anybody answers to this ID at the port's rate, in one piece or not."""
    wire = Wire(port, clock, packets)
    if servo_id > wire.largest_id:
        return False
    wire.learn_echo()
    return any(servo_id in heard.whole | heard.broken for heard in (wire.ping(servo_id) for _ in range(PINGS)))


def locate(port: Port, clock: Clock, servo_id: int, bauds: tuple[int, ...] = ()) -> FoundServo:
    """``find_servo`` that leaves the port at the servo's rate."""
    for step in steps(bauds=bauds):
        try:
            port.set_baud(step.baud)
        except PortLost:
            raise
        except PortError:  # a rate that the adapter cannot make
            continue
        if answers(port, clock, step.packets, servo_id):
            return _sole(port, clock, step, servo_id)
    tried = " or ".join(map(str, bauds)) or "any"
    raise CommissioningError(
        f"servo {servo_id}: nobody answers at {tried} baud: check its power and its cable. "
        "'servoloop scan' shows who is there"
    )


def _sole(port: Port, clock: Clock, step: Step, servo_id: int) -> FoundServo:
    """What answers, if it is one servo."""
    seen = look(port, clock, step, servo_id)
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
    except PortError:  # gone: whoever uses it next is told
        return
