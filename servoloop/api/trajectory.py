"""Path of an arm through several timed points."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self

from hal.types import JointLimits
from servoloop.api.arm_errors import ArmInputError
from servoloop.api.backend import ArmState

if TYPE_CHECKING:
    from planning.paths.margins import PathMargins


@dataclass(frozen=True, slots=True)
class ArmTrajectory:
    """Trajectory with k points for some or all joints. The arm is at rest at the last point."""

    times_s: Sequence[float]
    """Times (k,) of the points, in seconds, nonnegative and strictly increasing."""
    positions: Mapping[str, Sequence[float]]
    """Positions (k,) of each joint, in rad or m."""
    velocities: Mapping[str, Sequence[float]] = field(default_factory=dict)
    """Velocities (k,) of each joint, in rad/s or m/s. If empty, the controller chooses the velocities."""

    @classmethod
    def recorded(cls, states: Sequence[ArmState], limits: Mapping[str, JointLimits]) -> Self:
        """Return a smooth trajectory through recorded states, without the pauses before and after the motion.

        The trajectory is smoothed to remove hand tremor. If a joint would exceed its limits, all joints slow down
        together. Positions outside the limits are clipped.

        Args:
            states: States of a motion in chronological order.
            limits: Limits of the joints to use, keyed by joint name, such as ``arm.limits``.

        Raises:
            ArmInputError: No joint moved, or there are fewer than two states.
        """
        import numpy as np

        from controller.teach.hand_path import path_of
        from controller.teach.slowing import goal_points, slowed

        joints, bounds = tuple(limits), tuple(limits.values())
        known = [one for one in states if not any(joint in one.faults for joint in joints)]
        if len(known) < 2:
            raise ArmInputError(f"a trajectory needs at least two states without faults, but there are {len(known)}")
        times_s = np.array([one.time_s for one in known])
        path = path_of(times_s, np.array([[one.position[joint] for joint in joints] for one in known]), bounds)
        if path is None:
            raise ArmInputError("no joint moved while the states were recorded: move the arm by hand")
        path = slowed(path, bounds, 1.0)
        points = goal_points(path, bounds)
        rows = [path.position[0].tolist(), *(list(point.positions) for point in points)]
        speeds = [[0.0] * len(joints), *(list(point.velocities) for point in points)]
        return cls(
            [0.0, *(point.time_from_start_s for point in points)],
            {joint: [row[i] for row in rows] for i, joint in enumerate(joints)},
            {joint: [row[i] for row in speeds] for i, joint in enumerate(joints)},
        )


@dataclass(frozen=True, slots=True)
class PlannedTrajectory(ArmTrajectory):
    """Trajectory around obstacles. ``Arm.follow`` rejects a trajectory if the arm is not at the start."""

    start: Mapping[str, float] = field(default_factory=dict)
    """Initial positions of all joints, in rad or m, including joints that do not move."""
    margins: "PathMargins | None" = field(default=None, repr=False, compare=False)
    """Distances from obstacles that the path keeps. If None, ``Arm.follow`` requires a clearance of 1 mm."""
