"""Faults of a servo's EEPROM: settings that another program has changed, or that were never set."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from random import Random
from typing import Annotated, Any, Final, Literal

from pydantic import Field

from drivers.servos import sts, x, xl320
from drivers.servos.catalog import registers_of, series_of
from drivers.servos.dynamixel1 import AX_MX
from drivers.servos.register import Access, Register, ServoModel
from hal.plausible import Baud, Number, RegisterValue, ServoId
from sim_backend.box import FACTORY_ID
from sim_backend.faults.event import Lasting, Momentary, OfServo, model_of
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.tables import any_value, register_of, require_value
from sim_backend.faults.targets import FaultTargets, Inventory
from sim_backend.line.power import restart
from sim_backend.servos.dynamixel.servo import VirtualXServo
from sim_backend.servos.dynamixel.xl320_servo import VirtualXl320Servo
from sim_backend.servos.sts.servo import VirtualServo

MODES: Final = {"sts": (0, 1, 2, 3), "Dynamixel X": (0, 1, 3, 4, 5, 16)}
"""Values of ``operating_mode``, keyed by series. Other series do not have this register."""
WRONG_SETTING: Final = "wrong_setting"
"""Fault type for wrong values of EEPROM registers that have no dedicated fault type."""
OWN_KINDS: Final = {"id": "wrong_id", "baud_rate": "wrong_rate", "operating_mode": "wrong_mode"}
"""Dedicated fault type for wrong values of a register, keyed by register name."""


class _WrongSetting(OfServo, Lasting):
    """Base class of faults in which an EEPROM register has a wrong value."""

    def _setting(self, model: ServoModel) -> tuple[str, int]:
        """Return the name of the register and its wrong value."""
        raise NotImplementedError

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        servo = self.place(targets).servo
        name, value = self._setting(servo.model)
        register = register_of(servo.model, name)
        usual = servo.memory.get(register)

        def put(number: int) -> None:
            _put(servo, register, number)

        with targets.holds.hold((name, servo), put, value, usual):
            yield


class WrongId(_WrongSetting):
    """A servo has a wrong ID. If another servo has the same ID, both reply."""

    kind: Literal["wrong_id"] = "wrong_id"
    to: Annotated[ServoId, Field(le=252)]

    def _setting(self, model: ServoModel) -> tuple[str, int]:
        return "id", self.to

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        return {**super().draw_parameters(random, there), "to": random.randint(1, 20)}


class WrongRate(_WrongSetting):
    """A servo's baud rate differs from the baud rate of the bus."""

    kind: Literal["wrong_rate"] = "wrong_rate"
    baud: Baud

    def refuse_model(self, model: ServoModel, there: Inventory) -> None:
        if self.baud not in _rates(model):
            raise self.cannot(model, f"supports {', '.join(map(str, sorted(_rates(model))))} baud but not {self.baud}")

    def _setting(self, model: ServoModel) -> tuple[str, int]:
        return "baud_rate", _rates(model)[self.baud]

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        return {**super().draw_parameters(random, there), "baud": random.choice([57_600, 115_200, 1_000_000])}


class WrongMode(_WrongSetting):
    """A servo is in an operating mode other than position control."""

    kind: Literal["wrong_mode"] = "wrong_mode"
    mode: Number

    def refuse_model(self, model: ServoModel, there: Inventory) -> None:
        modes = MODES.get(series_of(model).name)
        if modes is None:
            raise self.cannot(model, "has no register for its operating mode")
        if self.mode not in modes:
            raise self.cannot(model, f"has the modes {', '.join(map(str, modes))} but not {self.mode}")

    def _setting(self, model: ServoModel) -> tuple[str, int]:
        return "operating_mode", self.mode

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        return {**super().draw_parameters(random, there), "mode": random.choice([0, 1, 3])}


class WrongSetting(_WrongSetting):
    """A register in a servo's EEPROM has a wrong value, such as a wrong gain, limit or homing offset."""

    kind: Literal["wrong_setting"] = "wrong_setting"
    register_name: str
    """Name of the register in `servoloop register list`."""
    value: RegisterValue
    """Raw value of the register, without a unit."""

    def refuse_model(self, model: ServoModel, there: Inventory) -> None:
        register = register_of(model, self.register_name)
        if register.name in OWN_KINDS:
            raise FaultError(f"{register.name}: use the fault {OWN_KINDS[register.name]} for this register")
        if register not in _settings(model):
            raise FaultError(f"{register.name} is not a setting that an {model.name} keeps without power")
        require_value(register, self.value)

    def _setting(self, model: ServoModel) -> tuple[str, int]:
        return self.register_name, self.value

    @classmethod
    def draw_parameters(cls, random: Random, there: Inventory) -> dict[str, Any]:
        parameters = super().draw_parameters(random, there)
        register = random.choice(_settings(model_of(parameters, there)))
        return {**parameters, "register_name": register.name, "value": any_value(random, register)}


class EepromGone(Momentary, OfServo):
    """A servo has lost its settings and restarts with factory values: ID 1, and the factory baud rate and limits."""

    kind: Literal["eeprom_gone"] = "eeprom_gone"

    @contextmanager
    def acting(self, targets: FaultTargets) -> Iterator[None]:
        servo = self.place(targets).servo
        fresh = _factory_new(servo)
        servo.memory.flash = fresh.memory.flash
        restart(servo)
        yield


def _factory_new(servo: Any) -> Any:
    """Return a factory-new servo of the same model and firmware."""
    if servo.model == xl320.XL320:
        return VirtualXl320Servo(FACTORY_ID)
    if isinstance(servo, VirtualXServo):
        return VirtualXServo(servo.model, FACTORY_ID, servo.memory.get(x.firmware_version))
    return type(servo)(servo.model, FACTORY_ID)


def _settings(model: ServoModel) -> list[Register]:
    """Return the writable EEPROM registers, except for those whose wrong values have a dedicated fault type."""
    kept = (one for one in registers_of(model) if one.persistent and one.access is Access.READ_WRITE)
    return [register for register in kept if register.name not in OWN_KINDS]


def _put(servo: Any, register: Register, value: int) -> None:
    """Write and save a value even if the EEPROM is locked or torque is enabled, and apply the side effects of the
    write."""
    if isinstance(servo, VirtualServo):
        servo.write(register.address, register.encode(value, "little"))
    elif series_of(servo.model).make == "dynamixel":  # The EEPROM of a Dynamixel is locked while the torque is enabled.
        servo.memory.put(series_of(servo.model).torque_enable, 0)
    servo.memory.save(register, value)
    if not isinstance(servo, VirtualServo):
        servo.firmware.load_settings()


def _rates(model: ServoModel) -> Mapping[int, int]:
    """Return the values of the register ``baud_rate``, keyed by baud rate."""
    series = series_of(model)
    if series is AX_MX:
        return {2_000_000 // (value + 1): value for value in (207, 103, 34, 16, 9, 7, 4, 3, 1)}
    rates: Sequence[int] = sts.BAUD_RATES
    if series.make != "feetech":
        rates = xl320.BAUD_RATES if model is xl320.XL320 else x.BAUD_RATES
        rates = rates[: register_of(model, "baud_rate").largest + 1]
    return {rate: value for value, rate in enumerate(rates)}
