"""Convert LeRobot's calibration to servoloop's.

The direction of each joint comes from the robot file. LeRobot's zero is not the zero of the URDF, but LeRobot's file
contains the stops. The zero is therefore computed from the travel, at the reference position in the joint's plan: the
middle or a stop. LeRobot's zero is used, with a warning, only if the zero cannot be computed in this way.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from commissioning.calibrate.by_hand import as_joint
from commissioning.calibrate.plan import JointPlan, Zero
from commissioning.calibrate.result import SWEPT_SHARE, JointCalibration, travel_warnings, unit
from commissioning.calibrate.seam import SEAM_MARGIN_COUNTS, can_move_seam
from commissioning.commissioning_errors import CalibrationError
from commissioning.lerobot import LEROBOT_ZERO_COUNTS, LerobotFile, LerobotJoint, entry_mistakes, entry_of, prefix_of
from drivers.servos.catalog import series_of
from hal.joint import Joint
from hal.robot_file.calibration_file import CalibratedJoint, CalibrationFile

Source = Zero | Literal["lerobot", "kept"]
"""Source of a zero: the joint's plan, LeRobot's pose, or a previous calibration that equals LeRobot's."""


@dataclass(frozen=True, slots=True)
class Imported:
    """Calibration of one joint, imported from LeRobot's file."""

    joint: Joint
    made: JointCalibration
    source: Source
    doubt: str
    """Warnings about implausible values; empty if all values are plausible."""

    @property
    def at_lerobot_zero(self) -> float:
        """URDF joint position in LeRobot's zero pose, in rad or m."""
        return as_joint(self.joint, self.made).position(LEROBOT_ZERO_COUNTS)


def from_lerobot(
    file: LerobotFile,
    joints: Sequence[Joint],
    built: Mapping[str, int],
    plans: Mapping[str, JointPlan],
    former: CalibrationFile | None = None,
) -> list[Imported]:
    """Return the calibration of these joints, in file order.

    Args:
        file: LeRobot's file.
        joints: Joints of the arm.
        built: Sign of each joint in all arms of the same design, keyed by joint name.
        plans: Calibration plan of each joint, keyed by joint name.
        former: Previous calibration. A joint keeps its zero if its entry in LeRobot's file equals the previous
            calibration.

    Raises:
        CalibrationError: The file has errors. The message lists all of them.
    """
    require_offsets(joints)
    if prefix := prefix_of(file, [joint.name for joint in joints]):
        raise CalibrationError(
            f"in LeRobot's file, the names of this arm's joints begin with {prefix}: import it with --prefix {prefix}"
        )
    by_name = {joint.name: joint for joint in joints}
    problems = [f"LeRobot's file has joint {name}, but the robot file does not" for name in file if name not in by_name]
    problems += [f"the robot file has joint {joint.name}, but LeRobot's file does not" for joint in joints
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
    """Check that the servos of these joints have the same type of homing offset as those in LeRobot's file.

    Raises:
        CalibrationError: Some servos have no such offset, so LeRobot's files cannot be imported for this arm.
    """
    other = [one for one in joints if series_of(one.model).make != "feetech" or not can_move_seam(one.model)]
    if other:
        models = " or ".join(f"{name}" for name in dict.fromkeys(one.model.name for one in other))
        raise CalibrationError(
            f"LeRobot's files cannot be imported for this arm: {models} servos do not have the homing offset that "
            f"the file contains ({', '.join(one.name for one in other)}). Calibrate the arm with servoloop calibrate"
        )


@dataclass(frozen=True, slots=True)
class _Import:
    """Import of one joint's calibration."""

    joint: Joint
    built: int
    theirs: LerobotJoint
    plan: JointPlan | None
    former: CalibratedJoint | None

    def mistakes(self) -> list[str]:
        """Return the errors in this joint's entry."""
        joint, theirs = self.joint, self.theirs
        found = entry_mistakes(theirs, joint.model.last_count)
        if theirs.id != joint.servo_id:
            found.append(f"its servo has ID {theirs.id} in LeRobot's file, but {joint.servo_id} in the robot file")
        return found or self._not_swept()

    def _not_swept(self) -> list[str]:
        """Return an error if the joint was moved too little to show where its stops are."""
        joint, made = self.joint, self.result()
        travel, range_ = made.made.travel(joint), joint.limits.upper - joint.limits.lower
        if made.source == "kept" or travel >= SWEPT_SHARE * range_:
            return []
        return [
            f"it was moved through only {travel:.3f} of {range_:.3f} in the URDF (counts {self.theirs.range_min} to "
            f"{self.theirs.range_max}), so its stops are unknown: calibrate again, from stop to stop"
        ]

    def out_of_reach(self) -> list[str]:
        """Return an error if the joint's limits are outside the range of the servo's counts. With such limits, the
        robot file would be invalid."""
        lowest, highest = as_joint(self.joint, self.result().made).counts_range()
        if lowest >= 0 and highest <= self.joint.model.last_count:
            return []
        return [
            f"{self.joint.name}: with this zero, its limits in the URDF are at counts {lowest} to {highest}, so its "
            "range crosses the seam. Calibrate with servoloop calibrate, which moves the seam out of the range"
        ]

    def result(self) -> Imported:
        sign = self.built * (-1 if self.theirs.drive_mode else 1)
        zero, source = self._zero(sign)
        theirs = self.theirs
        made = JointCalibration(sign, zero, theirs.homing_offset, theirs.range_min, theirs.range_max)
        return Imported(self.joint, made, source, self._warning(made, source))

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
        """Return whether the travel is a full turn. LeRobot writes a full turn for a wrist without sweeping it."""
        span = self.theirs.range_max - self.theirs.range_min
        return span >= self.joint.model.counts_per_turn - 2 * SEAM_MARGIN_COUNTS

    def _warning(self, made: JointCalibration, source: Source) -> str:
        if source == "lerobot":
            why = (
                "its travel was not swept"
                if self._is_whole_turn()
                else "its zero is a pose, which the file does not contain"
            )
            return (
                f"{why}, so LeRobot's zero is used instead and may be wrong. Find the zero of the URDF with servoloop "
                "calibrate"
            )
        if self._is_whole_turn():
            return ""  # The zero is known, although the file does not contain the travel.
        return travel_warnings(self.joint, made)
