"""Whether a servo is what the robot file says, and set up so that we can drive it."""

from functools import partial

from drivers.errors import ServoRefused, ServoSilent
from drivers.read_each.series import Series
from drivers.registers import ServoModel
from drivers.single_servo import SingleServo
from drivers.tries import tried


def identify(single: SingleServo, series: Series, servo_id: int, model: ServoModel) -> None:
    """Raise ServoSilent or ServoRefused with a text that says what to do."""
    number = _model_number(single, series, servo_id)
    if number != model.number:
        raise ServoRefused(
            servo_id,
            f"is model {number} ({known_as(number, series)}), not {model.number} ({model.name}): "
            "correct the model that it is said to be, or swap the servo",
        )


def check_settings(single: SingleServo, series: Series, servo_id: int, model: ServoModel) -> None:
    """Raise ServoRefused where goals are not what we take them for, or writes are not acknowledged."""
    if tried(partial(single.read, servo_id, series.status_level)) != series.answers_all:
        raise ServoRefused(servo_id, f"acknowledges no writes: {_set_level(series)}")
    misfit = series.misfit(model, lambda register: tried(partial(single.read, servo_id, register)))
    if misfit:
        raise ServoRefused(servo_id, misfit)


def _model_number(single: SingleServo, series: Series, servo_id: int) -> int:
    try:
        return tried(partial(single.read, servo_id, series.model_number))
    except ServoSilent:
        # Of one that does not even answer a ping there is no more to learn.
        single.ping(servo_id)
    raise ServoRefused(servo_id, f"answers a ping but no read: {_set_level(series)}")


def _set_level(series: Series) -> str:
    level = series.status_level
    return f"set its {level.name} (register {level.address}) to {series.answers_all}"


def known_as(number: int, series: Series) -> str:
    """The model of any series of this make that says ``number``, whatever its byte order."""
    said = number.to_bytes(2, series.byte_order)
    names = [m.name for m in series.relatives.values() if m.number == int.from_bytes(said, m.byte_order)]
    return " or ".join(names) or "unknown"
