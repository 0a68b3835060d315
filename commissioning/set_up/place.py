"""A place in the arm: which servo a joint is to have, and what its EEPROM is to hold."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

from commissioning.errors import CommissioningError
from commissioning.provision import persistent_registers
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.servos import x
from drivers.servos.catalog import MODELS, series_of
from drivers.servos.dynamixel import X
from drivers.servos.feetech import STS
from drivers.servos.register import Register, ServoModel
from drivers.servos.series import Series
from hal.robot_file.robot_file import RobotFile

FACTORY_ID: Final = 1
"""Of every new servo, whatever its make."""
POSITION_MODES: Final[dict[str, int]] = {STS.name: 0, X.name: x.POSITION_MODE}


class SetUpError(CommissioningError):
    """A set-up that cannot go on; the text says what to do, and what has been done stays done."""


@dataclass(frozen=True, slots=True)
class Place:
    """One joint's servo as the robot file wants it."""

    joint: str
    servo_id: int
    model: ServoModel
    settings: tuple[tuple[str, int], ...] = ()
    extended: bool = False
    """Whether its servo, a Dynamixel X, was calibrated in extended position mode."""

    @property
    def series(self) -> Series:
        """The series of its servo."""
        return series_of(self.model)

    def basics(self) -> dict[Register, int]:
        """What the EEPROM of every servo is to hold, whatever its place: answers at once and to all, position mode."""
        series = self.series
        values = {"return_delay": 0, series.status_level.name: series.answers_all}
        if series.name in POSITION_MODES:
            values["operating_mode"] = x.EXTENDED_POSITION_MODE if self.extended else POSITION_MODES[series.name]
        return self._registers(values)

    def wanted(self) -> dict[Register, int]:
        """What the EEPROM is to hold in the end: the basics, the file's settings, the ID."""
        return self.basics() | self._registers(dict(self.settings) | {"id": self.servo_id})

    def _registers(self, values: Mapping[str, int]) -> dict[Register, int]:
        table = persistent_registers(self.model)
        return {table[name]: value for name, value in values.items() if name in table}

    def differs(self, bus: Bus, servo_id: int) -> dict[str, tuple[int, int]]:
        """What the servo that answers to this ID holds otherwise: by register, what it has and what it is to have."""
        held = {register: retry(partial(bus.read, servo_id, register)) for register in self.wanted()}
        return {r.name: (held[r], value) for r, value in self.wanted().items() if held[r] != value}


def places_of(robot: RobotFile, bus: str = "") -> list[Place]:
    """The places on one bus of a robot file, in the file's order."""
    return [
        Place(name, joint.servo_id, MODELS[joint.model], tuple(joint.settings.items()), joint.extended)
        for name, joint in robot.joints_on(bus).items()
    ]


def in_order(places: Sequence[Place]) -> list[Place]:
    """The places as people chain servos: from the gripper to the base.

    The one with the factory's ID comes last: until then whoever has that ID is new.
    """
    backwards = list(reversed(places))
    return sorted(backwards, key=lambda place: place.servo_id == FACTORY_ID)
