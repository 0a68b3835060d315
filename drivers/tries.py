"""One lost packet must not fail a whole set-up: what is asked again, and how often. Never in a cycle."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from functools import partial
from typing import Final, TypeVar

from drivers.errors import ServoCorrupt, ServoError, ServoSilent
from drivers.registers import Register

ATTEMPTS: Final = 4
"""On a line that loses 9 % of all answers, one question in 15000 stays open by chance; a set-up has about a hundred."""

Result = TypeVar("Result")


def tried(question: Callable[[], Result]) -> Result:
    """Its answer, or what the last attempt raised."""
    for _ in range(ATTEMPTS - 1):
        try:
            return question()
        except (ServoSilent, ServoCorrupt):
            continue
    return question()


def tried_with_each(servo_ids: Sequence[int], do: Callable[[int], None]) -> list[ServoError]:
    """``do`` for every servo, whatever the others answer; what failed."""
    failed: list[ServoError] = []
    for servo_id in servo_ids:
        try:
            do(servo_id)
        except ServoError as error:
            failed.append(error)
    return failed


class SureCalls(ABC):
    """For a bus's set-up, and for what it asks within a cycle by a deadline."""

    def __init__(self, until: Callable[[int, float], AbstractContextManager[None]]) -> None:
        """``until``: that of ``drivers.questions.Questions``."""
        self._until = until

    @abstractmethod
    def read(self, servo_id: int, register: Register) -> int:
        """One register, asked for once."""

    @abstractmethod
    def write(self, servo_id: int, register: Register, value: int) -> None:
        """One register, acknowledged, told once."""

    def _read_surely(self, servo_id: int, register: Register, deadline_s: float | None = None) -> int:
        """One register; with a deadline, once."""
        if deadline_s is None:
            return tried(partial(self.read, servo_id, register))
        with self._until(servo_id, deadline_s):
            return self.read(servo_id, register)

    def _limits(self, servo_id: int, registers: tuple[Register, Register]) -> tuple[int, int] | None:
        """The lowest and the highest goal; both 0 is a servo without such a setting, or a simulator's empty table."""
        lowest, highest = (self._read_surely(servo_id, register) for register in registers)
        return (lowest, highest) if (lowest, highest) != (0, 0) else None

    def _write_surely(self, servo_id: int, register: Register, value: int) -> None:
        """One register of RAM: written twice, it holds what it holds after once."""
        tried(partial(self.write, servo_id, register, value))
