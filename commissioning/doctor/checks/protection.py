"""A servo's protections: which of them act, and whether it may drive at all."""

from collections.abc import Iterator, Mapping
from typing import Final

from commissioning.doctor.checks.presence import place_of
from commissioning.doctor.findings import Finding, finding
from commissioning.doctor.snapshot import BusSnapshot, ServoSnapshot, Snapshot, show, write
from drivers.servos import sts
from drivers.servos.catalog import series_of

HOTTEST_C: Final = 80
"""The makers set limits of 70 to 80; windings and plastic gears stand no more."""
ACTING: Final = {name: bit for bit, name in sts.STATUS_BITS.items() if name in ("temperature", "current", "overload")}
"""Bits of an STS's ``unloading_condition`` that save a motor."""
TEMPERATURE_LIMITS: Final = ("max_temperature", "temperature_limit")


def check_protection(snapshot: Snapshot) -> Iterator[Finding]:
    """Every servo whose registers could be read."""
    for bus in snapshot.buses:
        for servo in bus.servos:
            joint, held = servo.joint, servo.registers
            gaps = list(_gaps(held, joint.model.name in sts.MODELS))
            if gaps:
                cause = f"{'; '.join(gaps)}: a servo that is stalled, as by a gripper's goal beyond the object, burns"
                command = show(servo)
                yield finding("protection_off", place_of(bus, servo), "a stalled servo gets hot and smells", cause,
                              command)  # fmt: skip
            yield from _may_not_drive(bus, servo)


def _may_not_drive(bus: BusSnapshot, servo: ServoSnapshot) -> Iterator[Finding]:
    series = series_of(servo.joint.model)
    for register in (series.max_torque, series.torque_limit):
        if register is not None and servo.registers.get(register.name) == 0:
            cause = f"its {register.name} is 0: it may not drive"
            command = write(servo, register.name, series.full_torque)
            yield finding("no_torque_allowed", place_of(bus, servo), "it has torque and no force", cause, command)
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
            yield f"unloading_condition {mask} lets it go on at {' and '.join(off)}"
    if held.get("protection_current") == 0 or held.get("overcurrent_time") == 0:
        yield "its current is not limited (protection_current or overcurrent_time is 0)"
    if held.get("protective_torque", 0) >= 100:
        yield f"after an overload it drives on with {held['protective_torque']} %"
