"""Check the model and the settings of a servo."""

from functools import partial

from drivers.bus.retry import retry
from drivers.bus.single_servo import SingleServo
from drivers.driver_errors import ServoRefused, ServoSilent
from drivers.servos.catalog import known_as, series_of
from drivers.servos.register import ServoModel
from drivers.servos.series import Series


def check_model_number(single: SingleServo, servo_id: int, model: ServoModel) -> None:
    """Raise ServoError unless the servo responds and reports the model number of this model."""
    series = series_of(model)
    number = _model_number(single, servo_id, series)
    if number != model.number:
        raise ServoRefused(
            servo_id,
            f"is model {number} ({known_as(number, series)}), not {model.number} ({model.name}): "
            "correct the model in the robot file or replace the servo. To add a model that servoloop does not know, "
            "see docs/add-a-servo.md",
        )


def check_settings(single: SingleServo, servo_id: int, model: ServoModel) -> str | None:
    """Raise ServoRefused if the servo does not acknowledge writes or cannot be driven. Return a warning or None."""
    series = series_of(model)
    level = retry(partial(single.read, servo_id, series.status_level))
    if level < series.answers_all and not _acknowledges(single, servo_id, series):
        raise ServoRefused(servo_id, f"does not acknowledge writes: {_set_level(series)}")
    if wrong := series.config_error(model, lambda register: retry(partial(single.read, servo_id, register))):
        raise ServoRefused(servo_id, wrong)
    return series.config_warning(lambda register: retry(partial(single.read, servo_id, register)))


def _model_number(single: SingleServo, servo_id: int, series: Series) -> int:
    try:
        return retry(partial(single.read, servo_id, series.model_number))
    except ServoSilent:
        # The ping also raises an error if the servo does not respond to it.
        single.ping(servo_id)
    try:
        return retry(partial(single.read, servo_id, series.model_number))
    except ServoSilent as error:
        raise ServoRefused(servo_id, f"responds to pings but not to reads: {_set_level(series)}") from error


def _acknowledges(single: SingleServo, servo_id: int, series: Series) -> bool:
    """Return whether the servo acknowledges a write that changes nothing. Even a simulator with an empty table may
    acknowledge it."""
    if series.harmless is None:
        return False
    held = retry(partial(single.read, servo_id, series.harmless))
    try:
        retry(partial(single.write, servo_id, series.harmless, held))
    except ServoSilent:
        return False
    return True


def _set_level(series: Series) -> str:
    level = series.status_level
    return f"set its {level.name} (register {level.address}) to {series.answers_all}"
