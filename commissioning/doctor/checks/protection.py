"""Check the protections and torque limits of the servos."""

from collections.abc import Iterator, Mapping
from typing import Final

from commissioning.doctor.checks.presence import place_of
from commissioning.doctor.findings import Finding, finding
from commissioning.doctor.snapshot import ArmSnapshot, BusSnapshot, ServoSnapshot, show, write
from drivers.servos import sts
from drivers.servos.catalog import series_of

HOTTEST_C: Final = 80
"""Highest safe temperature limit, in °C. The factory limits are 70 to 80 °C. Windings and plastic gears cannot
withstand higher temperatures."""
ACTING: Final = {name: bit for bit, name in sts.STATUS_BITS.items() if name in ("temperature", "current", "overload")}
"""Bits in the ``unloading_condition`` register of an STS that protect the motor."""
TEMPERATURE_LIMITS: Final = ("max_temperature", "temperature_limit")


def check_protection(snapshot: ArmSnapshot) -> Iterator[Finding]:
    """Check every servo whose registers could be read."""
    for bus in snapshot.buses:
        for servo in bus.servos:
            joint, held = servo.joint, servo.registers
            gaps = list(_gaps(held, joint.model.name in sts.MODELS))
            if gaps:
                cause = (
                    f"Protections are disabled in the servo: {'; '.join(gaps)}. A stalled servo can burn out, for "
                    "example when the goal of a gripper lies inside an object. Restore the factory values"
                )
                command = show(servo)
                yield finding("protection_off", place_of(bus, servo), "a stalled servo gets hot and smells", cause,
                              command)  # fmt: skip
            yield from _may_not_drive(bus, servo)


def _may_not_drive(bus: BusSnapshot, servo: ServoSnapshot) -> Iterator[Finding]:
    series = series_of(servo.joint.model)
    for register in (series.max_torque, series.torque_limit):
        if register is not None and servo.registers.get(register.name) == 0:
            cause = f"{register.name} is 0, so the motor does not drive. Write the full torque"
            command = write(servo, register.name, series.full_torque)
            yield finding(
                "no_torque_allowed",
                place_of(bus, servo),
                "torque is enabled, but the joint has no force",
                cause,
                command,
            )
            break


def _gaps(held: Mapping[str, int], is_sts: bool) -> Iterator[str]:
    for name in TEMPERATURE_LIMITS:
        if held.get(name, 0) > HOTTEST_C:
            yield f"{name} is {held[name]} °C"
    if not is_sts:
        return
    mask = held.get("unloading_condition")
    if mask is not None:
        off = [name for name, bit in ACTING.items() if not mask >> bit & 1]
        if off:
            yield f"unloading_condition {mask} does not stop the servo at {' and '.join(off)}"
    if held.get("protection_current") == 0 or held.get("overcurrent_time") == 0:
        yield "its current is not limited (protection_current or overcurrent_time is 0)"
    if held.get("protective_torque", 0) >= 100:
        yield f"after an overload it still drives with {held['protective_torque']} % (protective_torque)"
