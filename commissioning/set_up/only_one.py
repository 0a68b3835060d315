"""Find the only servo on the bus, check that it is suitable for a joint, and set its baud rate."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Final

from commissioning.commissioning_errors import CommissioningError
from commissioning.provision import drives, persistent_registers, restart
from commissioning.registers.tables import rates_of
from commissioning.scan.answers import Answer, who_answers, who_answers_elsewhere
from drivers.bus.bus import Bus
from drivers.bus.confirm import confirmed_states
from drivers.bus.retry import retry
from drivers.clock import Clock
from drivers.driver_errors import ServoError
from drivers.eeprom import CLOSED, OPEN, eeprom
from drivers.servos import x
from drivers.servos.catalog import MODELS, known_as, series_of
from drivers.servos.dynamixel import X
from drivers.servos.feetech import STS
from drivers.servos.register import Register, ServoModel
from drivers.servos.series import Series
from drivers.servos.voltage import voltage_fault
from drivers.types import ServoState
from hal.robot_file.robot_file import RobotFile

FACTORY_ID: Final = 1
"""Factory ID of every new servo, regardless of make."""
POSITION_MODES: Final[dict[str, int]] = {STS.name: 0, X.name: x.POSITION_MODE}


class SetUpError(CommissioningError):
    """The set-up cannot continue. The message tells the user what to do. Servos that have already been set up remain
    set up."""


@dataclass(frozen=True, slots=True)
class ServoPlace:
    """The servo of one joint, as described in the robot file."""

    joint: str
    servo_id: int
    model: ServoModel
    settings: tuple[tuple[str, int], ...] = ()
    extended: bool = False
    """Whether the servo is a Dynamixel X calibrated in extended position mode."""

    @property
    def series(self) -> Series:
        """The series of the servo."""
        return series_of(self.model)

    def basics(self) -> dict[Register, int]:
        """Return the EEPROM values that all joints share: no return delay, replies to all requests, position mode."""
        series = self.series
        values = {"return_delay": 0, series.status_level.name: series.answers_all}
        if series.name in POSITION_MODES:
            values["operating_mode"] = x.EXTENDED_POSITION_MODE if self.extended else POSITION_MODES[series.name]
        return self._registers(values)

    def wanted(self) -> dict[Register, int]:
        """Return all EEPROM values of this servo: basic settings, settings in the robot file, and ID."""
        return self.basics() | self._registers(dict(self.settings) | {"id": self.servo_id})

    def _registers(self, values: Mapping[str, int]) -> dict[Register, int]:
        table = persistent_registers(self.model)
        return {table[name]: value for name, value in values.items() if name in table}

    def differs(self, bus: Bus, servo_id: int) -> dict[str, tuple[int, int]]:
        """Return the EEPROM values that differ in the servo with this ID, as (held, wanted), keyed by register name."""
        held = {register: retry(partial(bus.read, servo_id, register)) for register in self.wanted()}
        return {r.name: (held[r], value) for r, value in self.wanted().items() if held[r] != value}


def places_of(robot: RobotFile, bus: str = "") -> list[ServoPlace]:
    """Return the servos on one bus of a robot file, in file order."""
    return [
        ServoPlace(name, joint.servo_id, MODELS[joint.model], tuple(joint.settings.items()), joint.extended)
        for name, joint in robot.joints_on(bus).items()
    ]


def in_order(places: Sequence[ServoPlace]) -> list[ServoPlace]:
    """Return the servos in set-up order, from the gripper to the base.

    The servo that keeps the factory ID comes last. Until then, every servo with the factory ID is a new servo.
    """
    backwards = list(reversed(places))
    return sorted(backwards, key=lambda place: place.servo_id == FACTORY_ID)


LIMIT_UNIT_V: Final = 0.1
LIMITS: Final = (("min_voltage", "max_voltage"), ("min_voltage_limit", "max_voltage_limit"))
"""Names of the voltage limit registers in the control tables."""


class NotYet(SetUpError):
    """The user can solve the problem by connecting a different servo. The request is then repeated."""


def only_servo(bus: Bus, rates: Sequence[int]) -> Answer:
    """Return the only servo that responds at the bus's baud rate or at one of ``rates``.

    Raises NotYet if no servo or more than one servo responds.
    """
    found = who_answers(bus) or who_answers_elsewhere(bus, [rate for rate in rates if rate != bus.baud])
    if not found:
        raise NotYet(
            f"no servo responds on {bus.name} at any baud rate. Check that the supply is on, the cable is plugged in "
            "at both ends, and the adapter is set to USB"
        )
    ids = ", ".join(str(answer.servo_id) for answer in found)
    if len(found) > 1:
        raise NotYet(f"several servos respond (IDs {ids}): connect only one")
    if not found[0].clear:
        raise NotYet(
            f"all replies of servo {ids} are corrupted: either several servos have ID {ids}, or the cable is bad. "
            "Connect only one servo; if only one is connected, replace the cable"
        )
    return found[0]


def require_fit(bus: Bus, servo_id: int, place: ServoPlace, places: Sequence[ServoPlace]) -> float:
    """Check that a servo can be used for a joint, and return its supply voltage. The bus must be at the servo's baud
    rate.

    Raises NotYet if the servo belongs to another joint, has the wrong model, or has torque enabled. Raises SetUpError
    if the voltage is wrong.
    """
    owner = next((one.joint for one in places if one.servo_id == servo_id), None)
    if servo_id not in (FACTORY_ID, place.servo_id) and owner is not None:
        raise NotYet(
            f"this servo has ID {servo_id}, so it already belongs to {owner}. Connect the servo for {place.joint}"
        )
    _require_model(bus, servo_id, place)
    voltage_v = voltage(bus, servo_id)
    _require_voltage(bus, servo_id, place, voltage_v)
    if drives(bus, servo_id, place.model):
        raise NotYet(
            f"the torque of servo {servo_id} is enabled, so its settings cannot be written. Switch the supply "
            "off and on to disable the torque. If the servo holds a load, support it first"
        )
    return voltage_v


def voltage(bus: Bus, servo_id: int) -> float:
    """Return the supply voltage that the servo measures."""
    return state_of(bus, servo_id).voltage_v


def state_of(bus: Bus, servo_id: int) -> ServoState:
    """Return the servo's state, confirmed by two consecutive identical position readings. Raises NotYet."""
    state = confirmed_states(bus.read_states, [servo_id])[servo_id]
    if isinstance(state, ServoState):
        return state
    raise NotYet(f"{state.text}: check whether its plug is loose")


def _require_model(bus: Bus, servo_id: int, place: ServoPlace) -> None:
    number = retry(partial(bus.read, servo_id, place.series.model_number))
    if number != place.model.number:
        raise NotYet(
            f"servo {servo_id} has model number {number} ({known_as(number, place.series)}), but {place.joint} needs "
            f"an {place.model.name} ({place.model.number}) according to the robot file. Connect the right servo, or "
            "correct the robot file"
        )


def _require_voltage(bus: Bus, servo_id: int, place: ServoPlace, voltage_v: float) -> None:
    rated_v, model = place.model.rated_voltage_v, place.model.name
    fault = voltage_fault(place.model, voltage_v)
    if fault is not None and fault.outside:
        fault_text = "too high" if fault.kind == "over-voltage" else "too low"
        raise SetUpError(
            f"the supply voltage of {voltage_v:.1f} V is {fault_text} for an {model}, which is rated for "
            f"{rated_v:.1f} V. Switch the supply off now. Then connect the right supply, or correct the model in the "
            "robot file"
        )
    lowest_v, highest_v = _limits(bus, servo_id, place)
    if not lowest_v <= voltage_v <= highest_v:
        raise SetUpError(
            f"servo {servo_id} measures {voltage_v:.1f} V, but its own limits are {lowest_v:.1f} to {highest_v:.1f} V. "
            f"Check that it is an {model} rated for {rated_v:.1f} V, and that the supply is the right one"
        )


def _limits(bus: Bus, servo_id: int, place: ServoPlace) -> tuple[float, float]:
    """Return the servo's voltage limits from the robot file or, if they are missing there, from the servo."""
    table, settings = persistent_registers(place.model), dict(place.settings)
    names = next(names for names in LIMITS if names[0] in table)
    lowest, highest = (
        settings[name] if name in settings else retry(partial(bus.read, servo_id, table[name])) for name in names
    )
    return lowest * LIMIT_UNIT_V, highest * LIMIT_UNIT_V


def bring_to_rate(bus: Bus, clock: Clock, servo_id: int, model: ServoModel, rate: int) -> None:
    """Change the baud rate of the only servo on the bus from ``rate`` to the rate of the bus.

    The servo's torque must be off. At the end, the EEPROM is locked, even after an error. Raises SetUpError,
    ServoError, PortLost.
    """
    series = series_of(model)
    values = {baud: value for value, baud in rates_of(model).items()}
    if bus.baud not in values:
        raise SetUpError(
            f"servo {servo_id} responds at {rate} baud, and an {model.name} does not support the baud rate of the bus, "
            f"{bus.baud}. Correct the baud rate or the model in the robot file"
        )
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
    # The reply arrives at the old rate or not at all, so the servo is then checked at the new rate.
    with suppress(ServoError):
        bus.write(servo_id, register, value)


def _check(bus: Bus, servo_id: int, register: Register, value: int) -> None:
    try:
        held = retry(partial(bus.read, servo_id, register))
    except ServoError as error:
        raise SetUpError(
            f"servo {servo_id} does not respond at {bus.baud} baud after its baud rate was changed: {error.text}"
        ) from error
    if held != value:
        raise SetUpError(f"servo {servo_id}: {register.name} is still {held} after {value} was written")


def _lock(bus: Bus, servo_id: int, lock: Register | None, rate: int) -> None:
    """Lock the EEPROM at the baud rate at which the servo currently responds."""
    if lock is None:
        return
    try:
        retry(partial(bus.write, servo_id, lock, CLOSED))
    except ServoError:
        with suppress(ServoError), bus.at_baud(rate) as other, eeprom(other, servo_id, lock):
            pass
