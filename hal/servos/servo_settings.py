"""The settings in servos' EEPROM that the robot file names: written at set-up where a servo has others, and said.

What the file does not name stays as it is. Where that changes how far a joint gives way or lags, it is said too: the
compensation goes by the factory's gains.
"""

import logging
from collections.abc import Mapping
from functools import partial
from typing import Final

from calibration.eeprom import update
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.errors import ServoRefused
from drivers.servos import x
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import X
from drivers.servos.register import Access, Register, ServoModel
from hal.compensation.servo_compliance import assumed_settings, compliance_of
from hal.joint import Joint

LOG = logging.getLogger("servoloop.hal")

NOT_HERE: Final = frozenset(
    {
        *("id", "baud_rate", "protocol_type", "status_level", "status_return_level", "secondary_id"),
        *("operating_mode", "control_mode", "drive_mode", "phase", "homing_offset", "angular_resolution"),
        "external_port_mode",
    }
)
"""Persistent registers that say who and where a servo is, which way it turns and what a goal is: not to be changed in
passing."""


def settings_of(model: ServoModel) -> dict[str, Register]:
    """The settings of a servo that a robot file may name, by name."""
    return {
        register.name: register
        for register in series_of(model).registers
        if register.persistent and register.access is Access.READ_WRITE and register.name not in NOT_HERE
    }


def mistakes(model: ServoModel, settings: Mapping[str, int]) -> list[str]:
    """The settings that this servo does not have or cannot take."""
    known = settings_of(model)
    problems: list[str] = []
    for name, value in settings.items():
        if name not in known:
            problems.append(f"{model.name} has no setting {name}: it has {', '.join(sorted(known))}")
        elif not known[name].smallest <= value <= known[name].largest:
            problems.append(f"{name} takes {known[name].smallest} to {known[name].largest}, not {value}")
    return problems


def _homing_register(model: ServoModel) -> Register | None:
    return next((one for one in series_of(model).registers if one.name == "homing_offset"), None)


def homing_mistake(model: ServoModel, offset: int | None) -> str | None:
    """Why this servo cannot have this homing offset, if so."""
    register = _homing_register(model)
    if offset is None or (register and register.smallest <= offset <= register.largest):
        return None
    if register is None:
        return f"{model.name} has no homing_offset: take it out"
    return f"homing_offset takes {register.smallest} to {register.largest}, not {offset}"


def check_homing_offset(joint: Joint, bus: Bus) -> None:
    """Raise ServoRefused where the servo counts from another place than when the joint's zero was found."""
    register = _homing_register(joint.model)
    if register is None or joint.homing_offset is None:
        return
    held = retry(partial(bus.read, joint.servo_id, register))
    if held != joint.homing_offset:
        raise ServoRefused(
            joint.servo_id,
            f"has homing_offset {held}, and {joint.name} was calibrated with {joint.homing_offset}: was the servo "
            "changed, or reset? Calibrate the arm again, or write the register back",
        )


def check_mode(joint: Joint, bus: Bus) -> None:
    """Raise ServoRefused where a Dynamixel X is not in the mode in which the joint's zero was found.

    In position mode a homing offset may count that is ignored, and in extended position mode the other way round.
    """
    if series_of(joint.model) is not X:
        return
    held = retry(partial(bus.read, joint.servo_id, x.operating_mode))
    if wrong := mode_mistake(joint, held):
        raise ServoRefused(joint.servo_id, wrong)


def wanted_mode(joint: Joint) -> int:
    """The operating mode in which the joint's Dynamixel X is driven."""
    return x.EXTENDED_POSITION_MODE if joint.extended else x.POSITION_MODE


def mode_mistake(joint: Joint, held: int) -> str | None:
    """Why the joint's Dynamixel X must not be driven in the operating mode ``held``, if so."""
    wanted = wanted_mode(joint)
    if held == wanted:
        return None
    name = "extended position, as it was calibrated" if joint.extended else "position"
    return f"is in operating mode {held}: set it to {wanted} ({name})"


def apply_settings(joint: Joint, bus: Bus) -> None:
    """Write what the robot file names and the servo has otherwise. Raises ServoError with servo and register.

    The EEPROM is not written under torque: then a servo that differs is refused.
    """
    known = settings_of(joint.model)
    wanted = {known[name]: value for name, value in joint.settings}
    lock = series_of(joint.model).lock
    for change in update(bus, joint.servo_id, lock, wanted) if wanted else ():
        LOG.info("%s (servo %d): %s is %d now, was %d", joint.name, joint.servo_id, change.register.name,
                 change.new, change.old)  # fmt: skip


def warn_of_other_gains(joint: Joint, bus: Bus) -> None:
    """Warn of gains that the compensation does not assume and the robot file does not name."""
    known, named = settings_of(joint.model), dict(joint.settings)
    assumed = {name: value for name, value in assumed_settings(joint.model).items() if name not in named}
    held = {name: retry(partial(bus.read, joint.servo_id, known[name])) for name in assumed}
    if compliance_of(joint.model, settings=named | held) != compliance_of(joint.model, settings=named):
        others = {name: value for name, value in held.items() if value != assumed[name]}
        LOG.warning(
            "%s (servo %d) has other gains than the factory's, so it will follow less well than it could. Name them "
            "in the robot file, as they are or as you want them: settings: %s",
            *(joint.name, joint.servo_id, str(others).replace("'", "")),
        )
