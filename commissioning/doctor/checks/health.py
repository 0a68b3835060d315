"""Check the health of the servos: alarms, temperature, limp servos, resets, and stalled servos."""

from collections.abc import Iterator
from typing import Final

from commissioning.doctor.checks.presence import place_of
from commissioning.doctor.findings import Finding, FindingPlace, finding
from commissioning.doctor.snapshot import ArmSnapshot, BusSnapshot, ServoSnapshot, on, release, show
from drivers.servos.catalog import series_of

WARM_C: Final = 8
"""Maximum distance from the temperature limit at which a servo counts as hot, in °C."""
PRESSES: Final = 0.95
"""Minimum drive at which a motionless servo counts as stalled, as a fraction of its torque limit."""
ALARMS: Final = {
    "overload": "alarm_overload",
    "current": "alarm_current",
    "temperature": "alarm_temperature",
    "voltage": "alarm_voltage",
}
CAUSES: Final = {
    "alarm_overload": (
        "overload error: the servo drives with a fraction of its force",
        "The servo drove with high force for seconds without moving: something is in its way, or its goal lies beyond "
        "a stop or an object. Support the arm, remove the load, and disable the servo's torque once to clear the alarm",
    ),
    "alarm_current": (
        "the servo went limp under load",
        "The current stayed above the limit, so the servo released its torque. It is stalled, or too weak for its "
        "load. The "
        "next goal enables the torque again: support the arm and remove the load first",
    ),
    "alarm_temperature": (
        "the servo is hot and loses force",
        "The servo is above its temperature limit and reduces its drive until it has cooled down. Let it rest with "
        "its torque disabled, "
        "then reduce the load that it holds permanently",
    ),
    "alarm_voltage": (
        "'input voltage error'",
        "A moment ago, the supply voltage was outside the limits that are set in the servo. Measure the supply under "
        "load, and compare it with these limits",
    ),
}


def check_health(snapshot: ArmSnapshot) -> Iterator[Finding]:
    """Check every servo that sent a state."""
    for bus in snapshot.buses:
        for servo in bus.servos:
            if servo.states:
                yield from _alarms(bus, servo)
                yield from _heat(place_of(bus, servo), servo)
                yield from _presses(place_of(bus, servo), servo)
        yield from _torque(bus)


def _alarms(bus: BusSnapshot, servo: ServoSnapshot) -> Iterator[Finding]:
    place = place_of(bus, servo)
    for alarm in dict.fromkeys(alarm for state in servo.states for alarm in state.alarms):
        kind = ALARMS.get(alarm, "alarm_other")
        symptom, cause = CAUSES.get(
            kind, (f"the servo reports {alarm}", "See the manual of the manufacturer for the meaning of this alarm")
        )
        yield finding(kind, place, symptom, cause, _clear(servo, kind))


def _clear(servo: ServoSnapshot, kind: str) -> str | None:
    """Return the command that clears an alarm.

    A Feetech servo clears most alarms when their cause has disappeared, but it clears an overload only when torque is
    disabled. A Dynamixel needs a reboot.
    """
    if series_of(servo.joint.model).make == "dynamixel":
        return on(servo.port, "reboot", servo.joint.servo_id)
    if kind in ("alarm_overload", "alarm_current"):
        return release(servo)
    return show(servo) if kind == "alarm_voltage" else None


def _heat(place: FindingPlace, servo: ServoSnapshot) -> Iterator[Finding]:
    limit = servo.registers.get("max_temperature", servo.registers.get("temperature_limit"))
    hottest = max(state.temperature_c for state in servo.states)
    if limit is not None and hottest > limit - WARM_C:
        cause = f"The servo is at {hottest:.0f} °C, near its limit of {limit} °C. Let it rest with its torque disabled"
        yield finding("hot", place, "the servo is hot and will soon lose force", cause)


def _presses(place: FindingPlace, servo: ServoSnapshot) -> Iterator[Finding]:
    """Find servos that are at full drive without moving in all states, such as a gripper that holds an object."""
    limit = series_of(servo.joint.model).torque_limit
    allowed = servo.registers.get(limit.name, 0) / series_of(servo.joint.model).full_torque if limit else 0.0
    still = all(state.velocity_counts_s == 0 for state in servo.states)
    if servo.holds and still and allowed and all(abs(state.load) >= PRESSES * allowed for state in servo.states):
        cause = (
            f"The servo drives at {100 * abs(servo.states[0].load):.0f} % of full drive but does not move, because its "
            "goal lies beyond a stop or an object. This heats the servo. Move the goal back, or lower torque_limit in "
            "the robot file"
        )
        yield finding("stalled", place, "a joint or gripper hums, gets hot and does not move", cause)


def _torque(bus: BusSnapshot) -> Iterator[Finding]:
    known = [servo for servo in bus.servos if "torque_enable" in servo.registers]
    holding = [servo for servo in known if servo.holds]
    for servo in known:
        place, held = place_of(bus, servo), servo.registers["torque_enable"]
        if held == 2:
            yield finding("damped", place, "the joint is hard to turn by hand",
                          "The servo is in damping mode: it brakes its motor but does not hold a position. Disable its "
                          "torque", release(servo))  # fmt: skip
        elif not servo.holds and len(holding) > len(known) / 2:
            cause = (
                f"Torque is enabled on {len(holding)} of {len(known)} servos, but not on this servo. The servo was "
                "reset by a power dip or released its torque to protect itself, or another program disabled its "
                "torque. Support the arm, disable the torque of all servos, and start the arm again"
            )
            yield finding("torque_lost", place, "one joint is limp while the others hold their positions", cause)
    yield from (_reset(bus, servo) for servo in holding if _has_forgotten(servo, holding))


def _has_forgotten(servo: ServoSnapshot, holding: list[ServoSnapshot]) -> bool:
    """Return whether the servo has its power-on torque limit, while most other servos have the lower limit that the
    stack set."""
    series = series_of(servo.joint.model)
    if series.torque_limit is None or not _is_full(servo):
        return False
    others = [other for other in holding if other is not servo]
    wanted = servo.joint.torque_limit * series.full_torque
    given_less = sum(not _is_full(other) for other in others) > len(others) / 2
    return given_less and servo.registers[series.torque_limit.name] >= min(
        wanted, servo.registers[series.max_torque.name]
    )


def _is_full(servo: ServoSnapshot) -> bool:
    series = series_of(servo.joint.model)
    limit = servo.registers.get(series.torque_limit.name) if series.torque_limit else None
    return limit is not None and limit >= servo.registers.get(series.max_torque.name, limit + 1)


def _reset(bus: BusSnapshot, servo: ServoSnapshot) -> Finding:
    cause = (
        "The servo has its power-on torque limit, not the lower limit that was set. It was therefore reset by a power "
        "dip, and the next goal enabled its torque "
        "again. Check the supply and the plugs. Then support the arm, disable the torque "
        "of all servos, and start the arm again"
    )
    return finding(
        "was_reset", place_of(bus, servo), "a joint jerks, or pushes harder than its torque limit allows", cause
    )
