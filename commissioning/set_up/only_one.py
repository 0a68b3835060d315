"""The one servo on the line: whether there is just one, and whether it may become what a place wants."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Final

from calibration.eeprom import CLOSED, OPEN, eeprom
from commissioning.errors import CommissioningError
from commissioning.provision import drives, persistent_registers, restart
from commissioning.registers.tables import rates_of
from commissioning.scan.answers import Answer, who_answers, who_answers_elsewhere
from drivers.bus.bus import Bus
from drivers.bus.confirm import confirmed_states
from drivers.bus.retry import retry
from drivers.bus.types import ServoState
from drivers.clock import Clock
from drivers.errors import ServoError
from drivers.servos import x
from drivers.servos.catalog import MODELS, known_as, series_of
from drivers.servos.dynamixel import X
from drivers.servos.feetech import STS
from drivers.servos.register import Register, ServoModel
from drivers.servos.series import Series
from drivers.servos.voltage import voltage_fault
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


LIMIT_UNIT_V: Final = 0.1
LIMITS: Final = (("min_voltage", "max_voltage"), ("min_voltage_limit", "max_voltage_limit"))
"""What tables call the voltages that a servo allows."""


class NotYet(SetUpError):
    """What the user can mend by connecting something else: it is asked for again."""


def only_servo(bus: Bus, rates: Sequence[int]) -> Answer:
    """The one servo that answers, at the line's rate or one of these. Raises NotYet where there is none, or several."""
    found = who_answers(bus) or who_answers_elsewhere(bus, [rate for rate in rates if rate != bus.baud])
    if not found:
        raise NotYet(
            f"no servo answers on {bus.name} at any baud rate: is its supply on, is its cable plugged in at both ends, "
            "is the adapter set to USB?"
        )
    ids = ", ".join(str(answer.servo_id) for answer in found)
    if len(found) > 1:
        raise NotYet(f"several servos answer (IDs {ids}): connect only one")
    if not found[0].clear:
        raise NotYet(f"servo {ids} never answers in one piece: several servos have ID {ids}, or the cable is bad: "
                     "connect only one")  # fmt: skip
    return found[0]


def require_fit(bus: Bus, servo_id: int, place: Place, places: Sequence[Place]) -> float:
    """The voltage (V) at a servo that may become the place's; ``bus`` is at its rate.

    Raises NotYet where it is another's, of another model or under torque; SetUpError for a wrong voltage.
    """
    owner = next((one.joint for one in places if one.servo_id == servo_id), None)
    if servo_id not in (FACTORY_ID, place.servo_id) and owner is not None:
        raise NotYet(f"this servo has ID {servo_id}, which is that of {owner}: it belongs there already")
    _require_model(bus, servo_id, place)
    voltage_v = voltage(bus, servo_id)
    _require_voltage(bus, servo_id, place, voltage_v)
    if drives(bus, servo_id, place.model):
        raise NotYet(
            f"servo {servo_id} holds torque, and nothing is written under torque: switch its supply off and on. What "
            "it holds falls then"
        )
    return voltage_v


def voltage(bus: Bus, servo_id: int) -> float:
    """What the servo measures at its supply, V."""
    return state_of(bus, servo_id).voltage_v


def state_of(bus: Bus, servo_id: int) -> ServoState:
    """The servo's state, whose position two readings in a row agree on. Raises NotYet."""
    state = confirmed_states(bus.read_states, [servo_id])[servo_id]
    if isinstance(state, ServoState):
        return state
    raise NotYet(f"{state.text}: is its plug loose?")


def _require_model(bus: Bus, servo_id: int, place: Place) -> None:
    number = retry(partial(bus.read, servo_id, place.series.model_number))
    if number != place.model.number:
        raise NotYet(
            f"servo {servo_id} is model {number} ({known_as(number, place.series)}), and {place.joint} has a "
            f"{place.model.name} ({place.model.number}) in the robot file"
        )


def _require_voltage(bus: Bus, servo_id: int, place: Place, voltage_v: float) -> None:
    rated_v, model = place.model.rated_voltage_v, place.model.name
    fault = voltage_fault(place.model, voltage_v)
    if fault is not None and fault.outside:
        fault_text = "too much" if fault.kind == "over-voltage" else "too little"
        raise SetUpError(
            f"{voltage_v:.1f} V is {fault_text} for a servo of {rated_v:.1f} V ({model}): switch the supply off, and "
            "connect the right one, or name the right model in the robot file"
        )
    lowest_v, highest_v = _limits(bus, servo_id, place)
    if not lowest_v <= voltage_v <= highest_v:
        raise SetUpError(
            f"servo {servo_id} measures {voltage_v:.1f} V, and allows {lowest_v:.1f} to {highest_v:.1f} V by its own "
            f"limits: is it a {model} of {rated_v:.1f} V, and the supply the right one?"
        )


def _limits(bus: Bus, servo_id: int, place: Place) -> tuple[float, float]:
    """The lowest and the highest voltage that the servo allows, V, or will allow by the robot file."""
    table, said = persistent_registers(place.model), dict(place.settings)
    names = next(names for names in LIMITS if names[0] in table)
    lowest, highest = (
        said[name] if name in said else retry(partial(bus.read, servo_id, table[name])) for name in names
    )
    return lowest * LIMIT_UNIT_V, highest * LIMIT_UNIT_V


def bring_to_rate(bus: Bus, clock: Clock, servo_id: int, model: ServoModel, rate: int) -> None:
    """Make a limp servo that answers at ``rate`` answer at the line's; it is alone on the line.

    However it ends, its EEPROM is locked. Raises SetUpError, ServoError, PortLost.
    """
    series = series_of(model)
    values = {baud: value for value, baud in rates_of(model).items()}
    if bus.baud not in values:
        raise SetUpError(f"servo {servo_id} answers at {rate} baud, and a {model.name} cannot be set to {bus.baud}")
    register, value = persistent_registers(model)["baud_rate"], values[bus.baud]
    try:
        with bus.at_baud(rate) as other:
            _write(other, servo_id, series.lock, register, value)
        _check(bus, servo_id, register, value)
    finally:
        _lock(bus, servo_id, series.lock, rate)
    restart(bus, clock, servo_id, model)


def _write(bus: Bus, servo_id: int, lock: Register | None, register: Register, value: int) -> None:
    if lock is not None:
        retry(partial(bus.write, servo_id, lock, OPEN))
    # Its answer comes at the old rate or not at all: it is looked for at the new one.
    with suppress(ServoError):
        bus.write(servo_id, register, value)


def _check(bus: Bus, servo_id: int, register: Register, value: int) -> None:
    try:
        held = retry(partial(bus.read, servo_id, register))
    except ServoError as error:
        raise SetUpError(f"servo {servo_id} did not come to {bus.baud} baud: {error.text}") from error
    if held != value:
        raise SetUpError(f"servo {servo_id}: {register.name} stays {held}, not {value}")


def _lock(bus: Bus, servo_id: int, lock: Register | None, rate: int) -> None:
    """Close the lock at whichever rate the servo answers now."""
    if lock is None:
        return
    try:
        retry(partial(bus.write, servo_id, lock, CLOSED))
    except ServoError:
        with suppress(ServoError), bus.at_baud(rate) as other, eeprom(other, servo_id, lock):
            pass
