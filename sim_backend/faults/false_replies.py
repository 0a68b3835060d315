"""False values in replies with a correct checksum. By chance, one in 256 corrupted replies has a valid checksum."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from random import Random
from typing import Annotated, Any, Final, Literal, Self

from pydantic import Field

from drivers.servos import sts
from drivers.servos.catalog import registers_of
from drivers.servos.register import Register, ServoModel
from hal.plausible import Counts, Number, RegisterValue
from sim_backend.faults.event import Lasting, OfServo, model_of
from sim_backend.faults.tables import any_value, register_of, require_value
from sim_backend.faults.tails import either_way, log_uniform
from sim_backend.faults.targets import FaultTargets, Inventory, Since
from sim_backend.servos.generic.packet_servo import PacketServo

READ_IN_CYCLES: Final = (
    *("present_velocity", "present_speed", "present_load", "present_pwm", "present_current"),
    *("present_voltage", "present_temperature", "torque_enable", "status", "hardware_error_status"),
)
"""Registers, other than the position, that the stack reads in each cycle. No model has all of these registers."""
AT_THE_START: Final = 1 / 2
"""Fraction of drawn false-position faults that affect every second or third reply while the stack starts."""
LEAP_COUNTS: Final = (400, 2000)
"""Range of the difference between a true and a false position while the stack starts, in counts."""


class _FalseReplies(OfServo, Lasting):
    """Base class of faults in which a servo reports a false value once, in every reply that contains the value, or in
    every n-th such reply."""

    every: Annotated[Number, Field(ge=1)] = 1
    """Every n-th reply that contains the value is false, starting with the first reply."""
    replies: Annotated[Number, Field(ge=1)] | None = None
    """Number of false replies; None for no limit."""

    def _turns(self) -> Callable[[], bool]:
        """Return a function that decides whether the value in the next reply is false.

        Call this function once for each reply.
        """
        asked = 0

        def due() -> bool:
            nonlocal asked
            number, rest = divmod(asked, self.every)
            asked += 1
            return not rest and (self.replies is None or number < self.replies)

        return due

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        return {
            **super().draw_parameters(random, there),
            "every": random.choice((1, round(log_uniform(random, 1.0, 100.0)))),
            "replies": random.choice((1, round(log_uniform(random, 1.0, 100.0)), None)),
        }


class FalsePosition(_FalseReplies):
    """A servo reports a false position in a reply with a correct checksum.

    The servo's own control loop uses the true position.
    """

    kind: Literal["false_position"] = "false_position"
    counts: Counts = 1000
    """Number of counts added to the true position."""

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        servo = self.place(targets).servo
        register, due = servo.PRESENT_POSITION, self._turns()

        def falsify(address: int, size: int, data: bytes) -> bytes:
            true = servo.memory.get(register)
            further = true + self.counts
            fitting = register.fitting
            value = further if further in fitting else true - self.counts
            value = min(max(value, fitting.start), fitting.stop - 1)
            false = _with(servo, register, value, (address, size))
            return false if false != data and due() else data  # Equal data means that the reply has no position.

        with _reporting(servo.on_read, falsify):
            yield

    @classmethod
    def drawn(cls, random: Random, there: Inventory, at_s: float, since: Since = "up") -> Self:
        """Draw a fault. In half of these faults, the position jumps back and forth while the stack starts, because a
        false reading at startup could become the first goal."""
        fault = super().drawn(random, there, at_s, since)
        if there.start_s is None or "start" not in there.moments or random.random() >= AT_THE_START:
            return fault
        start_s = {"since": "start", "at_s": round(random.uniform(0.0, 0.2 * there.start_s), 4), "for_s": there.start_s}
        counts = either_way(random, random.randint(*LEAP_COUNTS))
        return fault.model_copy(update={**start_s, "every": random.choice((2, 3)), "replies": None, "counts": counts})

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        counts = either_way(random, round(log_uniform(random, 1.0, 4096.0)))
        return {**super().draw_parameters(random, there), "counts": counts}


class FalseValue(_FalseReplies):
    """A servo reports a false value of one register, such as `status`, in a reply with a correct checksum."""

    kind: Literal["false_value"] = "false_value"
    register_name: str
    """Register name, as in `servoloop register list`. The value of `status` is also sent as the error byte of each
    reply."""
    value: RegisterValue
    """Raw value of the register, without a unit."""

    def refuse_model(self, model: ServoModel, there: Inventory) -> None:
        register = register_of(model, self.register_name)
        require_value(register, self.value)

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        servo, due = self.place(targets).servo, self._turns()
        register = register_of(servo.model, self.register_name)

        def falsify(address: int, size: int, data: bytes) -> bytes:
            false = _with(servo, register, self.value, (address, size))
            return false if false != data and due() else data

        with ExitStack() as false:
            false.enter_context(_reporting(servo.on_read, falsify))
            if register.name == sts.status.name and isinstance(servo, PacketServo):
                false.enter_context(_reporting(servo.on_status, lambda true: self.value if due() else true))
            yield

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        parameters = super().draw_parameters(random, there)
        registers = registers_of(model_of(parameters, there))
        register = random.choice([register for register in registers if register.name in READ_IN_CYCLES])
        return {**parameters, "register_name": register.name, "value": any_value(random, register)}


def _with(servo: Any, register: Register, value: int, part: tuple[int, int]) -> bytes:
    """Return a segment (address, size) of the servo's control table as if the register had this value."""
    memory = servo.memory
    true = memory.get(register)
    with suppress(LookupError):  # A false baud_rate may be no rate. Its bytes are in the table nevertheless.
        memory.put(register, value)
    data: bytes = memory.read(*part)
    memory.put(register, true)
    return data


@contextmanager
def _reporting(hooks: list[Any], falsify: Callable[..., Any]) -> Iterator[None]:
    hooks.append(falsify)
    try:
        yield
    finally:
        hooks.remove(falsify)
