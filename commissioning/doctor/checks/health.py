"""Alarms and how each is cleared, heat, torque that was lost, a memory that was reset, a servo that presses."""

from collections.abc import Iterator
from typing import Final

from commissioning.doctor.checks.presence import place_of
from commissioning.doctor.findings import Finding, Place, finding
from commissioning.doctor.snapshot import BusSnapshot, ServoSnapshot, Snapshot, let_go, on, show
from drivers.servos.catalog import series_of

WARM_C: Final = 8
"""So near to its limit a servo is hot."""
PRESSES: Final = 0.95
"""Share of the drive that it may use."""
ALARMS: Final = {
    "overload": "alarm_overload",
    "current": "alarm_current",
    "temperature": "alarm_temperature",
    "voltage": "alarm_voltage",
}
CAUSES: Final = {
    "alarm_overload": (
        "overload error: it drives with a fraction of its force",
        "it drove hard for seconds and did not move: something is in its way, or its goal lies beyond a stop or an "
        "object. Take the load away, and let go of it once",
    ),
    "alarm_current": (
        "it went limp under load",
        "its current stayed above its limit, and it let go: it is stalled or too weak for its load. The next goal "
        "switches it on again: support the arm, take the load away",
    ),
    "alarm_temperature": (
        "it is hot and gives way",
        "it is above its temperature limit and takes its drive away until it has cooled: let it rest without "
        "torque, and "
        "look for what it carries all the time",
    ),
    "alarm_voltage": (
        "'input voltage error'",
        "its voltage left its limits just now: measure the supply under load, and compare its limits",
    ),
}


def check_health(snapshot: Snapshot) -> Iterator[Finding]:
    """Every servo that gave a state."""
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
        symptom, cause = CAUSES.get(kind, (f"it reports {alarm}", "its maker's manual says what that means"))
        yield finding(kind, place, symptom, cause, _clear(servo, kind))


def _clear(servo: ServoSnapshot, kind: str) -> str | None:
    """A Feetech servo forgets an alarm with its cause, an overload when it is let go; a Dynamixel keeps it."""
    if series_of(servo.joint.model).make == "dynamixel":
        return on(servo.port, "reboot", servo.joint.servo_id)
    if kind in ("alarm_overload", "alarm_current"):
        return let_go(servo)
    return show(servo) if kind == "alarm_voltage" else None


def _heat(place: Place, servo: ServoSnapshot) -> Iterator[Finding]:
    limit = servo.registers.get("max_temperature", servo.registers.get("temperature_limit"))
    hottest = max(state.temperature_c for state in servo.states)
    if limit is not None and hottest > limit - WARM_C:
        cause = f"it has {hottest:.0f} °C, and its limit is {limit} °C: let it rest without torque"
        yield finding("hot", place, "it is hot, and will soon give way", cause)


def _presses(place: Place, servo: ServoSnapshot) -> Iterator[Finding]:
    """Full drive at standstill in every sample: a gripper on an object, or a goal beyond a stop."""
    limit = series_of(servo.joint.model).torque_limit
    allowed = servo.registers.get(limit.name, 0) / series_of(servo.joint.model).full_torque if limit else 0.0
    still = all(state.velocity_counts_s == 0 for state in servo.states)
    if servo.holds and still and allowed and all(abs(state.load) >= PRESSES * allowed for state in servo.states):
        cause = (
            f"it drives with {100 * abs(servo.states[0].load):.0f} % and does not move: its goal lies beyond a stop or "
            "an object. It heats up; take the goal back, or lower torque_limit in the robot file"
        )
        yield finding("stalled", place, "a joint or gripper hums, gets hot and does not move", cause)


def _torque(bus: BusSnapshot) -> Iterator[Finding]:
    known = [servo for servo in bus.servos if "torque_enable" in servo.registers]
    holding = [servo for servo in known if servo.holds]
    for servo in known:
        place, held = place_of(bus, servo), servo.registers["torque_enable"]
        if held == 2:
            yield finding("damped", place, "it is hard to turn by hand", "it brakes its motor and holds no position",
                          let_go(servo))  # fmt: skip
        elif not servo.holds and len(holding) > len(known) / 2:
            cause = (
                f"{len(holding)} of {len(known)} servos hold, and this one is limp: it was reset (a power dip), let go "
                "by itself, or was switched off by another program. Support the arm, let go of all, start again"
            )
            yield finding("torque_lost", place, "one joint is limp while the others hold", cause)
    yield from (_reset(bus, servo) for servo in holding if _has_forgotten(servo, holding))


def _has_forgotten(servo: ServoSnapshot, holding: list[ServoSnapshot]) -> bool:
    """Whether it drives with the limit of its power-on, although it, or most others, were given less."""
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
        "it holds with the torque limit that it has after power-on, not with the one that it was given: it was "
        "reset (a power dip) and a goal has switched it on again. Check the supply and the plugs, let go of all, "
        "start again"
    )
    return finding("was_reset", place_of(bus, servo), "a joint jerks, or is suddenly stronger than it may be", cause)
