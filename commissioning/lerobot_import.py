"""LeRobot's calibration becomes ours: direction by the robot file, the zero found anew in the travel.

LeRobot's zero is no pose that the URDF knows. What it knows is where the stops are: so the zero is where the joint's
plan says, in the middle of the travel or at a stop. LeRobot's is taken, and flagged, only where that cannot be.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from commissioning.calibrate.by_hand import as_joint
from commissioning.calibrate.plan import JointPlan, Zero
from commissioning.calibrate.result import (
    SWEPT_SHARE,
    CalibrationError,
    JointCalibration,
    doubts,
    unit,
)
from commissioning.calibrate.seam import SEAM_MARGIN_COUNTS, can_move_seam
from commissioning.lerobot import LEROBOT_ZERO_COUNTS, LerobotFile, LerobotJoint, entry_mistakes, entry_of, prefix_of
from drivers.servos.catalog import series_of
from hal.joint import Joint
from hal.robot_file.calibration_file import CalibratedJoint, CalibrationFile

Source = Zero | Literal["lerobot", "kept"]
"""Where a zero comes from: the plan's place, LeRobot's pose, or the calibration that was there and says the same."""


@dataclass(frozen=True, slots=True)
class Imported:
    """One joint of LeRobot's as ours."""

    joint: Joint
    made: JointCalibration
    source: Source
    doubt: str
    """What is doubtful; empty where nothing is."""

    @property
    def at_lerobot_zero(self) -> float:
        """The joint's position, as the URDF counts it, in the pose that LeRobot calls zero: rad or m."""
        return as_joint(self.joint, self.made).position(LEROBOT_ZERO_COUNTS)


def from_lerobot(
    file: LerobotFile,
    joints: Sequence[Joint],
    built: Mapping[str, int],
    plans: Mapping[str, JointPlan],
    former: CalibrationFile | None = None,
) -> list[Imported]:
    """The calibration of these joints, in the file's order. Raises CalibrationError with all that cannot be right.

    ``built``: the sign by joint with which such arms are built. ``former``: the calibration that is there; where
    LeRobot's file says the same of a joint, its zero stays.
    """
    require_offsets(joints)
    if prefix := prefix_of(file, [joint.name for joint in joints]):
        raise CalibrationError(
            f"LeRobot's file names this arm's joints with {prefix} before them: import it with --prefix {prefix}"
        )
    by_name = {joint.name: joint for joint in joints}
    problems = [f"LeRobot's file has {name}, which the robot file has not" for name in file if name not in by_name]
    problems += [f"LeRobot's file has no {joint.name}, which the robot file has" for joint in joints
                 if joint.name not in file]  # fmt: skip
    made: list[Imported] = []
    for name, theirs in file.items():
        if name in by_name:
            said = former.joints.get(name) if former else None
            one = _Import(by_name[name], built[name], theirs, plans.get(name), said)
            problems += [f"{name}: {mistake}" for mistake in one.mistakes()] or one.out_of_reach()
            made.append(one.result())
    if problems:
        raise CalibrationError("\n".join([*problems, "nothing was written"]))
    return made


def require_offsets(joints: Sequence[Joint]) -> None:
    """Check that the servos of these joints have homing offsets like those in LeRobot's file.

    Raises:
        CalibrationError: Some of them have not, so that no such file fits this arm.
    """
    other = [one for one in joints if series_of(one.model).make != "feetech" or not can_move_seam(one.model)]
    if other:
        models = " or ".join(f"{name}" for name in dict.fromkeys(one.model.name for one in other))
        raise CalibrationError(
            f"LeRobot's files cannot be imported for this arm: a servo of the model {models} has no homing offset like "
            f"the one in the file ({', '.join(one.name for one in other)}). Calibrate the arm with servoloop calibrate"
        )


@dataclass(frozen=True, slots=True)
class _Import:
    """One joint's way from LeRobot's file into ours."""

    joint: Joint
    built: int
    theirs: LerobotJoint
    plan: JointPlan | None
    former: CalibratedJoint | None

    def mistakes(self) -> list[str]:
        """What cannot be right."""
        joint, theirs = self.joint, self.theirs
        found = entry_mistakes(theirs, joint.model.last_count)
        if theirs.id != joint.servo_id:
            found.append(f"it has servo {theirs.id} in LeRobot's file and {joint.servo_id} in the robot file")
        return found or self._not_swept()

    def _not_swept(self) -> list[str]:
        """Whether the joint was moved too little for its stops to be known."""
        joint, made = self.joint, self.result()
        travel, range_ = made.made.travel(joint), joint.limits.upper - joint.limits.lower
        if made.source == "kept" or travel >= SWEPT_SHARE * range_:
            return []
        return [
            f"it was moved through {travel:.3f} of {range_:.3f} in the URDF (counts {self.theirs.range_min} to "
            f"{self.theirs.range_max}), so its stops are not known: calibrate anew, from stop to stop"
        ]

    def out_of_reach(self) -> list[str]:
        """Whether the joint's limits lie beyond the servo's counts with this zero: the robot file would be refused."""
        lowest, highest = as_joint(self.joint, self.result().made).counts_range()
        if lowest >= 0 and highest <= self.joint.model.last_count:
            return []
        return [
            f"{self.joint.name}: with the zero found, its limits in the URDF are the counts {lowest} to {highest}, "
            "over the seam: servoloop calibrate puts the seam outside"
        ]

    def result(self) -> Imported:
        sign = self.built * (-1 if self.theirs.drive_mode else 1)
        zero, source = self._zero(sign)
        theirs = self.theirs
        made = JointCalibration(sign, zero, theirs.homing_offset, theirs.range_min, theirs.range_max)
        return Imported(self.joint, made, source, self._doubt(made, source))

    def _zero(self, sign: int) -> tuple[int, Source]:
        if self.former is not None and entry_of(self.former, self.built) == self.theirs:
            return self.former.zero_counts, "kept"
        plan, limits = self.plan or JointPlan(positive=""), self.joint.limits
        if plan.zero == "pose" or self._is_whole_turn():
            return LEROBOT_ZERO_COUNTS, "lerobot"
        position = plan.anchor(limits.lower, limits.upper)
        return round(self._counts_at(plan.zero, sign) - sign * position / unit(self.joint)), plan.zero

    def _counts_at(self, zero: Zero, sign: int) -> float:
        low, high = self.theirs.range_min, self.theirs.range_max
        if zero == "middle":
            return 0.5 * (low + high)
        return low if (zero == "lower_stop") == (sign > 0) else high

    def _is_whole_turn(self) -> bool:
        """LeRobot does not sweep a wrist: it writes the whole turn, which has no stops and no middle."""
        span = self.theirs.range_max - self.theirs.range_min
        return span >= self.joint.model.counts_per_turn - 2 * SEAM_MARGIN_COUNTS

    def _doubt(self, made: JointCalibration, source: Source) -> str:
        if source == "lerobot":
            why = (
                "its travel was not swept" if self._is_whole_turn() else "its zero is a pose that the file does not say"
            )
            return f"{why}, so LeRobot's zero stands for the URDF's and may be off: servoloop calibrate finds it"
        if self._is_whole_turn():
            return ""  # its zero was known, and of its travel LeRobot says nothing
        return doubts(self.joint, made)
