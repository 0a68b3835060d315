"""Write the EEPROM settings in the robot file to the servos during setup, and log each change.

Settings that the file does not contain are left unchanged. If such a setting affects the stiffness or lag of a joint, a
warning is logged, because the compensation assumes the factory gains.
"""

import logging
import math
from collections.abc import Mapping
from functools import partial
from typing import Final

from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.driver_errors import ServoRefused
from drivers.eeprom import update
from drivers.servos import x
from drivers.servos.catalog import registers_of, series_of
from drivers.servos.dynamixel import X
from drivers.servos.ram_gains import ram_gains
from drivers.servos.register import Access, Register, ServoModel
from hal.compensation.servo_compliance import assumed_settings, compliance_of
from hal.joint import Joint

LOG = logging.getLogger("servoloop.hal")

NOT_SETTINGS: Final = frozenset(
    {
        *("id", "baud_rate", "protocol_type", "status_level", "status_return_level", "secondary_id"),
        *("operating_mode", "control_mode", "drive_mode", "phase", "homing_offset", "angular_resolution"),
        "external_port_mode",
    }
)
"""Persistent registers that the robot file must not set.

These registers define the servo's address, direction and operating mode."""


def settings_of(model: ServoModel) -> dict[str, Register]:
    """Return the servo registers that a robot file may set, keyed by name: settings in EEPROM and gains in RAM.

    A P gain in RAM is not included, because the robot file has the key ``position_p`` for this gain.
    """
    saved = (
        register
        for register in registers_of(model)
        if register.persistent and register.access is Access.READ_WRITE and register.name not in NOT_SETTINGS
    )
    gains = (register for register in ram_gains(model) if register != series_of(model).position_p)
    return {register.name: register for register in (*saved, *gains)}


def mistakes(model: ServoModel, settings: Mapping[str, int]) -> list[str]:
    """List settings that the servo does not have, and values outside their register's range."""
    known = settings_of(model)
    problems: list[str] = []
    for name, value in settings.items():
        if name not in known:
            problems.append(f"{model.name} has no setting {name}: it has {', '.join(sorted(known))}")
        elif not known[name].takes(value):
            problems.append(f"{name} must be {known[name].values_text}, not {value}")
    return problems


def _homing_register(model: ServoModel) -> Register | None:
    return next((one for one in registers_of(model) if one.name == "homing_offset"), None)


def homing_mistake(model: ServoModel, offset: int | None) -> str | None:
    """Return the error message for a homing offset that the servo cannot have; otherwise None."""
    register = _homing_register(model)
    if offset is None or (register and register.takes(offset)):
        return None
    if register is None:
        return f"{model.name} has no homing_offset: remove it"
    return f"homing_offset must be {register.values_text}, not {offset}"


def check_homing_offset(joint: Joint, bus: Bus) -> None:
    """Raise ServoRefused if the servo's homing offset has changed since calibration."""
    register = _homing_register(joint.model)
    if register is None or joint.homing_offset is None:
        return
    held = retry(partial(bus.read, joint.servo_id, register))
    if held != joint.homing_offset:
        raise ServoRefused(
            joint.servo_id,
            f"has homing_offset {held}, but {joint.name} was calibrated with {joint.homing_offset}: was the servo "
            "replaced or reset? Calibrate the arm again, or restore the register",
        )


def check_mode(joint: Joint, bus: Bus) -> None:
    """Raise ServoRefused if a Dynamixel X is in an operating mode in which its zero is not valid.

    In position mode some homing offsets are ignored, so positions differ between the modes. If another program, such as
    LeRobot, calibrated the servo, it stays in the mode set by that program.
    """
    if series_of(joint.model) is not X:
        return
    held = retry(partial(bus.read, joint.servo_id, x.operating_mode))
    offset = retry(partial(bus.read, joint.servo_id, x.homing_offset))
    if wrong := mode_mistake(joint, held, offset):
        raise ServoRefused(joint.servo_id, wrong)


def warn_of_extended_position(joint: Joint, bus: Bus) -> None:
    """Log a warning if the homing offset takes effect only in the operating mode that another program has set."""
    if series_of(joint.model) is not X or joint.extended:
        return
    held = retry(partial(bus.read, joint.servo_id, x.operating_mode))
    offset = retry(partial(bus.read, joint.servo_id, x.homing_offset))
    if held in x.MODES_WITH_TURNS and x.needs_extended_position(offset):
        LOG.warning(
            "%s (servo %d) is in extended position mode with a homing_offset of %d, which position mode would ignore. "
            "The servo stays in this mode. Calibrate the arm with servoloop calibrate, because its zero is unknown",
            *(joint.name, joint.servo_id, offset),
        )


def check_goal_current(joint: Joint, bus: Bus) -> None:
    """Raise ServoRefused if a Dynamixel X in current-based position mode has a goal current of 0 and therefore no
    torque."""
    if _goal_current(joint, bus) == 0:
        raise ServoRefused(
            joint.servo_id,
            "would have no torque, because its goal_current is 0 in current-based position mode (5): reboot the servo "
            "(servoloop reboot), which sets goal_current back to the current limit",
        )


def warn_of_goal_current(joint: Joint, bus: Bus) -> None:
    """Log a warning if another program has limited the current of a servo.

    The limit is kept, because it protects the servo.
    """
    held = _goal_current(joint, bus)
    if held is None:
        return
    limit = retry(partial(bus.read, joint.servo_id, x.current_limit))
    if held < limit:
        LOG.warning(
            "%s (servo %d) is in current-based position mode, and another program has set its goal_current to %d of "
            "%d: the joint is weaker than usual. To reset goal_current, reboot the servo (servoloop reboot)",
            *(joint.name, joint.servo_id, held, limit),
        )


def _goal_current(joint: Joint, bus: Bus) -> int | None:
    """Return the goal current if it limits the servo.

    Return None in other modes, and for servos that do not measure their current.
    """
    if x.current_unit_a(joint.model) is None:
        return None
    if retry(partial(bus.read, joint.servo_id, x.operating_mode)) != x.CURRENT_POSITION_MODE:
        return None
    return abs(retry(partial(bus.read, joint.servo_id, x.goal_current)))


def wanted_mode(joint: Joint, offset: int) -> int:
    """Return the operating mode in which the joint's Dynamixel X is used with this homing offset."""
    if joint.extended or (joint.homing_offset is None and x.needs_extended_position(offset)):
        return x.EXTENDED_POSITION_MODE
    return x.POSITION_MODE


def mode_mistake(joint: Joint, held: int, offset: int) -> str | None:
    """Return the error message if ``held`` is the wrong operating mode for the joint's Dynamixel X; otherwise None."""
    wanted = wanted_mode(joint, offset)
    if held == wanted or (held in x.MODES_WITH_TURNS and (joint.homing_offset is None or joint.extended)):
        return None
    if held == x.POSITION_MODE and not joint.extended:
        return None  # In this mode the servo ignores the offset, as it did when its zero was entered in the robot file.
    name = "extended position, as it was calibrated" if joint.extended else "position"
    return f"is in operating mode {held}: set it to {wanted} ({name})"


def apply_settings(joint: Joint, bus: Bus) -> None:
    """Write the settings in the robot file that differ from those in the servo's EEPROM, and log each change.

    Raises:
        ServoError: A setting could not be written. The EEPROM is not written while torque is enabled.
    """
    known = settings_of(joint.model)
    wanted = {known[name]: value for name, value in joint.settings if known[name].persistent}
    lock = series_of(joint.model).lock
    for change in update(bus, joint.servo_id, lock, wanted) if wanted else ():
        LOG.info("%s (servo %d): %s set to %d (was %d)", joint.name, joint.servo_id, change.register.name,
                 change.new, change.old)  # fmt: skip


def warn_of_other_gains(joint: Joint, bus: Bus) -> None:
    """Log a warning if the servo's gains differ from those that the compensation assumes."""
    known, named = settings_of(joint.model), dict(joint.settings)
    assumed = {name: value for name, value in assumed_settings(joint.model).items() if name not in named}
    held = {name: retry(partial(bus.read, joint.servo_id, known[name])) for name in assumed}
    if compliance_of(joint.model, settings=named | held) != compliance_of(joint.model, settings=named):
        others = {name: value for name, value in held.items() if value != assumed[name]}
        LOG.warning(
            "%s (servo %d) has gains that differ from the factory settings, so the compensation is less accurate. "
            "Set the gains in the robot file. To keep the present values, add 'settings: %s'",
            *(joint.name, joint.servo_id, str(others).replace("'", "")),
        )


def check_reach(joint: Joint, limits: tuple[int, int] | None) -> None:
    """Check that the position limits of the servo include those of the joint.

    A servo does not move beyond its own limits, and does not report an error. Some servos stop at the limit, and others
    discard the goal.

    Args:
        joint: The joint.
        limits: Position limits of the servo, in counts; None if it has none.

    Raises:
        ServoRefused: The servo's limits are too narrow.
    """
    if limits is None:
        return
    last = joint.model.last_count
    lowest, highest = (min(max(counts, 0), last) for counts in joint.counts_range())
    if limits[0] <= lowest and highest <= limits[1]:
        return
    named = dict(joint.settings).keys() & {register.name for register in series_of(joint.model).position_limits}
    where = "robot file's settings" if named else "servo"
    raise ServoRefused(
        joint.servo_id,
        f"has position limits {limits[0]} to {limits[1]} counts, but its joint moves from {lowest} to {highest}: "
        f"widen these limits in the {where}, or {_advice(joint, max(limits[0], lowest), min(limits[1], highest))}",
    )


def _advice(joint: Joint, lowest: int, highest: int) -> str:
    """Return a remedy with the limits that the joint may have, rounded inward to six decimals."""
    if lowest >= highest:
        return "run 'servoloop calibrate' or correct zero_counts, because the two ranges hardly overlap"
    lower, upper = sorted(joint.position(counts) for counts in (lowest, highest))
    return f"narrow the limits in the URDF to {math.ceil(lower * 1e6) / 1e6:.6f} to {math.floor(upper * 1e6) / 1e6:.6f}"
