"""Check the supply voltage against the ratings of the servos and the limits that are set in them."""

from collections.abc import Iterator, Mapping
from typing import Final

from commissioning.doctor.checks.presence import place_of
from commissioning.doctor.findings import Finding, FindingPlace, finding
from commissioning.doctor.snapshot import ArmSnapshot, BusSnapshot, ServoSnapshot, write
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
        for servo in answering:
            yield from _level(place_of(bus, servo), servo)
        yield from _together(bus, answering)
        yield from _sag(bus, answering, lowest)


def _level(place: FindingPlace, servo: ServoSnapshot) -> Iterator[Finding]:
    volts, model = _volts(servo), servo.joint.model
    lowest, highest, rated, name = min(volts), max(volts), model.rated_voltage_v, model.name
    limits, allowed = voltage_limits(servo.registers), voltage_range(model)
    if highest > allowed[1]:
        cause = (
            f"The supply voltage is {highest:.1f} V, but an {name} is rated for {rated:g} V. Switch the supply off "
            "now. Then check that the supply has the right voltage without overshoot, and that the model in the robot "
            "file is right"
        )
        yield finding("overvoltage", place, "'input voltage error', and servos may be destroyed", cause)
    elif lowest < allowed[0]:
        cause = (
            f"The supply voltage is {lowest:.1f} V, but an {name} is rated for {rated:g} V. The supply is wrong, too "
            f"weak, or switched off (then the servo is powered from USB)"
        )
        yield finding("undervoltage", place, "'input voltage error', weak or twitching servos", cause)
    elif limits and not limits[0] <= lowest <= highest <= limits[1]:
        cause = (
            f"The supply voltage of {lowest:.1f} to {highest:.1f} V is right for an {name} ({rated:g} V), but the "
            f"limits in the servo are {limits[0]:.1f} to {limits[1]:.1f} V. Correct the limit"
        )
        wrong = next(low if lowest < limits[0] else high for low, high in LIMITS if low in servo.registers)
        value = round((allowed[0] if lowest < limits[0] else allowed[1]) / UNIT_V)
        command = write(servo, wrong, value)
        yield finding(
            "voltage_limits_wrong", place, "'input voltage error' although the supply voltage is right", cause, command
        )


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
