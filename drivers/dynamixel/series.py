"""What a series of servos with one table is to the bus, and a state block: what is read of a servo in one piece."""

from collections.abc import Callable
from dataclasses import dataclass
from struct import Struct
from typing import Final

from drivers.bus import ServoGoal, ServoState
from drivers.dynamixel.wire import ALERT, NO_ACCESS, error_text
from drivers.readings import Outcome, refused
from drivers.registers import Register, ServoModel

Read = Callable[[Register], int]

ALARMED: Final = ("hardware error",)
"""What the alert bit says by itself. Which error it is stands in a register that not every block has."""


@dataclass(frozen=True, slots=True, eq=False)
class StateBlock:
    """``size`` bytes from ``address`` that end with the state.

    ``fields`` are the state's numbers for ``struct``, at the block's end; ``state`` makes values of the
    servo's unit of current (A; None where it measures none), of the reply's error byte and of them.
    ``proof``: some of these numbers, by their place, and what each of them is as long as the block is what
    it is taken for; otherwise the numbers mean nothing.
    """

    address: int
    size: int
    fields: Struct
    state: Callable[..., ServoState]
    fast: bool
    """Whether some firmware answers a fast sync read of it."""
    proof: tuple[tuple[int, int], ...] = ()

    def decode(self, error: int, data: bytes, unit_a: float | None = None) -> ServoState | None:
        """The state in one reply's data; None without proof."""
        numbers = self.fields.unpack_from(data, self.size - self.fields.size)
        if any(numbers[place] != value for place, value in self.proof):
            return None
        return self.state(unit_a, error, *numbers)

    def outcome(self, servo_id: int, error: int, data: bytes, unit_a: float | None = None) -> Outcome:
        """What one reply says."""
        if number := error & ~ALERT:
            # Nothing where the map's cells should be: it is another servo than the one that was mapped.
            return "reset" if self.proof and number == NO_ACCESS else refused(servo_id, f"it {error_text(number)}")
        return self.decode(error, data, unit_a) or "reset"


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """Servos with one table.

    ``blocks``: what may be asked for, all of one state but of different sizes, the shortest first: a servo
    that owes an answer is asked for another. ``misfit`` reads a servo's settings: why they do not fit, if so.
    """

    name: str
    models: tuple[ServoModel, ...]
    blocks: tuple[StateBlock, ...]
    goal_address: int
    goal_size: int
    goal: Callable[[ServoGoal], bytes]
    torque_enable: Register
    goal_position: Register
    position_limits: tuple[Register, Register]
    """The lowest and the highest goal."""
    hardware_error_status: Register
    alarms: Callable[[int], tuple[str, ...]]
    before_torque: tuple[tuple[Register, int], ...]
    position_p: Register
    torque_limit: Register
    torque_ceiling: Register
    """What ``torque_limit`` must not exceed."""
    full_torque: int
    misfit: Callable[[Read], str | None]


def blocks(
    start: tuple[Register, ...], end: int, fields: Struct, state: Callable[..., ServoState], *, fast: bool
) -> tuple[StateBlock, ...]:
    """Blocks that begin with these registers, all with one end, where the state is."""
    return tuple(StateBlock(first.address, end - first.address, fields, state, fast) for first in start)


def alarmed(error: int) -> tuple[str, ...]:
    """What the reply's error byte by itself says of alarms."""
    return ALARMED if error & ALERT else ()
