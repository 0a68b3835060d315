"""Calibrate an arm on one bus: disable torque, measure, show the changes, store them, and test each joint."""

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from commissioning.calibrate.by_hand import ByHand, CalibrationDialog, as_joint, place_shows_direction
from commissioning.calibrate.plan import JointPlan
from commissioning.calibrate.result import JointCalibration, travel_warnings, uncertainty
from commissioning.calibrate.seam import joint_counting
from commissioning.calibrate.store import set_aside, store
from commissioning.commissioning_errors import CalibrationError
from commissioning.provision import drives
from commissioning.slow_arm import SlowArm
from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.eeprom import Change
from hal.joint import Joint
from hal.robot_file.calibration_file import calibration_path
from hal.servos.limp_arm import release_question, servo_name, torque_warning

WAY_RAD: Final = 0.2
"""Angle by which each servo turns back and forth in the motion test, in rad."""
OFF_SHARE: Final = 0.3
"""Maximum error of a test motion, as a fraction of the motion's length. This tolerance covers friction and the dead
band. Sag is the same at both ends of the motion and cancels out.
"""


def check(arm: SlowArm, say: Callable[[str], None]) -> None:
    """Move every joint back and forth. Raises CalibrationError naming the joint that does not follow its goals."""
    for index, joint in enumerate(arm.joints):
        say(f"{joint.name} moves")
        _there_and_back(arm, index)


def first_way(arm: SlowArm, index: int) -> float:
    """Return the first test motion of a joint, toward the middle of its limits, in rad or m."""
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
            f"{joint.name} (servo {joint.servo_id}) should have moved by {way:+.3f}, but it moved by {moved:+.3f}. "
            "Check whether something is in its way or the joint is at a stop. If not, its calibration may be wrong"
        )


STORE = "Store this calibration?"
TRY = (
    "Test the calibration? The torque will be enabled: support the arm until it holds its position. Each joint then "
    "moves a little, slowly. Press any key to stop the motion."
)
DIRECTIONS = (
    "The direction of {joints} is known only from the motion of your hand. Did you move each joint in the requested "
    "direction?"
)
REPEAT = "Measure {joints} again?"
MOVED = "Did each joint first move in the direction that was printed for it?"
HANDS_OFF = "The arm holds its position now: take your hands off"
SUPPORT = "The torque will be disabled in a moment: support the arm"
UNTRIED = "the calibration is stored, but its motion test was not completed"
HANDS_S = 2.0
"""Time for the user to support or release the arm, in seconds."""
Measure = Callable[[Bus, Sequence[Joint], Mapping[str, JointPlan]], dict[str, JointCalibration]]


class Asker(CalibrationDialog, Protocol):
    """Interface to the person who moves the arm and answers questions."""

    def confirm(self, question: str) -> bool:
        """Ask a yes-or-no question."""
        ...

    def show(self, differences: Sequence["CalibrationDifference"]) -> None:
        """Show the measurements before they are stored."""
        ...


@dataclass(frozen=True, slots=True)
class CalibrationDifference:
    """Values of one joint before and after the calibration."""

    joint: str
    servo_id: int
    before: Joint
    made: JointCalibration
    doubt: str
    """Warnings about implausible results; empty if all results are plausible."""
    uncertainty: float = 0.0
    """Expected error of the stored zero, in rad or m."""

    @property
    def zero_moved(self) -> float:
        """Distance by which the zero has moved, in rad or m. The value is meaningful only if the sign is unchanged."""
        model = self.before.model
        offset = (self.made.counting.seam(model) or 0) - (joint_counting(self.before).seam(model) or 0)
        half = self.before.model.counts_per_turn // 2
        counts = (self.made.zero_counts + offset - self.before.zero_counts + half) % (2 * half) - half
        return counts * abs(self.before.units_per_count)


@dataclass(frozen=True, slots=True)
class CalibrationOutcome:
    """Result of a calibration, stored or not."""

    differences: tuple[CalibrationDifference, ...]
    path: Path
    stored: bool = False
    changes: Mapping[str, tuple[Change, ...]] | None = None
    """Changes written to the servos, keyed by joint name."""
    tried: bool = False
    """Whether each joint reached its goals in the motion test with torque enabled."""


def by_hand(asker: Asker) -> Measure:
    """Return a function that measures by hand, for use with ``calibrate``."""
    return lambda bus, joints, plans: ByHand(bus, joints, plans, asker).run() if joints else {}


@dataclass(frozen=True, slots=True)
class JointsToCalibrate:
    """Joints of a robot file that are on one bus, with a calibration plan for each joint."""

    robot: Path
    """Robot file. The calibration is stored in the same folder."""
    joints: Sequence[Joint]
    plans: Mapping[str, JointPlan]
    """Calibration plan of each joint, keyed by joint name."""
    others: Collection[str] = ()
    """Joints of the robot file on other buses, which keep their calibration."""

    def require_plans(self) -> None:
        """Raise CalibrationError if a joint has no plan."""
        missing = [joint.name for joint in self.joints if joint.name not in self.plans]
        if missing:
            names = ", ".join(missing)
            raise CalibrationError(f"the arm's file has no calibration plan for {names}: add the plan to arm.yaml")


def calibrate(
    arm: JointsToCalibrate,
    open_bus: Callable[[], Bus],
    asker: Asker,
    clock: Clock,
    measure: Measure | None = None,
    stopped: Callable[[], int] = lambda: 0,
) -> CalibrationOutcome:
    """Calibrate joints, by hand or with a different measurement.

    Nothing is written until the user agrees. Torque is always off at the end, even after an error. Raises
    CalibrationError, ServoError, PortLost, StoppedError.

    Args:
        arm: Joints to calibrate.
        open_bus: Function that opens the bus of the joints.
        asker: Interface to the person who moves the arm and answers questions.
        clock: Clock for all delays and timeouts.
        measure: Measurement to use. If None, the joints are measured by hand.
        stopped: Function that is called during the motion test and returns the number of requests to stop (see
            ``SlowArm``).
    """
    arm.require_plans()
    robot, joints, plans = arm.robot, arm.joints, arm.plans
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
                f"{one.joint}: the reading of its servo ({one.servo_id}) wraps from the last count to 0 within the "
                "joint's range, so the servo will be set to extended position mode (4) with a homing offset"
            )
    asker.show(differences)
    if not asker.confirm(STORE):
        return CalibrationOutcome(differences, calibration_path(robot))
    with closing(open_bus()) as bus:
        changes = store(robot, bus, joints, made, clock, arm.others)
    calibrated = [as_joint(joint, made[joint.name]) for joint in joints]
    tried = asker.confirm(TRY)
    if tried:
        try:
            _try(open_bus, calibrated, plans, asker, clock, stopped)
        except BaseException as error:
            error.add_note(UNTRIED)
            raise
        if not asker.confirm(MOVED):
            raise CalibrationError(f"a joint moved in the wrong direction: {set_aside(robot)}")
    return CalibrationOutcome(differences, calibration_path(robot), True, changes, tried)


def _difference(joint: Joint, made: JointCalibration, plan: JointPlan) -> CalibrationDifference:
    doubt, off = travel_warnings(joint, made), uncertainty(joint, made, plan.zero)
    return CalibrationDifference(joint.name, joint.servo_id, joint, made, doubt, off)


def to_repeat(joints: Sequence[Joint], made: Mapping[str, JointCalibration], asker: Asker) -> list[Joint]:
    """Return the joints with implausible calibrations if the user wants to measure these joints again."""
    doubtful = [joint for joint in joints if travel_warnings(joint, made[joint.name])]
    for joint in doubtful:
        asker.say(f"{joint.name}: {travel_warnings(joint, made[joint.name])}")
    if doubtful and asker.confirm(REPEAT.format(joints=", ".join(joint.name for joint in doubtful))):
        return doubtful
    return []


def to_turn_round(
    joints: Sequence[Joint], plans: Mapping[str, JointPlan], made: Mapping[str, JointCalibration], asker: Asker
) -> list[Joint]:
    """If the user reports a wrong direction, return the joints whose direction was confirmed only by the user."""
    shown = [joint for joint in joints if not place_shows_direction(joint, plans[joint.name], made[joint.name])]
    for joint in shown:
        calibrated_before = joint.homing_offset is not None
        if calibrated_before and made[joint.name].sign != joint.sign:
            asker.say(f"{joint.name}: its direction is opposite to that of the previous calibration")
    if shown and not asker.confirm(DIRECTIONS.format(joints=", ".join(joint.name for joint in shown))):
        return shown
    return []


def _try(
    open_bus: Callable[[], Bus],
    joints: Sequence[Joint],
    plans: Mapping[str, JointPlan],
    asker: Asker,
    clock: Clock,
    stopped: Callable[[], int],
) -> None:
    """Move each joint slightly with torque enabled.

    Tell the user when to release the arm and when to support it.
    """
    with SlowArm(open_bus, joints, clock, stopped) as arm:
        asker.say(HANDS_OFF)
        arm.rest(HANDS_S)
        for index, joint in enumerate(arm.joints):
            way = "in this direction" if first_way(arm, index) > 0.0 else "opposite to this direction"
            asker.say(f"{joint.name} ({plans[joint.name].positive}): it first moves {way}, then back")
        check(arm, asker.say)
        asker.say(SUPPORT)
        arm.rest(HANDS_S)


def _make_limp(bus: Bus, joints: Sequence[Joint], asker: Asker) -> None:
    """Check that all servos respond and have the right model, and disable their torque if the user agrees.

    Raises ServoError, CalibrationError.
    """
    for joint in joints:
        bus.identify(joint.servo_id, joint.model)
    on = [servo_name(joint) for joint in joints if drives(bus, joint.servo_id, joint.model)]
    if not on:
        return
    if not asker.confirm(release_question(on)):
        raise CalibrationError(f"{torque_warning(on)}: nothing was changed")
    if failed := bus.torque_off([joint.servo_id for joint in joints]):
        raise CalibrationError("torque may still be on: " + "; ".join(map(str, failed)))
