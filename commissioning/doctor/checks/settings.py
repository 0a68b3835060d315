"""How servos are set up, against the robot file: mode, limits, settings, gains, acknowledgement, lock."""

from collections.abc import Iterator, Mapping
from typing import Final

from commissioning.doctor.checks.presence import place_of
from commissioning.doctor.findings import Finding, Place, finding
from commissioning.doctor.snapshot import ServoSnapshot, Snapshot, on, write
from drivers.errors import ServoRefused
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import X
from drivers.servos.register import Register
from hal.compensation.servo_compliance import assumed_settings, compliance_of
from hal.joint import Joint
from hal.servos.servo_settings import mode_mistake, wanted_mode
from hal.servos.servo_setup import check_reach

WIDE_COUNTS: Final = 8
"""A dead zone of 0.7 degrees and more."""
SLOW_COUNTS_S2: Final = 20
"""Of ``max_acceleration``, in its units of 100 counts/s2: a fifth of what goals ask for."""
LONG_DELAYS: Final = {"return_delay": 25, "return_delay_time": 25}
"""Units of 2 us. The factory's 250 of a Dynamixel is half a millisecond for each servo and cycle."""


def check_settings(snapshot: Snapshot) -> Iterator[Finding]:
    """Every servo whose registers could be read."""
    for bus in snapshot.buses:
        for servo in bus.servos:
            if servo.registers and servo.registers.get("model_number") == servo.joint.model.number:
                place = place_of(bus, servo)
                yield from _mode(place, servo)
                yield from _limits(place, servo)
                yield from _named(place, servo)
                yield from _gains(place, servo)
                yield from _speech(place, servo)
                yield from _lock(place, servo)


def _mode(place: Place, servo: ServoSnapshot) -> Iterator[Finding]:
    joint, registers = servo.joint, servo.registers
    series = series_of(joint.model)
    names = {"operating_mode", "drive_mode", "control_mode", "phase", *(one.name for one in series.position_limits)}
    if not names & registers.keys():
        return

    def read(register: Register) -> int:
        return registers[register.name]

    try:
        wrong, odd = series.config_error(joint.model, read), series.config_warning(read)
        if not wrong and series is X:
            wrong = mode_mistake(joint, registers["operating_mode"])
    except KeyError:  # one of them could not be read
        return
    if wrong:
        mode = "operating_mode" if "operating_mode" in registers else "control_mode"
        operating = wanted_mode(joint) if series is X else 0
        value = {"operating_mode": operating, "control_mode": 2}[mode]
        command = write(servo, mode, value) if mode in registers and registers[mode] != value else None
        yield finding("wrong_mode", place, "it answers and looks healthy, and does not go to its goals", f"it {wrong}",
                      command)  # fmt: skip
    if odd:
        yield finding("speed_unit", place, "it moves far too slowly, or far too fast", f"its {odd}")


def _limits(place: Place, servo: ServoSnapshot) -> Iterator[Finding]:
    low, high = (servo.registers.get(one.name) for one in series_of(servo.joint.model).position_limits)
    if low is None or high is None or (low, high) == (0, 0) or servo.joint.extended:
        return
    try:
        check_reach(servo.joint, (low, high))
    except ServoRefused as error:
        symptom = "the joint stops before the end of its range, or forgets goals there"
        yield finding("limits_too_narrow", place, symptom, f"it {error.text}")


def _named(place: Place, servo: ServoSnapshot) -> Iterator[Finding]:
    """Settings that the robot file names and the servo has otherwise."""
    wanted, held = dict(servo.joint.settings), servo.registers
    others = [
        f"{name} is {held[name]}, not {value}" for name, value in wanted.items() if held.get(name, value) != value
    ]
    if others:
        cause = (
            f"{', '.join(others)}: the next start will write what the robot file says. If this comes back, another "
            "program writes its own values at each of its runs, and the EEPROM wears with every one"
        )
        yield finding("settings_differ", place, "settings are written again at each start", cause)


def _gains(place: Place, servo: ServoSnapshot) -> Iterator[Finding]:
    joint, held = servo.joint, servo.registers
    assumed, named = assumed_settings(joint.model), dict(joint.settings)
    if not assumed:
        return
    has = {name: held[name] for name in assumed if name in held}
    if has.get("position_p") == 0:
        command = write(servo, "position_p", assumed["position_p"])
        yield finding("no_gain", place, "it holds nothing and goes nowhere", "its position_p is 0", command)
    elif others := _others(joint, assumed, named, has):
        said = "{" + ", ".join(f"{name}: {value}" for name, value in others.items()) + "}"
        cause = (
            f"it has other gains than the factory's, and the robot file does not name them: sag and lag are reckoned "
            f"with the factory's. Write settings: {said} into the robot file, or what you want them to be"
        )
        yield finding("gains_differ", place, "the joint follows less well than it could", cause)
    zone = max(has.get("cw_dead_zone", 0), has.get("ccw_dead_zone", 0))
    if zone > max(WIDE_COUNTS, named.get("cw_dead_zone", 0), named.get("ccw_dead_zone", 0)):
        cause = f"its dead zones leave errors of {zone} counts uncorrected (the factory's are 1)"
        yield finding("wide_dead_zone", place, "the joint stops short of its goals", cause)
    if 0 < has.get("max_acceleration", 0) < min(SLOW_COUNTS_S2, named.get("max_acceleration", SLOW_COUNTS_S2)):
        cause = f"its max_acceleration is {100 * has['max_acceleration']} counts/s2 (the factory's is 10000)"
        yield finding("slow_acceleration", place, "the joint starts slowly and lags behind", cause)


def _others(
    joint: Joint, assumed: Mapping[str, int], named: Mapping[str, int], has: Mapping[str, int]
) -> Mapping[str, int]:
    """Gains that nobody reckons with, where they change how the joint gives way or lags."""
    unnamed = {name: value for name, value in has.items() if name not in named}
    if compliance_of(joint.model, settings={**named, **unnamed}) == compliance_of(joint.model, settings=dict(named)):
        return {}
    return {name: value for name, value in unnamed.items() if value != assumed[name]}


def _speech(place: Place, servo: ServoSnapshot) -> Iterator[Finding]:
    series = series_of(servo.joint.model)
    level = servo.registers.get(series.status_level.name)
    if level is not None and level < series.answers_all:
        cause = f"its {series.status_level.name} is {level}: writes are not acknowledged"
        command = write(servo, series.status_level.name, series.answers_all)
        yield finding("writes_unacknowledged", place, "writes to it seem to fail", cause, command)
    for name, long in LONG_DELAYS.items():
        if (delay := servo.registers.get(name, 0)) >= long:
            cause = f"it waits {2 * delay} us before each answer"
            yield finding("return_delay", place, "the loop is slower than it could be", cause,
                          write(servo, name, 0))  # fmt: skip


def _lock(place: Place, servo: ServoSnapshot) -> Iterator[Finding]:
    lock = series_of(servo.joint.model).lock
    if lock is not None and servo.registers.get(lock.name) == 0:
        cause = "its EEPROM was left unlocked: a stray write lasts, and each write wears it. A restart locks it"
        command = on(servo.port, "reboot", servo.joint.servo_id)
        yield finding("lock_open", place, "settings change by themselves", cause, command)
