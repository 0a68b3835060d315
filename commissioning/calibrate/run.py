"""The whole calibration of an arm on one line: limp, measured, shown as a difference, stored, and tried."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from calibration.eeprom import Change
from commissioning.calibrate.by_hand import ByHand, Guide, as_joint, place_shows_direction
from commissioning.calibrate.plan import JointPlan
from commissioning.calibrate.result import CalibrationError, JointCalibration, doubts, uncertainty
from commissioning.calibrate.seam import joint_counting
from commissioning.calibrate.store import set_aside, store
from commissioning.provision import drives
from commissioning.slow_arm import SlowArm
from drivers.bus.bus import Bus
from drivers.clock import Clock
from hal.joint import Joint
from hal.robot_file.calibration_file import calibration_path
from hal.servos.limp_arm import release_question, servo_name, torque_warning

WAY_RAD: Final = 0.2
"""How far each servo turns, there and back."""
OFF_SHARE: Final = 0.3
"""Sag is the same at both ends of the way; so much of it may be missing by friction and dead band."""


def check(arm: SlowArm, say: Callable[[str], None]) -> None:
    """Move every joint there and back. Raises CalibrationError with the joint that does not follow."""
    for index, joint in enumerate(arm.joints):
        say(f"{joint.name} moves")
        _there_and_back(arm, index)


def first_way(arm: SlowArm, index: int) -> float:
    """The way that the check moves a joint first, towards the middle of its limits, rad or m."""
    joint = arm.joints[index]
    middle = 0.5 * (joint.limits.lower + joint.limits.upper)
    return WAY_RAD * joint.transmission * (1.0 if float(arm.command[index]) < middle else -1.0)


def _there_and_back(arm: SlowArm, index: int) -> None:
    joint, start, before = arm.joints[index], float(arm.command[index]), arm.measured(index)
    way = first_way(arm, index)
    arm.go(index, start + way)
    moved = arm.measured(index) - before
    arm.go(index, start)
    if abs(moved - way) > OFF_SHARE * abs(way):
        raise CalibrationError(
            f"{joint.name} (servo {joint.servo_id}) was to move by {way:+.3f} and moved by {moved:+.3f}: "
            "is something in its way, is it at a stop, or is its calibration wrong?"
        )


STORE = "Store this calibration?"
TRY = "Torque goes on: hold the arm until it holds itself. Then each joint moves a little, slowly. Any key stops. Try?"
DIRECTIONS = "Only your hands have shown the direction of {joints}. Did each move as it was asked to?"
REPEAT = "Measure {joints} once more?"
MOVED = "Did each joint first move the way that was printed for it?"
LET_GO = "The arm holds itself: let it go"
HOLD = "The arm goes limp: hold it"
UNTRIED = "the calibration is stored, and was not tried to the end"
HANDS_S = 2.0
"""So long hands may need to do what they were told."""
Measure = Callable[[Bus, Sequence[Joint], Mapping[str, JointPlan]], dict[str, JointCalibration]]


class Asker(Guide, Protocol):
    """Whoever moves the arm and decides."""

    def confirm(self, question: str) -> bool:
        """Ask a question that yes or no answers."""
        ...

    def show(self, differences: Sequence["Difference"]) -> None:
        """Show what has been measured, before it is stored."""
        ...


@dataclass(frozen=True, slots=True)
class Difference:
    """One joint before and behind the calibration."""

    joint: str
    servo_id: int
    before: Joint
    made: JointCalibration
    doubt: str
    """What is doubtful; empty where nothing is."""
    uncertainty: float = 0.0
    """Expected error of the stored zero, rad or m."""

    @property
    def zero_moved(self) -> float:
        """How far the zero has moved, rad or m; only with the sign unchanged it says anything."""
        model = self.before.model
        offset = (self.made.counting.seam(model) or 0) - (joint_counting(self.before).seam(model) or 0)
        half = self.before.model.counts_per_turn // 2
        counts = (self.made.zero_counts + offset - self.before.zero_counts + half) % (2 * half) - half
        return counts * abs(self.before.units_per_count)


@dataclass(frozen=True, slots=True)
class Outcome:
    """A calibration that was stored; or not, where the user did not want it."""

    differences: tuple[Difference, ...]
    path: Path
    stored: bool = False
    changes: Mapping[str, tuple[Change, ...]] | None = None
    """What was written to the servos, by joint."""
    tried: bool = False
    """Whether each joint was moved under torque and came to where it was sent."""


def by_hand(asker: Asker) -> Measure:
    """Measuring with the arm in the user's hands."""
    return lambda bus, joints, plans: ByHand(bus, joints, plans, asker).run() if joints else {}


def calibrate(
    robot: Path,
    joints: Sequence[Joint],
    plans: Mapping[str, JointPlan],
    open_bus: Callable[[], Bus],
    asker: Asker,
    clock: Clock,
    measure: Measure | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> Outcome:
    """Calibrate the joints of a robot file, all on one bus; by hand unless ``measure`` says otherwise.

    Until the user has said yes nothing is written. Torque is off behind it, whatever happens; ``stopped`` ends the
    motion that is tried. Raises CalibrationError, ServoError, PortLost, StoppedError.
    """
    missing = [joint.name for joint in joints if joint.name not in plans]
    if missing:
        raise CalibrationError(f"the arm's file does not say how to calibrate {', '.join(missing)}")
    with closing(open_bus()) as bus:
        _make_limp(bus, joints, asker)
        made = (measure or by_hand(asker))(bus, joints, plans)
        if measure is None:
            made |= by_hand(asker)(bus, to_repeat(joints, made, asker), plans)
            made |= by_hand(asker)(bus, to_turn_round(joints, plans, made, asker), plans)
    differences = tuple(_difference(joint, made[joint.name], plans[joint.name]) for joint in joints)
    for one in differences:
        if one.made.extended and not one.before.extended:
            asker.say(
                f"{one.joint}: its servo ({one.servo_id}) passes from its last count to its first within the joint's "
                "range, so it will be set to extended position mode (4), with a homing offset"
            )
    asker.show(differences)
    if not asker.confirm(STORE):
        return Outcome(differences, calibration_path(robot))
    with closing(open_bus()) as bus:
        changes = store(robot, bus, joints, made, clock)
    calibrated = [as_joint(joint, made[joint.name]) for joint in joints]
    tried = asker.confirm(TRY)
    if tried:
        try:
            _try(open_bus, calibrated, plans, asker, clock, stopped)
        except BaseException as error:
            error.add_note(UNTRIED)
            raise
        if not asker.confirm(MOVED):
            raise CalibrationError(f"a direction was shown the wrong way round: {set_aside(robot)}")
    return Outcome(differences, calibration_path(robot), True, changes, tried)


def _difference(joint: Joint, made: JointCalibration, plan: JointPlan) -> Difference:
    doubt, off = doubts(joint, made), uncertainty(joint, made, plan.zero)
    return Difference(joint.name, joint.servo_id, joint, made, doubt, off)


def to_repeat(joints: Sequence[Joint], made: Mapping[str, JointCalibration], asker: Asker) -> list[Joint]:
    """The joints with doubtful calibrations, if the user wants to measure them once more."""
    doubtful = [joint for joint in joints if doubts(joint, made[joint.name])]
    for joint in doubtful:
        asker.say(f"{joint.name}: {doubts(joint, made[joint.name])}")
    if doubtful and asker.confirm(REPEAT.format(joints=", ".join(joint.name for joint in doubtful))):
        return doubtful
    return []


def to_turn_round(
    joints: Sequence[Joint], plans: Mapping[str, JointPlan], made: Mapping[str, JointCalibration], asker: Asker
) -> list[Joint]:
    """The joints whose direction only the user's hands have shown, if the user says that one of them is wrong."""
    shown = [joint for joint in joints if not place_shows_direction(joint, plans[joint.name], made[joint.name])]
    for joint in shown:
        calibrated_before = joint.homing_offset is not None
        if calibrated_before and made[joint.name].sign != joint.sign:
            asker.say(f"{joint.name}: its direction is the opposite of the one in the former calibration")
    if shown and not asker.confirm(DIRECTIONS.format(joints=", ".join(joint.name for joint in shown))):
        return shown
    return []


def _try(
    open_bus: Callable[[], Bus],
    joints: Sequence[Joint],
    plans: Mapping[str, JointPlan],
    asker: Asker,
    clock: Clock,
    stopped: Callable[[], bool],
) -> None:
    """Move each joint a little under torque; whoever holds the arm is told when to let go and when to take it again."""
    with SlowArm(open_bus, joints, clock, stopped) as arm:
        asker.say(LET_GO)
        arm.rest(HANDS_S)
        for index, joint in enumerate(arm.joints):
            way = "this way" if first_way(arm, index) > 0.0 else "the other way than this"
            asker.say(f"{joint.name}, first {way}, then back: {plans[joint.name].positive}")
        check(arm, asker.say)
        asker.say(HOLD)
        arm.rest(HANDS_S)


def _make_limp(bus: Bus, joints: Sequence[Joint], asker: Asker) -> None:
    """See that all are there, of the right model, and limp. Raises ServoError, CalibrationError."""
    for joint in joints:
        bus.identify(joint.servo_id, joint.model)
    on = [servo_name(joint) for joint in joints if drives(bus, joint.servo_id, joint.model)]
    if not on:
        return
    if not asker.confirm(release_question(on)):
        raise CalibrationError(f"{torque_warning(on)}: nothing was changed")
    if failed := bus.torque_off([joint.servo_id for joint in joints]):
        raise CalibrationError("torque may still be on: " + "; ".join(map(str, failed)))
