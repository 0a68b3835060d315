"""The set-up of the servos behind the joints: checks with diagnosis, measurements without a hurry, and their torque."""

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TypeVar

from calibration.eeprom import EepromError
from drivers.bus.bus import Bus
from drivers.bus.retry import ATTEMPTS, retry
from drivers.bus.types import Reading, ServoFault, ServoState
from drivers.errors import DriverError, PortError, ServoError, ServoRefused, ServoSilent
from drivers.servos import sts
from drivers.servos.catalog import series_of
from drivers.servos.voltage import voltage_fault
from hal.joint import Joint
from hal.servos.diagnose import NOWHERE, diagnose, diagnose_known, now_and_then
from hal.servos.fault_log import FaultLog
from hal.servos.joint_buses import JointBuses
from hal.servos.servo_faults import REBOOT
from hal.servos.servo_settings import apply_settings, check_homing_offset, check_mode, warn_of_other_gains

Result = TypeVar("Result")


class ServoSetup:
    """The set-up asks and tells servos one by one, and takes its time: none of this belongs into a cycle."""

    def __init__(self, buses: JointBuses) -> None:
        self._buses = buses

    def check(self) -> None:
        """Check that every servo is there and is what the robot file says, and make its settings those of the file.

        Raises DriverError with all that are not, or whose settings could not be made so.
        """
        if problems := self.strangers():
            raise DriverError("\n".join(problems))
        self.settle()

    def settle(self) -> None:
        """Make the settings of known servos those of the robot file. Raises DriverError with all that cannot be."""
        if problems := self._all_unsettled():
            raise DriverError("\n".join(problems))
        for name, bus in self._buses.buses.items():
            with self._buses.named(name):
                _failed(self._buses.joints_on[name], bus, warn_of_other_gains)  # of one that is silent now: no matter

    def problems(self) -> list[str]:
        """Check every servo, and make its settings those of the robot file; returns what is wrong, by joint."""
        return self.strangers() or self._all_unsettled()

    def _all_unsettled(self) -> list[str]:
        return [problem for name, bus in self._buses.buses.items() for problem in self._unsettled(name, bus)]

    def strangers(self) -> list[str]:
        """Check that every servo is there and of its joint's model; nothing is written. Returns what is wrong."""
        return [problem for name, bus in self._buses.buses.items() for problem in self._strangers(name, bus)]

    def _unsettled(self, name: str, bus: Bus) -> list[str]:
        joints = self._buses.joints_on[name]
        with self._buses.named(name):
            errors = _failed(joints, bus, _settle)
        told = (EepromError, ServoRefused)
        problems = {i: str(e) if isinstance(e, told) else now_and_then(i, bus.name) for i, e in errors.items()}
        return [f"{self._buses.label(j)}: {problems[j.servo_id]}" for j in joints if j.servo_id in problems]

    def _strangers(self, name: str, bus: Bus) -> list[str]:
        joints = self._buses.joints_on[name]
        with self._buses.named(name):
            errors = _failed(joints, bus, _identify)
            unheard = [i for i, error in errors.items() if not isinstance(error, ServoRefused)]
            causes = diagnose(bus, unheard) if unheard else {}
            # Two of one model and one ID have the same number: only their states give them away.
            known = [joint.servo_id for joint in joints if joint.servo_id not in errors]
            found = _states(bus, known)
            causes |= _stateless(bus, found) | _ill_fed(joints, bus, found)
        if len(causes) == len(joints) and all(NOWHERE in text for text in causes.values()):
            which = f" (bus {name})" if len(self._buses.buses) > 1 else ""
            return [f"no servo answers on {bus.name}{which} at any baud rate: check the servos' power and their IDs"]
        problems = {
            i: now_and_then(i, bus.name) if i in unheard else str(error) for i, error in errors.items()
        } | causes
        return [f"{self._buses.label(j)}: {problems[j.servo_id]}" for j in joints if j.servo_id in problems]

    def measure(self) -> dict[str, Reading]:
        """Measure every servo once, without a hurry, by joint name; a fault has its cause, if one is found."""
        readings: dict[str, Mapping[int, Reading]] = {}
        for name, bus in self._buses.buses.items():
            with self._buses.named(name):
                found = _states(bus, [joint.servo_id for joint in self._buses.joints_on[name]])
                causes = _stateless(bus, found)
                readings[name] = {i: _with_cause(reading, causes.get(i)) for i, reading in found.items()}
        return self._buses.by_joint(readings)

    def goal(self, joint: Joint) -> int:
        """The goal that the servo holds, in counts."""
        return self._ask(joint, lambda bus: bus.goal(joint.servo_id))

    def position_limits(self, joint: Joint) -> tuple[int, int] | None:
        """The servo's own position limits in counts; None where it has none."""
        return self._ask(joint, lambda bus: bus.position_limits(joint.servo_id))

    def torque_is_on(self, joint: Joint) -> bool:
        """Whether the servo drives its motor."""
        return self._ask(joint, lambda bus: bus.torque_is_on(joint.servo_id))

    def drives(self, joint: Joint) -> bool:
        """Return whether the servo does anything with its motor; braking counts."""
        register = series_of(joint.model).torque_enable
        return self._ask(joint, lambda bus: retry(partial(bus.read, joint.servo_id, register))) != 0

    def forget_turns(self, joints: Sequence[Joint]) -> None:
        """Have limp servos take their place within the turn for their place.

        They must not count what they do not report.
        """
        log = FaultLog()
        try:
            for joint in joints:
                if joint.model in sts.MODELS.values():
                    self._ask(joint, partial(forget_turns, joint, log))
        finally:
            log.flush()

    def limit_torque(self, joint: Joint) -> None:
        """Limit the servo's drive to the joint's share of full drive."""
        self._ask(joint, lambda bus: bus.limit_torque(joint.servo_id, joint.torque_limit))

    def torque_on(self, joint: Joint) -> None:
        """Drive the motor."""
        self._ask(joint, lambda bus: _torque_on(joint, bus))

    def _ask(self, joint: Joint, question: Callable[[Bus], Result]) -> Result:
        with self._buses.named(joint.bus):
            return question(self._buses.buses[joint.bus])

    def torque_off(self, joints: Sequence[Joint]) -> list[str]:
        """Let go of these joints, on every bus whatever becomes of the others; returns what failed."""
        problems: list[str] = []
        for name, bus in self._buses.buses.items():
            on = [joint for joint in joints if joint.bus == name]
            try:
                with self._buses.named(name):
                    failed = bus.torque_off([joint.servo_id for joint in on]) if on else []
                problems += [self._said(on, error) for error in failed]
            except PortError as error:
                problems.append(str(error))
        return problems

    def _said(self, joints: Sequence[Joint], error: ServoError) -> str:
        if len(self._buses.buses) == 1:
            return str(error)
        joint = next(joint for joint in joints if joint.servo_id == error.servo_id)
        return f"{self._buses.label(joint)}: {error}"


def _failed(joints: Sequence[Joint], bus: Bus, step: Callable[[Joint, Bus], None]) -> dict[int, ServoError]:
    """Take this step with all of them; what failed, by servo."""
    errors: dict[int, ServoError] = {}
    for joint in joints:
        try:
            step(joint, bus)
        except ServoError as error:
            errors[joint.servo_id] = error
    return errors


def _identify(joint: Joint, bus: Bus) -> None:
    bus.identify(joint.servo_id, joint.model)
    check_mode(joint, bus)
    check_homing_offset(joint, bus)


def _settle(joint: Joint, bus: Bus) -> None:
    """The position limits are looked at behind the settings, which may name them."""
    apply_settings(joint, bus)
    limits = bus.position_limits(joint.servo_id)
    if limits is None and joint.settings:  # both 0 make a motor of some
        bus.check_settings(joint.servo_id, joint.model)
    check_reach(joint, limits)


def forget_turns(joint: Joint, log: FaultLog, bus: Bus) -> None:
    """Send the instruction, which some servos and adapters do not know. Raises ServoRefused if it cannot be left out.

    A joint that cannot pass its servo's last count has no turns to forget.
    """
    try:
        retry(lambda: bus.forget_turns(joint.servo_id))
    except (ServoSilent, ServoRefused) as error:
        retry(partial(bus.ping, joint.servo_id))  # raises if the servo itself is silent
        name = "the instruction 0x0A (forget turns)"
        if joint.seam_inside:
            raise ServoRefused(
                joint.servo_id,
                f"does not carry out {name}, and its joint passes the end of its counts: calibrate it with the seam "
                "outside its range, or use an adapter that passes the instruction on",
            ) from error
        text = f"{joint.name}: servo {joint.servo_id} does not carry out {name}: going on without it"
        log.note(logging.WARNING, joint.name, joint.servo_id, text)


def _torque_on(joint: Joint, bus: Bus) -> None:
    """A Dynamixel that has shut down refuses, and another register says why."""
    try:
        bus.torque_on(joint.servo_id)
    except ServoRefused as error:
        source = series_of(joint.model).hardware_error
        alarms = source[1](retry(partial(bus.read, joint.servo_id, source[0]))) if source else ()
        if not alarms:
            raise
        raise ServoRefused(joint.servo_id, f"refuses its torque ({', '.join(alarms)} alarm): {REBOOT}") from error


def _states(bus: Bus, servo_ids: Sequence[int]) -> dict[int, Reading]:
    """The servos' states without a hurry; whoever gave none is asked again."""
    found: dict[int, Reading] = {}
    missing = list(servo_ids)
    for _ in range(ATTEMPTS):
        found |= bus.read_states(missing)
        missing = [i for i, reading in found.items() if isinstance(reading, ServoFault)]
        if not missing:
            break
    return found


def _stateless(bus: Bus, readings: Mapping[int, Reading]) -> dict[int, str]:
    """The cause for each servo known to be there that gave no state, if one is found."""
    missing = [i for i, reading in readings.items() if isinstance(reading, ServoFault)]
    return diagnose_known(bus, missing) if missing else {}


def _ill_fed(joints: Sequence[Joint], bus: Bus, readings: Mapping[int, Reading]) -> dict[int, str]:
    """The servos whose voltage is outside their model's rated range in every reading, and what to do."""
    models, wrong = {joint.servo_id: joint.model for joint in joints}, dict[int, str]()
    for _ in range(ATTEMPTS):
        states = {i: reading for i, reading in readings.items() if isinstance(reading, ServoState)}
        faults = {i: voltage_fault(models[i], state.voltage_v) for i, state in states.items()}
        wrong = {i: f"servo {i}: {fault.text}" for i, fault in faults.items() if fault and fault.outside}
        if not wrong:
            break
        readings = bus.read_states(tuple(wrong))
    return wrong


def _with_cause(reading: Reading, cause: str | None) -> Reading:
    """A fault with its cause for a text, where there is one."""
    return reading._replace(text=cause) if cause and isinstance(reading, ServoFault) else reading


def check_reach(joint: Joint, limits: tuple[int, int] | None) -> None:
    """Check that the servo's own position limits (counts; None: it has none) hold the joint's. Raises ServoRefused.

    Beyond its own limits a servo does not go, and does not tell: some stop there, others forget the goal.
    """
    if limits is None:
        return
    last = joint.model.last_count
    lowest, highest = (min(max(counts, 0), last) for counts in joint.counts_range())
    if limits[0] <= lowest and highest <= limits[1]:
        return
    named = dict(joint.settings).keys() & {register.name for register in series_of(joint.model).position_limits}
    where = "robot file's settings" if named else "servo"
    raise ServoRefused(
        joint.servo_id,
        f"has position limits of its own, {limits[0]} to {limits[1]} counts, and its joint goes from {lowest} to "
        f"{highest}: widen them in the {where}, or {_advice(joint, max(limits[0], lowest), min(limits[1], highest))}",
    )


def _advice(joint: Joint, lowest: int, highest: int) -> str:
    """The limits that the joint may have, in joint units to six digits, rounded inwards."""
    if lowest >= highest:
        return "correct zero_counts: the two hardly overlap"
    lower, upper = sorted(joint.position(counts) for counts in (lowest, highest))
    return (
        f"narrow the joint's in the URDF to {math.ceil(lower * 1e6) / 1e6:.6f} to {math.floor(upper * 1e6) / 1e6:.6f}"
    )
