"""Check the settings of the servos: mode, limits, gains, status level, return delay and lock."""

from collections.abc import Iterator, Mapping
from typing import Final

from commissioning.doctor.checks.presence import place_of
from commissioning.doctor.findings import Finding, FindingPlace, finding
from commissioning.doctor.snapshot import ArmSnapshot, ServoSnapshot, counts_turns, on, write
from drivers.driver_errors import ServoRefused
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import X
from drivers.servos.register import Register
from hal.compensation.servo_compliance import assumed_settings, compliance_of
from hal.joint import Joint
from hal.servos.servo_gains import foreign_gains, wanted_gains
from hal.servos.servo_settings import check_reach, mode_mistake, settings_of, wanted_mode

WIDE_COUNTS: Final = 8
"""Maximum dead zone that is not reported as a finding, in counts. 8 counts are 0.7 degrees."""
SLOW_COUNTS_S2: Final = 20
"""Minimum acceptable ``max_acceleration``, in units of 100 counts/s2: one fifth of the goals' acceleration."""
LONG_DELAYS: Final = {"return_delay": 25, "return_delay_time": 25}
"""Maximum return delay that is not reported as a finding, in units of 2 us. The factory default of a Dynamixel, 250,
costs half a millisecond per servo and cycle.
"""


def check_settings(snapshot: ArmSnapshot) -> Iterator[Finding]:
    """Check every servo whose registers could be read."""
    for bus in snapshot.buses:
        for servo in bus.servos:
            if servo.registers and servo.registers.get("model_number") == servo.joint.model.number:
                place = place_of(bus, servo)
                yield from _mode(place, servo)
                yield from _limits(place, servo)
                yield from _named(place, servo)
                yield from _foreign_gains(place, servo)
                yield from _gains(place, servo)
                yield from _speech(place, servo)
                yield from _lock(place, servo)


def _mode(place: FindingPlace, servo: ServoSnapshot) -> Iterator[Finding]:
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
            wrong = mode_mistake(joint, registers["operating_mode"], registers.get("homing_offset", 0))
    except KeyError:  # A register could not be read.
        return
    if wrong:
        mode = "operating_mode" if "operating_mode" in registers else "control_mode"
        operating = wanted_mode(joint, registers.get("homing_offset", 0)) if series is X else 0
        value = {"operating_mode": operating, "control_mode": 2}[mode]
        command = write(servo, mode, value) if mode in registers and registers[mode] != value else None
        yield finding("wrong_mode", place, "the servo responds without an alarm, but does not move to its goals",
                      f"The servo {wrong}", command)  # fmt: skip
    if odd:
        yield finding("speed_unit", place, "the joint moves far too slowly or far too fast", f"Its {odd}")


def _limits(place: FindingPlace, servo: ServoSnapshot) -> Iterator[Finding]:
    if servo.joint.extended or counts_turns(servo.registers):
        return  # A servo in extended position mode, or one that must be set to this mode, ignores its position limits.
    low, high = (servo.registers.get(one.name) for one in series_of(servo.joint.model).position_limits)
    if low is None or high is None or (low, high) == (0, 0):
        return
    try:
        check_reach(servo.joint, (low, high))
    except ServoRefused as error:
        symptom = "the joint stops before the end of its range, or ignores goals near the end"
        yield finding("limits_too_narrow", place, symptom, f"The servo {error.text}")


def _named(place: FindingPlace, servo: ServoSnapshot) -> Iterator[Finding]:
    """Find settings whose values in the servo differ from the robot file."""
    wanted, held = dict(servo.joint.settings), servo.registers
    others = [
        f"{name} is {held[name]}, not {value}"
        for name, value in wanted.items()
        if held.get(name, value) != value and settings_of(servo.joint.model)[name].persistent
    ]
    if others:
        cause = (
            f"Settings differ from the robot file: {', '.join(others)}. The next start of the arm corrects them. If "
            "they differ again later, another program overwrites them at each of its runs, which wears the EEPROM"
        )
        yield finding("settings_differ", place, "settings are written again at each start", cause)


def _foreign_gains(place: FindingPlace, servo: ServoSnapshot) -> Iterator[Finding]:
    """Find gains in RAM that another program has set."""
    joint = servo.joint
    held = {register: servo.registers[register.name] for register in wanted_gains(joint)
            if register.name in servo.registers}  # fmt: skip
    if foreign := foreign_gains(joint, held):
        wanted = wanted_gains(joint)
        listed = ", ".join(f"{register.name} is {value}, not {wanted[register]}" for register, value in foreign.items())
        cause = (
            f"Another program has set gains in the servo's RAM: {listed}. The next start of the arm writes the gains "
            f"of the robot file, and factory values for gains that the file does not "
            f"contain. Until then, other programs use "
            "these gains. A restart of the servo resets them"
        )
        command = on(servo.port, "reboot", joint.servo_id) if series_of(joint.model).protocol.reboot != "none" else None
        yield finding("gains_left", place, "the joint is weak, stiff, or overshoots", cause, command)


def _gains(place: FindingPlace, servo: ServoSnapshot) -> Iterator[Finding]:
    joint, held = servo.joint, servo.registers
    assumed, named = assumed_settings(joint.model), dict(joint.settings)
    if not assumed:
        return
    has = {name: held[name] for name in assumed if name in held}
    if has.get("position_p") == 0:
        command = write(servo, "position_p", assumed["position_p"])
        cause = "position_p is 0, so the servo does not react to position errors. Write the factory value"
        yield finding("no_gain", place, "the joint neither holds its position nor moves", cause, command)
    elif others := _others(joint, assumed, named, has):
        listed = "{" + ", ".join(f"{name}: {value}" for name, value in others.items()) + "}"
        cause = (
            "The gains differ from the factory gains and are not in the robot file, so sag and lag are computed from "
            f"the wrong gains. Add settings: {listed} to the robot file, or the values that you want"
        )
        yield finding("gains_differ", place, "the joint follows less accurately than it could", cause)
    zone = max(has.get("cw_dead_zone", 0), has.get("ccw_dead_zone", 0))
    if zone > max(WIDE_COUNTS, named.get("cw_dead_zone", 0), named.get("ccw_dead_zone", 0)):
        cause = (
            f"The dead zone leaves errors of up to {zone} counts uncorrected. Set cw_dead_zone and ccw_dead_zone to "
            "the factory value of 1"
        )
        yield finding("wide_dead_zone", place, "the joint stops short of its goals", cause)
    if 0 < has.get("max_acceleration", 0) < min(SLOW_COUNTS_S2, named.get("max_acceleration", SLOW_COUNTS_S2)):
        cause = (
            f"max_acceleration is only {100 * has['max_acceleration']} counts/s2. Set it back to the factory value of "
            f"10000 counts/s2"
        )
        yield finding("slow_acceleration", place, "the joint starts slowly and lags behind", cause)


def _others(
    joint: Joint, assumed: Mapping[str, int], named: Mapping[str, int], has: Mapping[str, int]
) -> Mapping[str, int]:
    """Return the gains that affect the sag or the lag of the joint and are missing from the robot file."""
    unnamed = {name: value for name, value in has.items() if name not in named}
    if compliance_of(joint.model, settings={**named, **unnamed}) == compliance_of(joint.model, settings=dict(named)):
        return {}
    return {name: value for name, value in unnamed.items() if value != assumed[name]}


def _speech(place: FindingPlace, servo: ServoSnapshot) -> Iterator[Finding]:
    series = series_of(servo.joint.model)
    level = servo.registers.get(series.status_level.name)
    if level is not None and level < series.answers_all:
        cause = (
            f"{series.status_level.name} is {level}, so the servo does not acknowledge writes. Set it to "
            f"{series.answers_all}"
        )
        command = write(servo, series.status_level.name, series.answers_all)
        yield finding("writes_unacknowledged", place, "writes to the servo seem to fail", cause, command)
    for name, long in LONG_DELAYS.items():
        if (delay := servo.registers.get(name, 0)) >= long:
            cause = f"The servo waits {2 * delay} us before each reply ({name} is {delay}). Set {name} to 0"
            yield finding("return_delay", place, "the loop is slower than it could be", cause,
                          write(servo, name, 0))  # fmt: skip


def _lock(place: FindingPlace, servo: ServoSnapshot) -> Iterator[Finding]:
    lock = series_of(servo.joint.model).lock
    if lock is not None and servo.registers.get(lock.name) == 0:
        cause = (
            "The EEPROM is unlocked, so an accidental write is permanent, and every write wears the EEPROM. Restart "
            "the servo to lock the EEPROM"
        )
        command = on(servo.port, "reboot", servo.joint.servo_id)
        yield finding("lock_open", place, "settings change unexpectedly", cause, command)
