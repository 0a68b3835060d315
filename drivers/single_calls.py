"""The calls of a ServoBus to one servo, whatever the packets: passed on, and made again where set-up needs them."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from typing import Protocol

from drivers.registers import Register
from drivers.tries import tried


class OneServo(Protocol):
    """What one servo is asked and told in one protocol, through the maker's SDK."""

    @property
    def until(self) -> Callable[[int, float], AbstractContextManager[None]]:
        """That of ``drivers.questions.Questions``."""
        ...

    def ping(self, servo_id: int) -> None: ...
    def broadcast_ping(self) -> tuple[int, ...]: ...
    def read(self, servo_id: int, register: Register) -> int: ...
    def write(self, servo_id: int, register: Register, value: int) -> None: ...
    def reg_write(self, servo_id: int, register: Register, value: int) -> None: ...
    def action(self) -> None: ...
    def reboot(self, servo_id: int) -> None: ...
    def factory_reset(self, servo_id: int) -> None: ...


class SingleCalls:
    """A bus's calls that go straight to the SDK, once; and for its own use, those that make up for lost packets."""

    def __init__(self, one_servo: OneServo) -> None:
        self._one_servo = one_servo

    def ping(self, servo_id: int) -> None:
        """Raise ServoSilent unless it is there."""
        self._one_servo.ping(servo_id)

    def broadcast_ping(self) -> tuple[int, ...]:
        """Who is there; DriverError where the protocol has none."""
        return self._one_servo.broadcast_ping()

    def read(self, servo_id: int, register: Register) -> int:
        """One register."""
        return self._one_servo.read(servo_id, register)

    def write(self, servo_id: int, register: Register, value: int) -> None:
        """One register, acknowledged."""
        self._one_servo.write(servo_id, register, value)

    def reg_write(self, servo_id: int, register: Register, value: int) -> None:
        """``write`` at the next ``action``."""
        self._one_servo.reg_write(servo_id, register, value)

    def action(self) -> None:
        """Of all servos."""
        self._one_servo.action()

    def reboot(self, servo_id: int) -> None:
        """As if its supply were switched off and on."""
        self._one_servo.reboot(servo_id)

    def factory_reset(self, servo_id: int) -> None:
        """All settings; ID and baud rate as the protocol has it."""
        self._one_servo.factory_reset(servo_id)

    def _read_surely(self, servo_id: int, register: Register, deadline_s: float | None = None) -> int:
        """One register; with a deadline, once."""
        if deadline_s is None:
            return tried(partial(self.read, servo_id, register))
        with self._one_servo.until(servo_id, deadline_s):
            return self.read(servo_id, register)

    def _write_surely(self, servo_id: int, register: Register, value: int) -> None:
        """One register of RAM: written twice, it holds what it holds after once."""
        tried(partial(self.write, servo_id, register, value))

    def _limits(self, servo_id: int, registers: tuple[Register, Register]) -> tuple[int, int] | None:
        """The lowest and the highest goal; both 0 is a servo without such a setting, or a simulator's empty table."""
        lowest, highest = (self._read_surely(servo_id, register) for register in registers)
        return (lowest, highest) if (lowest, highest) != (0, 0) else None
