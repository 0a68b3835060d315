"""Calibrate joints that the user moves by hand: sweep, direction and anchor.

Torque stays disabled, and this module does not write to the servos or to disk.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import tau
from statistics import median
from typing import Final, Protocol

from commissioning.calibrate.hands import Hands
from commissioning.calibrate.plan import JointPlan
from commissioning.calibrate.result import (
    PLACE_RAD,
    FoundZero,
    JointCalibration,
    calibration_of,
    cannot_move_seam,
    fills_the_turn,
    is_mirrored,
    position_warning,
    pressed_counts,
    turns_freely,
)
from commissioning.calibrate.seam import Counting, counting_of
from commissioning.calibrate.stops import Stops
from commissioning.calibrate.sweep import Sweep, last_way
from commissioning.commissioning_errors import CalibrationError
from drivers.bus.bus import Bus
from drivers.servos.angles import Travel, shortest
from hal.joint import Joint

SHOWN_RAD: Final = 0.15
"""Minimum rotation of a servo that indicates a direction, in rad."""
TREMBLE_RAD: Final = 0.05
"""Maximum reversal of the motion that is ignored as hand tremor, in rad."""
TRIES: Final = 5
"""Maximum number of times that the user is asked to perform the same task."""
REPEATS: Final = 2
"""Maximum number of times that a joint is measured again because its travel contradicts its direction or its pose."""
SEEN_TWICE: Final = 2
"""Number of times that a different servo must turn before the IDs of the two servos are considered swapped."""


class CalibrationDialog(Protocol):
    """Interface to the person who moves the arm by hand, or to a simulated hand in a test."""

    def until_done(self, task: "CalibrationTask", update: Callable[[], None]) -> None:
        """Return when the task is done. Until then, call ``update`` at least ten times a second."""
        ...

    def say(self, text: str) -> None:
        """Show a message that does not need a reply."""
        ...


@dataclass(frozen=True, slots=True)
class CalibrationTask:
    """A task for the person who moves the arm."""

    kind: str
    """Type of task, for use by programs: ``sweep``, ``direction`` or ``pose``."""
    text: str
    """Instruction to show to the user."""
    joints: tuple[str, ...]
    """Names of the joints to move."""
    sweep: Sweep
    """Measurements of all joints so far."""


class ByHand:
    """Calibration by hand of the joints on one bus."""

    def __init__(
        self, bus: Bus, joints: Sequence[Joint], plans: Mapping[str, JointPlan], guide: CalibrationDialog
    ) -> None:
        self._bus = bus
        self._joints = tuple(joints)
        self._plans = plans
        self._guide = guide
        self._sweep = Sweep(bus, joints)
        self._counting: dict[str, Counting] = {}

    def run(self) -> dict[str, JointCalibration]:
        """Guide the user through all tasks, and return the calibration of each joint, keyed by joint name.

        Raises CalibrationError if the arm was not moved as requested.
        """
        require_poses(self._joints, self._plans)
        self._counting = {joint.name: counting_of(self._bus, joint) for joint in self._joints}
        self._tell_fixed_seams()
        self._sweep_all()
        return {joint.name: self._measured(joint) for joint in self._joints}

    def poses(self) -> dict[str, float]:
        """Ask the user to move freely turning joints to their marked poses.

        Return the counts in these poses, keyed by joint name.
        """
        return {joint.name: self._pose_twice(joint, self._plans[joint.name]) for joint in self._joints}

    # The sweep.

    def _sweep_all(self) -> None:
        """Ask the user to move every joint from stop to stop, and repeat the request for joints that missed a stop."""
        free = [joint.name for joint in self._joints if turns_freely(joint)]
        if free:
            self._guide.say(
                f"{', '.join(free)}: turns freely, so there are no stops to move it to. You will move it to a marked "
                "pose instead"
            )
        left = tuple(joint for joint in self._joints if not turns_freely(joint))
        text = "Move every joint slowly from stop to stop, in any order"
        stops = Stops(self._sweep, left)
        for _ in range(TRIES):
            if not left:
                break
            stops.begin()
            self._have_done("sweep", text, left, stops.update)
            left = tuple(joint for joint in left if stops.missing(joint))
            names = ", ".join(joint.name for joint in left)
            seen = "; ".join(stops.seen(joint) for joint in left)
            text = (
                f"Not yet moved from stop to stop: {names}. Move {'it' if len(left) == 1 else 'them'} to both stops "
                f"({seen})"
            )
        # A short travel is only reported with the result, because an arm's stops may differ from its URDF.
        self._require_seams_outside()

    def _tell_fixed_seams(self) -> None:
        """Warn at the start about servos that must be mounted so that their encoder seams are outside the travel."""
        for joint in self._joints:
            if self._counting[joint.name].homing_offset is None:
                self._guide.say(
                    f"{joint.name}: its {joint.model.name} has a fixed position where its reading wraps from the last "
                    "count to 0. If the joint crosses this position, mount the servo's horn at a different angle"
                )

    def _require_seams_outside(self) -> None:
        """Raise CalibrationError naming every joint that crosses a fixed seam or was turned by a full turn."""
        stuck = [j for j in self._joints if self._counting[j.name].homing_offset is None and self._crosses(j)]
        endless = [j for j in self._joints if self._plans[j.name].zero != "pose" and self._fills_the_turn(j)]
        problems = [f"{joint.name}: {cannot_move_seam(joint)}" for joint in stuck]
        problems += [
            f"{joint.name} was turned through more than one turn of its servo ({joint.servo_id}). It has no stops, so "
            "only a pose can show its zero. Set `zero: pose` for this joint in arm.yaml"
            for joint in endless
        ]
        if problems:
            raise CalibrationError("\n".join(problems))

    def _crosses(self, joint: Joint) -> bool:
        travel, turn = self._swept(joint), joint.model.counts_per_turn
        return travel.lower // turn != travel.upper // turn

    def _fills_the_turn(self, joint: Joint) -> bool:
        return fills_the_turn(joint, self._swept(joint))

    def _swept(self, joint: Joint) -> Travel:
        return self._sweep.of(joint).travel

    # One joint.

    def _measured(self, joint: Joint) -> JointCalibration:
        """Measure the direction and anchor of one joint. Repeat the measurement if the travel does not match the URDF
        limits."""
        sign = self._direction(joint)
        made = self._calibration(joint, sign, self._anchor(joint, sign))
        if self._plans[joint.name].zero != "pose":
            return made
        for _ in range(REPEATS):
            doubt = position_warning(joint, made)
            if not doubt:
                break
            self._guide.say(f"{joint.name}: {doubt}")
            if is_mirrored(joint, made):
                sign = self._direction(joint)
            made = self._calibration(joint, sign, self._anchor(joint, sign))
        return made

    def _calibration(self, joint: Joint, sign: int, anchor: float) -> JointCalibration:
        plan, counting = self._plans[joint.name], self._counting[joint.name]
        position = plan.anchor(joint.limits.lower, joint.limits.upper)
        found = FoundZero(self._swept(joint), sign, anchor, position, counting.homing_offset, counting.extended)
        return calibration_of(joint, found)

    def _anchor(self, joint: Joint, sign: int) -> float:
        """Return the continuous counts at the position that the joint's plan uses as its zero reference."""
        plan = self._plans[joint.name]
        if plan.zero != "pose":
            return anchor_counts(joint, plan, self._swept(joint), sign)
        return self._pose_twice(joint, plan) if turns_freely(joint) else self._pose(joint, plan)

    # The direction.

    def _direction(self, joint: Joint) -> int:
        """Ask the user to move the joint in its positive direction. Return the sign of the change in counts."""
        positive = self._plans[joint.name].positive
        text, others = f"{joint.name}: {positive}", list[str]()
        per_rad = joint.model.counts_per_turn / tau
        for _ in range(TRIES):
            hands = Hands(self._sweep)
            self._have_done("direction", text, (joint,), hands.update)
            way = last_way(hands.counts(joint), round(TREMBLE_RAD * per_rad))
            if abs(way) >= SHOWN_RAD * per_rad:
                return 1 if way > 0 else -1
            other = hands.moved_instead(joint, SHOWN_RAD)
            others += [other.name] if other else []
            if other and others.count(other.name) == SEEN_TWICE:
                raise CalibrationError(_exchanged(joint, other))
            seen = f", but servo {other.servo_id} ({other.name}) turned" if other else ""
            text = f"{joint.name} hardly moved{seen}. {positive}, by the width of a hand or more"
        raise CalibrationError(
            f"{joint.name} was not moved in its positive direction, so its sign is unknown. Nothing was written. "
            "Calibrate again"
        )

    # The pose.

    def _pose(self, joint: Joint, plan: JointPlan, before: str = "") -> float:
        """Ask the user to move the joint to its marked pose. Return the counts in this pose."""
        hands = Hands(self._sweep)
        text = f"{joint.name}: {before}{plan.pose}, and keep it there"
        self._have_done("pose", text, (joint,), hands.update)
        if other := hands.moved_instead(joint, SHOWN_RAD):
            self._guide.say(f"{joint.name} hardly moved, but servo {other.servo_id} ({other.name}) turned")
        return self._sweep.of(joint).counts

    def _pose_twice(self, joint: Joint, plan: JointPlan) -> float:
        """Return the counts at the marked pose of a joint that turns freely.

        The user shows the pose twice, because no stop can confirm the pose.
        """
        turn = joint.model.counts_per_turn
        first = self._pose(joint, plan)
        apart = [0, shortest(round(first), round(self._pose(joint, plan, "turn it out of this pose and back. ")), turn)]
        if abs(apart[1]) > PLACE_RAD * turn / tau:
            self._guide.say(f"{joint.name}: the two poses are {abs(apart[1]) * tau / turn:.3f} rad apart")
            apart.append(shortest(round(first), round(self._pose(joint, plan, "show the pose a third time. ")), turn))
        return first + median(apart)

    def _have_done(
        self, kind: str, text: str, joints: Sequence[Joint], after_update: Callable[[], object] = lambda: None
    ) -> None:
        def update() -> None:
            self._sweep.update()
            after_update()

        update()
        self._guide.until_done(CalibrationTask(kind, text, tuple(joint.name for joint in joints), self._sweep), update)
        update()


def require_poses(joints: Sequence[Joint], plans: Mapping[str, JointPlan]) -> None:
    """Raise CalibrationError naming every joint that turns freely and whose plan has no pose for the zero."""
    lost = [joint.name for joint in joints if turns_freely(joint) and plans[joint.name].zero != "pose"]
    if lost:
        raise CalibrationError(
            f"{', '.join(lost)}: the range in the URDF is a full turn, so the zero cannot be found from a stop. "
            "Set `zero: pose` for this joint in arm.yaml"
        )


def place_shows_direction(joint: Joint, plan: JointPlan, made: JointCalibration) -> bool:
    """Return whether reversing the joint's direction would make the travel contradict the URDF limits."""
    limits = joint.limits
    if plan.zero != "pose" or turns_freely(joint) or position_warning(joint, made):
        return False
    from_middle = plan.anchor(limits.lower, limits.upper) - 0.5 * (limits.lower + limits.upper)
    return abs(from_middle) > PLACE_RAD * joint.transmission


def anchor_counts(joint: Joint, plan: JointPlan, travel: Travel, sign: int) -> float:
    """Return the continuous counts at the plan's reference position, which is the middle or a stop of the travel."""
    if plan.zero == "middle":
        return 0.5 * (travel.lower + travel.upper)
    pressed = pressed_counts(joint, travel)
    at_lower = (plan.zero == "lower_stop") == (sign > 0)
    return travel.lower + pressed if at_lower else travel.upper - pressed


def as_joint(joint: Joint, made: JointCalibration) -> Joint:
    """Return the joint with the calibration applied."""
    return replace(
        joint,
        sign=made.sign,
        zero_counts=made.zero_counts,
        homing_offset=made.homing_offset,
        extended=made.extended,
    )


def _exchanged(joint: Joint, other: Joint) -> str:
    return (
        f"{joint.name}: servo {joint.servo_id} did not move, but servo {other.servo_id} ({other.name}) moved twice "
        "instead. Either the IDs of the two servos are swapped, or another joint was moved. Nothing was written. If "
        "the IDs are swapped, correct them with servoloop set-id (set one of them to a free ID first), then "
        "calibrate again"
    )
