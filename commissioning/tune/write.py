"""The writing of gains: to a servo without torque, only what differs, read back, and the EEPROM locked again."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

from calibration.eeprom import HOLDS, EepromError, update
from commissioning.tune.gains import gains_of
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.servos.catalog import series_of
from drivers.servos.register import Register
from hal.joint import Joint


@dataclass(frozen=True, slots=True)
class Written:
    """One gain that was changed."""

    gain: str
    register: str
    old: int
    new: int


def write_gains(bus: Bus, joint: Joint, values: Mapping[str, int]) -> tuple[Written, ...]:
    """Make the joint's servo hold these gains, by name; what had to be changed.

    Raises ServoError where a servo holds torque or does not take one, PortLost once the line is gone.
    """
    known = gains_of(joint.model)
    names = {known[name]: name for name in values}
    saved = {register: values[name] for register, name in names.items() if register.persistent}
    changes = update(bus, joint.servo_id, series_of(joint.model).lock, saved) if saved else ()
    done = [Written(names[one.register], one.register.name, one.old, one.new) for one in changes]
    for register, name in names.items():
        if not register.persistent and (old := _set(bus, joint, register, values[name])) is not None:
            done.append(Written(name, register.name, old, values[name]))
    return tuple(done)


def _set(bus: Bus, joint: Joint, register: Register, value: int) -> int | None:
    """Write a register of RAM, if it holds something else; what that was."""
    held = partial(bus.read, joint.servo_id, register)
    old = retry(held)
    if old == value:
        return None
    if bus.torque_is_on(joint.servo_id):
        raise EepromError(joint.servo_id, register, f"is not written: {HOLDS}")
    retry(partial(bus.write, joint.servo_id, register, value))
    if (now := retry(held)) != value:
        raise EepromError(joint.servo_id, register, f"stays {now}, not {value}: the servo does not take it")
    return old
