"""The supply: what the servos have of it, against their rating and against their own limits."""

from collections.abc import Iterator, Mapping
from typing import Final

from commissioning.doctor.checks.presence import place_of
from commissioning.doctor.findings import Finding, Place, finding
from commissioning.doctor.snapshot import BusSnapshot, ServoSnapshot, Snapshot, write
from drivers.servos.voltage import voltage_fault, voltage_range

SAG_V: Final = 1.0
SAG_SHARE: Final = 0.15
DROP_V: Final = 0.8
"""Between two servos of one chain at rest: a lead or a plug with too much resistance."""
LIMITS: Final = (("min_voltage", "max_voltage"), ("min_voltage_limit", "max_voltage_limit"))
UNIT_V: Final = 0.1


def voltage_limits(registers: Mapping[str, int]) -> tuple[float, float] | None:
    """The servo's own limits, V; None where they could not be read."""
    for low, high in LIMITS:
        if low in registers and high in registers:
            return UNIT_V * registers[low], UNIT_V * registers[high]
    return None


def check_voltage(snapshot: Snapshot) -> Iterator[Finding]:
    """Every servo that gave a state, and what the chain makes of the supply."""
    lowest = {motion.joint.name: motion.lowest_v for motion in snapshot.motions}
    for bus in snapshot.buses:
        answering = [servo for servo in bus.servos if servo.states]
        for servo in answering:
            yield from _level(place_of(bus, servo), servo)
        yield from _together(bus, answering)
        yield from _sag(bus, answering, lowest)


def _level(place: Place, servo: ServoSnapshot) -> Iterator[Finding]:
    volts, model = _volts(servo), servo.joint.model
    lowest, highest, rated, name = min(volts), max(volts), model.rated_voltage_v, model.name
    limits, allowed = voltage_limits(servo.registers), voltage_range(model)
    if highest > allowed[1]:
        cause = (
            f"it has {highest:.1f} V, and a {name} is made for {rated:g} V: the supply is the wrong one or overshoots, "
            "or the model in the robot file is. Switch it off now"
        )
        yield finding("overvoltage", place, "'input voltage error', and servos that die", cause)
    elif lowest < allowed[0]:
        cause = (
            f"it has {lowest:.1f} V, and a {name} is made for {rated:g} V: the supply is the wrong one, off (USB alone "
            "feeds it), or too weak"
        )
        yield finding("undervoltage", place, "'input voltage error', weak or twitching servos", cause)
    elif limits and not limits[0] <= lowest <= highest <= limits[1]:
        cause = (
            f"it has {lowest:.1f} to {highest:.1f} V, which is right for a {name} ({rated:g} V), and its own "
            f"limits are {limits[0]:.1f} to {limits[1]:.1f} V"
        )
        wrong = next(low if lowest < limits[0] else high for low, high in LIMITS if low in servo.registers)
        value = round((allowed[0] if lowest < limits[0] else allowed[1]) / UNIT_V)
        command = write(servo, wrong, value)
        yield finding("voltage_limits_wrong", place, "'input voltage error' though the supply is right", cause, command)


def _together(bus: BusSnapshot, servos: list[ServoSnapshot]) -> Iterator[Finding]:
    """What servos of one rated voltage see: those of another one have a supply of their own."""
    for rated in dict.fromkeys(servo.joint.model.rated_voltage_v for servo in servos):
        at = [(max(_volts(servo)), servo.joint) for servo in servos if servo.joint.model.rated_voltage_v == rated]
        (highest, first), (lowest, last) = (pick(at, key=lambda one: one[0]) for pick in (max, min))
        kinds = {fault.kind for volts, joint in at if (fault := voltage_fault(joint.model, volts))}
        if "high supply" in kinds:
            cause = f"{highest:.1f} V were seen: a supply of {rated:g} V should not give that much"
            yield finding("supply_high", Place(bus=bus.name), "'input voltage error' now and then", cause)
        if "low supply" in kinds:
            cause = f"{lowest:.1f} V were seen, and the servos are made for {rated:g} V: they work with less torque"
            yield finding("supply_low", Place(bus=bus.name), "the arm is weak and slow", cause)
        if highest - lowest > DROP_V:
            cause = (
                f"{first.name} has {highest:.1f} V and {last.name} {lowest:.1f} V at rest: a lead or a plug between "
                "them has too much resistance"
            )
            yield finding("voltage_drops", Place(bus=bus.name), "servos far from the supply are weak or reset", cause)


def _volts(servo: ServoSnapshot) -> list[float]:
    return [state.voltage_v for state in servo.states]


def _sag(bus: BusSnapshot, servos: list[ServoSnapshot], moving_v: Mapping[str, float]) -> Iterator[Finding]:
    """Within the samples at rest, and while joints moved."""
    for servo in servos:
        volts = _volts(servo)
        lowest = min(*volts, moving_v.get(servo.joint.name, volts[0]))
        if max(volts) - lowest > max(SAG_V, SAG_SHARE * servo.joint.model.rated_voltage_v):
            cause = (
                f"the voltage at {servo.joint.name} went from {max(volts):.1f} down to {lowest:.1f} V: the supply "
                "is too weak, or its leads too thin. Servos that fall below their limit reset, and lose their "
                "torque in silence"
            )
            yield finding("supply_sags", Place(bus=bus.name), "servos reset or go limp under load", cause)
            return
