"""Check the supply voltage against the ratings of the servos and the limits that are set in them."""

from collections.abc import Iterator, Mapping
from typing import Final

from commissioning.doctor.checks.presence import place_of
from commissioning.doctor.findings import Finding, FindingPlace, finding
from commissioning.doctor.snapshot import ArmSnapshot, BusSnapshot, ServoSnapshot, write
from drivers.servos.catalog import other_rated_voltages, series_of
from drivers.servos.register import ServoModel
from drivers.servos.voltage import voltage_fault, voltage_range

SAG_V: Final = 1.0
SAG_SHARE: Final = 0.15
"""Minimum voltage drop of a sagging supply, as a fraction of the rated voltage. The drop must also exceed ``SAG_V``."""
DROP_V: Final = 0.8
"""Maximum voltage difference between two servos on one bus at rest. A larger difference indicates a cable or plug with
high resistance.
"""
LIMITS: Final = (("min_voltage", "max_voltage"), ("min_voltage_limit", "max_voltage_limit"))
UNIT_V: Final = 0.1
SYMPTOMS: Final = {
    "overvoltage": "'input voltage error', and servos may be destroyed",
    "undervoltage": "'input voltage error', weak or twitching servos",
    "voltage_limits_wrong": "'input voltage error' although the supply voltage suits the model in the robot file",
}


def voltage_limits(registers: Mapping[str, int]) -> tuple[float, float] | None:
    """Return the voltage limits set in a servo; None if they could not be read."""
    for low, high in LIMITS:
        if low in registers and high in registers:
            return UNIT_V * registers[low], UNIT_V * registers[high]
    return None


def check_voltage(snapshot: ArmSnapshot) -> Iterator[Finding]:
    """Check every servo that sent a state, and compare the servos of each bus."""
    lowest = {motion.joint.name: motion.lowest_v for motion in snapshot.motion_test.motions}
    for bus in snapshot.buses:
        answering = [servo for servo in bus.servos if servo.states]
        yield from _levels(bus, answering)
        yield from _together(bus, answering)
        yield from _sag(bus, answering, lowest)


def _level_fault(servo: ServoSnapshot) -> str | None:
    """Return the kind of finding if the supply voltage of a servo is outside its rated range or its limits."""
    volts, limits, (low, high) = _volts(servo), voltage_limits(servo.registers), voltage_range(servo.joint.model)
    if max(volts) > high:
        return "overvoltage"
    if min(volts) < low:
        return "undervoltage"
    return "voltage_limits_wrong" if limits and not limits[0] <= min(volts) <= max(volts) <= limits[1] else None


def _levels(bus: BusSnapshot, servos: list[ServoSnapshot]) -> Iterator[Finding]:
    """Check the voltage of every servo. Servos of one model with the same fault share a finding."""
    groups: dict[tuple[str, ServoModel, tuple[float, float] | None, str | None], list[ServoSnapshot]] = {}
    for servo in servos:
        if kind := _level_fault(servo):
            limits = voltage_limits(servo.registers) if kind == "voltage_limits_wrong" else None
            command = _limit_command(servo) if limits else None
            groups.setdefault((kind, servo.joint.model, limits, command), []).append(servo)
    for (kind, _, _, command), group in groups.items():
        place = place_of(bus, group[0]) if len(group) == 1 else FindingPlace(bus=bus.name)
        cause = _limits_cause(group, command is not None) if kind == "voltage_limits_wrong" else _supply_cause(group)
        yield finding(kind, place, SYMPTOMS[kind], cause, command)


def _supply_cause(group: list[ServoSnapshot]) -> str:
    """Describe a supply voltage outside the rated range."""
    (lowest, highest), model = _extremes(group), group[0].joint.model
    too_high = highest > voltage_range(model)[1]
    shown = (
        f"{_named(group)} {'has' if len(group) == 1 else 'have'} {highest if too_high else lowest:.1f} V, but the "
        f"{model.name} is rated for {model.rated_voltage_v:g} V"
    )
    wrong_arm = "the wrong --arm, or the wrong model in the robot file, is selected: read the label of a servo"
    if too_high:
        return f"{shown}. Switch the supply off now. Either the supply is wrong or not stable, or {wrong_arm}"
    return (
        f"{shown}. The supply is wrong, too weak, or switched off (then the servos are powered from USB), or "
        f"{wrong_arm}"
    )


def _limits_cause(group: list[ServoSnapshot], correctable: bool) -> str:
    """Describe voltage limits that exclude the supply voltage, although it suits the model in the robot file."""
    (lowest, highest), servo, model = _extremes(group), group[0], group[0].joint.model
    low, high = voltage_limits(servo.registers) or (lowest, highest)
    shown = f"The limits in {_named(group)} are {low:.1f} to {high:.1f} V, but the supply voltage is "
    shown += f"{highest if highest > high else lowest:.1f} V"
    if correctable:
        return f"{shown}, which is right for an {model.name} ({model.rated_voltage_v:g} V). Correct the limit"
    others = " or ".join(f"{volts:g} V" for volts in other_rated_voltages(model))
    version = f"the {others} version of the {model.name}" if others else f"another model, not an {model.name}"
    return (
        f"{shown}. The servo may be {version}: switch the supply off and read its label. Then correct --arm, the model "
        f"in the robot file or the supply. Correct {_wrong_limit(servo)} only if the label states "
        f"{model.rated_voltage_v:g} V"
    )


def _wrong_limit(servo: ServoSnapshot) -> str:
    """Return the name of the register whose limit excludes the supply voltage."""
    limits = voltage_limits(servo.registers)
    too_low = limits is not None and min(_volts(servo)) < limits[0]
    return next(low if too_low else high for low, high in LIMITS if low in servo.registers)


def _limit_command(servo: ServoSnapshot) -> str | None:
    """Return the command that corrects a voltage limit.

    Return None if the servo could be a version with another rated voltage, because its supply could then destroy it.
    """
    model = servo.joint.model
    identified = servo.registers.get("model_number") == model.number and not other_rated_voltages(model)
    if series_of(model).make == "feetech" or not identified:
        return None
    name, (lowest, highest) = _wrong_limit(servo), voltage_range(model)
    return write(servo, name, round((lowest if name.startswith("min") else highest) / UNIT_V))


def _named(group: list[ServoSnapshot]) -> str:
    return ", ".join(f"{servo.joint.name} (servo {servo.joint.servo_id})" for servo in group)


def _extremes(group: list[ServoSnapshot]) -> tuple[float, float]:
    """Return the lowest and the highest voltage that these servos measured."""
    volts = [volts for servo in group for volts in _volts(servo)]
    return min(volts), max(volts)


def _together(bus: BusSnapshot, servos: list[ServoSnapshot]) -> Iterator[Finding]:
    """Compare the voltages of servos with the same rated voltage.

    Servos with a different rated voltage have their own power supply.
    """
    for rated in dict.fromkeys(servo.joint.model.rated_voltage_v for servo in servos):
        at = [(max(_volts(servo)), servo.joint) for servo in servos if servo.joint.model.rated_voltage_v == rated]
        (highest, first), (lowest, last) = (pick(at, key=lambda one: one[0]) for pick in (max, min))
        kinds = {fault.kind for volts, joint in at if (fault := voltage_fault(joint.model, volts))}
        if "high supply" in kinds:
            cause = (
                f"The servos measure up to {highest:.1f} V, too much for a supply of {rated:g} V. Check the supply, or "
                "replace it"
            )
            yield finding("supply_high", FindingPlace(bus=bus.name), "occasional 'input voltage error'", cause)
        if "low supply" in kinds:
            cause = (
                f"The supply voltage is only {lowest:.1f} V, but the servos are rated for {rated:g} V, so they have "
                "less torque. Check the supply, or replace it"
            )
            yield finding("supply_low", FindingPlace(bus=bus.name), "the arm is weak and slow", cause)
        if highest - lowest > DROP_V:
            cause = (
                f"At rest, {first.name} has {highest:.1f} V but {last.name} only {lowest:.1f} V. Check the cables and "
                f"plugs between the two servos: one of them has too much resistance"
            )
            yield finding(
                "voltage_drops", FindingPlace(bus=bus.name), "servos far from the supply are weak or reset", cause
            )


def _volts(servo: ServoSnapshot) -> list[float]:
    return [state.voltage_v for state in servo.states]


def _sag(bus: BusSnapshot, servos: list[ServoSnapshot], moving_v: Mapping[str, float]) -> Iterator[Finding]:
    """Find voltage drops at rest and during the motion test."""
    for servo in servos:
        volts = _volts(servo)
        lowest = min(*volts, moving_v.get(servo.joint.name, volts[0]))
        if max(volts) - lowest > max(SAG_V, SAG_SHARE * servo.joint.model.rated_voltage_v):
            cause = (
                f"The voltage at {servo.joint.name} dropped from {max(volts):.1f} V to {lowest:.1f} V. The supply is "
                "too weak, or its cables are too thin. Below a minimum voltage, a servo resets and goes limp "
                "without an alarm"
            )
            yield finding("supply_sags", FindingPlace(bus=bus.name), "servos reset or go limp under load", cause)
            return
