"""What the layer above may ask of a servo bus, whatever the make of the servos.

A group read returns a value or a fault for each servo: a silent servo never hides the others.
"""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

from drivers.counters import BusCounters
from drivers.errors import ServoError
from drivers.registers import Register, ServoModel
from drivers.turns import Steps

FaultKind = Literal["silent", "corrupt", "late", "refused", "reset"]
"""No reply; one that does not hold together; a stale one, which belongs to an earlier request; one that says that
the question cannot be answered; one that shows that the servo has lost its memory, so its torque and its goal too."""


class ServoState(NamedTuple):
    """One servo's state from one reply. ``alarms`` are the names of the status bits that are set.

    A tuple, because a cycle makes one for every servo and a frozen dataclass takes four times as long.
    """

    position_counts: int
    velocity_counts_s: int
    load: float
    """Drive as a share of full drive, -1 to 1."""
    voltage_v: float
    temperature_c: float
    alarms: tuple[str, ...] = ()
    current_a: float | None = None
    """Of the motor, negative where it drives backwards; None where it is not among what is read."""


@dataclass(frozen=True, slots=True)
class ServoFault:
    """Why there is no state."""

    kind: FaultKind
    text: str


Reading = ServoState | ServoFault


@dataclass(frozen=True, slots=True)
class ServoGoal:
    """Where to go, and how fast: ``velocity_counts_s`` 0 means as fast as the servo can."""

    position_counts: int
    velocity_counts_s: int = 0


class ServoBus(Protocol):
    """One line of servos. One transaction at a time, from one thread.

    Single-servo calls raise ServoError; every call raises PortLost once the line is gone. What set-up needs makes up
    for lost packets (drivers/tries.py): ``identify``, ``goal``, ``position_limits``, ``torque_is_on`` without a
    deadline, ``limit_torque``.
    """

    @property
    def name(self) -> str:
        """The port's name."""
        ...

    @property
    def baud(self) -> int:
        """The rate of the line, in bits per second."""
        ...

    @property
    def counters(self) -> BusCounters:
        """What went wrong since the bus was opened, by servo and kind."""
        ...

    def identify(self, servo_id: int, model: ServoModel) -> None:
        """Raise ServoSilent or ServoRefused unless the servo is there, of this model and set up to be driven."""
        ...

    def check_settings(self, servo_id: int, model: ServoModel) -> None:
        """Raise ServoRefused unless it is set up to be driven, as a servo with this model's table is.

        ServoSilent or ServoCorrupt where that cannot be found out.
        """
        ...

    def read(self, servo_id: int, register: Register) -> int:
        """One register of one servo."""
        ...

    def write(self, servo_id: int, register: Register, value: int) -> None:
        """One register of one servo, acknowledged."""
        ...

    def ping(self, servo_id: int) -> None:
        """Raise ServoSilent unless it is there."""
        ...

    def broadcast_ping(self) -> tuple[int, ...]:
        """Who is there, by one question to all. DriverError where the protocol has none: all would answer at once."""
        ...

    def reg_write(self, servo_id: int, register: Register, value: int) -> None:
        """``write``, acknowledged, but done only at the next ``action``."""
        ...

    def action(self) -> None:
        """Every servo does what ``reg_write`` gave it, all at once. Nobody answers."""
        ...

    def reboot(self, servo_id: int) -> None:
        """As if its supply were switched off and on: the torque goes off, and it is deaf for up to a second.

        Raises ServoRefused where its protocol has no such instruction.
        """
        ...

    def factory_reset(self, servo_id: int) -> None:
        """Its settings become the factory's. All keep their ID but those of Dynamixel protocol 1.0, which get ID 1."""
        ...

    def read_states(self, servo_ids: Sequence[int], deadline_s: float | None = None) -> Mapping[int, Reading]:
        """The state of each servo, or its fault, in one exchange.

        With a deadline on the bus's clock, as a cycle has one: what is missing is asked for again
        while there is time, and a servo known to be silent is not waited for in every cycle.
        """
        ...

    def state_steps(self, servo_ids: Sequence[int], deadline_s: float) -> Steps[Mapping[int, Reading]]:
        """``read_states`` in steps, for ``drivers.turns.overlapped``."""
        ...

    def exchange(
        self, goals: Mapping[int, ServoGoal], servo_ids: Sequence[int], deadline_s: float
    ) -> Mapping[int, Reading]:
        """``read_states`` and ``write_goals`` of one cycle, in the order that is quickest on this line."""
        ...

    def exchange_size(self, goals: Mapping[int, ServoGoal], servo_ids: Sequence[int]) -> int:
        """Bytes that such an exchange puts on the wire, where nothing goes wrong."""
        ...

    def write_goals(self, goals: Mapping[int, ServoGoal]) -> None:
        """A goal for each servo, in one packet that nobody acknowledges."""
        ...

    def goal(self, servo_id: int) -> int:
        """The goal position that the servo holds, in counts."""
        ...

    def position_limits(self, servo_id: int) -> tuple[int, int] | None:
        """The lowest and the highest goal that the servo's settings let it take, in counts; None where it has none."""
        ...

    def torque_is_on(self, servo_id: int, deadline_s: float | None = None) -> bool:
        """Whether the servo drives its motor. With a deadline: given up then, and not asked where there is no time."""
        ...

    def torque_on(self, servo_id: int) -> None:
        """Drive the motor. The caller has written the goal before.

        Told once: of a servo that does not acknowledge it nobody knows whether it was reset, and has its goal still.
        """
        ...

    def torque_off(self, servo_ids: Sequence[int]) -> list[ServoError]:
        """Let go of every servo, each tried whatever the others answer; returns what failed."""
        ...

    def limit_torque(self, servo_id: int, share: float) -> None:
        """Limit the drive to a share (0 to 1) of full drive until power-off."""
        ...

    def at_baud(self, baud: int) -> AbstractContextManager["ServoBus"]:
        """The same line at another rate, to see who is there. Raises PortError where the adapter cannot."""
        ...

    def close(self) -> None:
        """Give the port back."""
        ...
