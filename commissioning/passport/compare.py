"""Read the EEPROM of servos and compare it with a passport. Nothing is written to the servos."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

from commissioning.passport.file import Passport, PassportError, ServoPassport
from commissioning.provision import persistent_registers
from commissioning.scan.answers import who_answers
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.servos.catalog import known_as, series_of
from drivers.servos.feetech import STS
from drivers.servos.register import ServoModel
from drivers.servos.series import Series


@dataclass(frozen=True, slots=True)
class Difference:
    """One register whose value differs from the passport."""

    servo_id: int
    register: str
    saved: int
    now: int


@dataclass(frozen=True, slots=True)
class Comparison:
    """All changes since the passport was written."""

    differences: tuple[Difference, ...]
    absent: tuple[int, ...]
    """IDs of servos in the passport that do not respond."""
    others: tuple[int, ...]
    """IDs that respond but are not in the passport."""

    @property
    def same(self) -> bool:
        """Whether the servos match the passport."""
        return not (self.differences or self.absent or self.others)


def read_servo(bus: Bus, servo_id: int, model: ServoModel) -> dict[str, int]:
    """Return the values of all EEPROM registers, keyed by name. Raises ServoError."""
    # The function performs about fifty reads. With fewer attempts, one of these reads would often fail on an unreliable
    # bus.
    registers = persistent_registers(model).items()
    return {name: retry(partial(retry, partial(bus.read, servo_id, register))) for name, register in registers}


def take_passport(
    bus: Bus,
    models: Mapping[int, ServoModel] | None = None,
    joints: Mapping[int, str] | None = None,
    adapter: str | None = None,
    series: Series = STS,
) -> Passport:
    """Read the EEPROM of servos and return their passport.

    Args:
        bus: The bus.
        models: Model of each servo to read, keyed by ID. If None, read all servos of ``series`` that respond.
        joints: Joint name of each servo, keyed by ID.
        adapter: Serial number of the USB adapter.
        series: Series of the servos; used if ``models`` is None.

    Raises:
        PassportError: A servo is missing or has the wrong model, or two servos have the same ID.
    """
    answers = {answer.servo_id: answer.clear for answer in who_answers(bus)}
    problems = [f"servo {i} does not respond: check its cable and supply" for i in models or () if i not in answers]
    problems += [
        f"servo {i}: all replies are corrupted, so probably two servos have this ID. Connect only one of them"
        for i, ok in answers.items()
        if not ok
    ]
    if not answers and not problems:
        problems = [
            f"no servo responds on {bus.name} at {bus.baud} baud: check the power of the servos and the baud rate"
        ]
    if problems:
        raise PassportError("\n".join([*problems, "nothing was written"]))
    names = joints or {}
    known = models or {i: model_of(bus, i, series) for i in answers}
    servos = {i: _passport_of(bus, i, model, names.get(i)) for i, model in known.items()}
    return Passport(adapter=adapter, baud=bus.baud, servos=dict(sorted(servos.items())))


def _passport_of(bus: Bus, servo_id: int, model: ServoModel, joint: str | None) -> ServoPassport:
    require_model(bus, servo_id, model)
    return ServoPassport(model=model.name, joint=joint, registers=read_servo(bus, servo_id, model))


def model_of(bus: Bus, servo_id: int, series: Series) -> ServoModel:
    """Return the first model with the servo's model number, which several models may share."""
    number = retry(partial(bus.read, servo_id, series.model_number))
    for model in series.models:
        if model.number == number:
            return model
    raise PassportError(
        f"servo {servo_id} has model number {number} ({known_as(number, series)}), whose control table is unknown to "
        "servoloop"
    )


def require_model(bus: Bus, servo_id: int, model: ServoModel) -> None:
    """Raise PassportError if the servo reports a different model number."""
    series = series_of(model)
    number = retry(partial(bus.read, servo_id, series.model_number))
    if number != model.number:
        raise PassportError(
            f"servo {servo_id} has model number {number} ({known_as(number, series)}), not {model.number} "
            f"({model.name})"
        )


def compare(bus: Bus, passport: Passport) -> Comparison:
    """Compare the servos with a passport. Raises ServoError if a servo stops responding during the comparison."""
    answers = {answer.servo_id for answer in who_answers(bus)}
    differences: list[Difference] = []
    for servo_id, servo in passport.servos.items():
        if servo_id in answers:
            differences += servo_differences(bus, servo_id, servo)
    absent = tuple(i for i in passport.servos if i not in answers)
    return Comparison(tuple(differences), absent, tuple(sorted(answers - passport.servos.keys())))


def servo_differences(bus: Bus, servo_id: int, servo: ServoPassport) -> list[Difference]:
    """Return the registers of the servo with ID ``servo_id`` that differ from this passport."""
    number = series_of(servo.servo_model).model_number
    other = retry(partial(bus.read, servo_id, number))
    if other != servo.registers[number.name]:  # A different model may have a different control table.
        return [Difference(servo_id, number.name, servo.registers[number.name], other)]
    now = read_servo(bus, servo_id, servo.servo_model)
    return [
        Difference(servo_id, name, saved, now[name]) for name, saved in servo.registers.items() if now[name] != saved
    ]
