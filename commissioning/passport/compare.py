"""Reading servos' EEPROM, and comparing it with a passport. Nothing is written to any servo."""

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
    """One register that no longer holds what the passport says."""

    servo_id: int
    register: str
    saved: int
    now: int


@dataclass(frozen=True, slots=True)
class Comparison:
    """What has changed since the passport was written."""

    differences: tuple[Difference, ...]
    absent: tuple[int, ...]
    """Servos of the passport that do not answer."""
    others: tuple[int, ...]
    """IDs that answer and that the passport does not know."""

    @property
    def same(self) -> bool:
        """Whether nothing has changed."""
        return not (self.differences or self.absent or self.others)


def read_servo(bus: Bus, servo_id: int, model: ServoModel) -> dict[str, int]:
    """Everything in the servo's EEPROM, by name. Raises ServoError."""
    # About fifty questions: on a bad line one of them would often stay open with fewer attempts.
    registers = persistent_registers(model).items()
    return {name: retry(partial(retry, partial(bus.read, servo_id, register))) for name, register in registers}


def take_passport(
    bus: Bus,
    models: Mapping[int, ServoModel] | None = None,
    joints: Mapping[int, str] | None = None,
    adapter: str | None = None,
    series: Series = STS,
) -> Passport:
    """The passport of the servos with these IDs, or of all of ``series`` that answer, which say their models.

    Raises PassportError where one is missing or of another model, or where two have one ID.
    """
    answers = {answer.servo_id: answer.clear for answer in who_answers(bus)}
    problems = [f"servo {i} does not answer" for i in models or () if i not in answers]
    problems += [f"servo {i} never answers in one piece: do two have this ID?" for i, ok in answers.items() if not ok]
    if not answers and not problems:
        problems = [f"no servo answers on {bus.name} at {bus.baud} baud: check the servos' power and the rate"]
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
    """The model that the servo says it is, of this series; of several with one number the first."""
    number = retry(partial(bus.read, servo_id, series.model_number))
    for model in series.models:
        if model.number == number:
            return model
    raise PassportError(f"servo {servo_id} is model {number} ({known_as(number, series)}): its table is not known here")


def require_model(bus: Bus, servo_id: int, model: ServoModel) -> None:
    """Raise PassportError unless the servo says that it is of this model."""
    series = series_of(model)
    number = retry(partial(bus.read, servo_id, series.model_number))
    if number != model.number:
        raise PassportError(
            f"servo {servo_id} is model {number} ({known_as(number, series)}), not {model.number} ({model.name})"
        )


def compare(bus: Bus, passport: Passport) -> Comparison:
    """What is different now. Raises ServoError where a servo falls silent meanwhile."""
    answers = {answer.servo_id for answer in who_answers(bus)}
    differences: list[Difference] = []
    for servo_id, servo in passport.servos.items():
        if servo_id in answers:
            differences += servo_differences(bus, servo_id, servo)
    absent = tuple(i for i in passport.servos if i not in answers)
    return Comparison(tuple(differences), absent, tuple(sorted(answers - passport.servos.keys())))


def servo_differences(bus: Bus, servo_id: int, servo: ServoPassport) -> list[Difference]:
    """The registers in which the servo that answers to ``servo_id`` differs from this passport."""
    number = series_of(servo.servo_model).model_number
    other = retry(partial(bus.read, servo_id, number))
    if other != servo.registers[number.name]:  # another table, perhaps
        return [Difference(servo_id, number.name, servo.registers[number.name], other)]
    now = read_servo(bus, servo_id, servo.servo_model)
    return [
        Difference(servo_id, name, saved, now[name]) for name, saved in servo.registers.items() if now[name] != saved
    ]
