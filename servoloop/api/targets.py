"""Convert a program's targets, paths and pose names to goals."""

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, Union

from hal.types import JointLimits
from servoloop.api.arm_errors import ArmInputError
from servoloop.api.backend import ArmDescription, MotionGoal
from servoloop.api.checks import checked_number, number_of
from servoloop.api.trajectory import ArmTrajectory

if TYPE_CHECKING:
    from hal.types import FloatArray


Positions = Union[Mapping[str, float], Sequence[float], "FloatArray"]
"""Positions keyed by joint name, or one position for each of ``Arm.joints``, in rad or m."""


def by_joint(positions: Positions, arm: ArmDescription) -> dict[str, float]:
    """Return positions keyed by joint name. Raises ArmInputError if the number or type of the positions is wrong."""
    if isinstance(positions, Mapping):
        return {joint: _number(joint, value) for joint, value in positions.items()}
    if isinstance(positions, str | Set) or not hasattr(positions, "__len__"):  # A set is not ordered.
        raise ArmInputError(f"{positions!r} is not a target: use positions keyed by joint name, or an array")
    if getattr(positions, "ndim", 1) != 1 or len(positions) != len(arm.joints):
        shape = getattr(positions, "shape", len(positions))
        raise ArmInputError(
            f"an array of positions needs {len(arm.joints)} values, one for each of {', '.join(arm.joints)}, but it "
            f"has {shape}"
        )
    return {joint: _number(joint, value) for joint, value in zip(arm.joints, positions, strict=True)}


def pose_named(name: str, arm: ArmDescription) -> dict[str, float]:
    """Return the positions of a saved pose, keyed by joint name. Raises ArmInputError if the pose does not exist."""
    from servoloop.manual.poses import PoseError, Poses

    if arm.folder is None:
        raise ArmInputError(f"pose {name}: {arm.name} has no saved poses, because its files are not in an arm folder")
    try:
        return dict(Poses(arm.folder).get(name))
    except PoseError as error:
        raise ArmInputError(f"{error}; save a pose with `servoloop pose save`") from None


def duration_of(duration: float | None, speed: float | None) -> tuple[float | None, float]:
    """Return the checked duration in seconds, and the fraction of the velocity limits to use if there is no duration.

    Raises ArmInputError.
    """
    if duration is not None and speed is not None:
        raise ArmInputError("duration and speed cannot be combined: pass only one of them")
    if duration is not None:
        duration = checked_number("duration", duration)
        if not (math.isfinite(duration) and duration > 0.0):
            raise ArmInputError(f"duration must be a finite time above 0 s, not {duration}")
    share = SPEED if speed is None else checked_number("speed", speed)
    if not 0.0 < share <= 1.0:
        raise ArmInputError(f"speed must be above 0 and at most 1, as a fraction of the velocity limits, not {speed}")
    return duration, share


def goal_of(trajectory: ArmTrajectory, begin_s: float) -> MotionGoal:
    """Return the goal for a trajectory, with all times delayed by ``begin_s``. Raises ArmInputError if the trajectory
    or a part of it has the wrong type, or if only some joints have velocities."""
    if not isinstance(trajectory, ArmTrajectory):
        raise ArmInputError(f"the trajectory must be an ArmTrajectory, not {trajectory!r}")
    times = _elements("the times of the trajectory", trajectory.times_s)
    times_s = tuple(checked_number("a time of the trajectory", time_s) + begin_s for time_s in times)
    if not isinstance(trajectory.positions, Mapping):
        raise ArmInputError(f"the positions must be keyed by joint name, not {trajectory.positions!r}")
    joints = tuple(trajectory.positions)
    return MotionGoal(joints, times_s, _rows(trajectory.positions, joints), _rows(trajectory.velocities, joints))


def _rows(columns: Mapping[str, Sequence[float]], joints: tuple[str, ...]) -> tuple[tuple[float, ...], ...]:
    if not columns:
        return ()
    if missing := [joint for joint in joints if joint not in columns]:
        raise ArmInputError(
            f"{missing[0]} has positions but no velocities: give velocities for all joints or for none", missing[0]
        )
    if others := [joint for joint in columns if joint not in joints]:
        raise ArmInputError(
            f"{others[0]} has velocities but no positions: give its positions, or omit its velocities", str(others[0])
        )
    values = {joint: _elements(f"the values of {joint}", columns[joint]) for joint in joints}
    lengths = {len(column) for column in values.values()}
    if len(lengths) > 1:
        raise ArmInputError(f"the joints have different numbers of points ({sorted(lengths)}): use one point per time")
    return tuple(zip(*([_number(joint, at) for at in column] for joint, column in values.items()), strict=True))


def _elements(name: str, values: Any) -> list[Any]:
    """Return the elements of a sequence. Raises ArmInputError if ``values`` is not a sequence."""
    try:
        return list(values)
    except TypeError:
        raise ArmInputError(f"{name} must be a sequence, not {values!r}") from None


def _number(joint: str, value: Any) -> float:
    found = number_of(value)
    if found is None:
        raise ArmInputError(f"{joint}: {value!r} is not a number: use a position in rad or m", str(joint))
    return found


SPEED = 0.25
"""Fraction of the velocity limits used by a motion if neither a duration nor a speed is given."""
SHORTEST_S: Final = 1e-3
"""Duration of a motion whose joints are already at their targets, in seconds."""


def approach_s(
    target: Mapping[str, float], start: Mapping[str, float], limits: Mapping[str, JointLimits], speed: float
) -> float:
    """Return the duration of a jerk-limited motion between two poses at rest, in seconds.

    Args:
        target: Target positions in rad or m, keyed by joint name.
        start: Start positions in rad or m, keyed by joint name. Joints whose start position is unknown are ignored.
        limits: Joint limits, keyed by joint name.
        speed: Fraction of the velocity limits, above 0 and at most 1.

    Raises:
        ArmInputError: No motion within the limits connects the poses.
    """
    import numpy as np

    from controller.motion import Kinematics, MotionError, motion_to

    joints = [joint for joint in target if math.isfinite(start[joint])]
    if not joints:
        return SHORTEST_S
    slower = [replace(limits[joint], velocity=speed * limits[joint].velocity) for joint in joints]
    here = Kinematics.at_rest(np.array([start[joint] for joint in joints]))
    there = Kinematics.at_rest(np.array([target[joint] for joint in joints]))
    try:
        return max(motion_to(here, there, slower, 0.0, joints).duration_s, SHORTEST_S)
    except MotionError as error:
        raise ArmInputError(f"the arm cannot move to the target: {error}") from None
