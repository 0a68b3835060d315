"""Plan motions of an arm around the objects in its scene and around objects added by the program."""

import math
import threading
import time
from collections.abc import Mapping
from typing import Final

import numpy as np

from hal.types import FloatArray
from planning.collision import Clearance, warm_up
from planning.group_planner import NEAR, GroupPlanner
from planning.kinematics.goals import PoseGoal, PositionSphere, checked_pose
from planning.motion import JointGoal, MotionRequest, Scaling, ToolGoal
from planning.paths.timing import TimedPath
from planning.robot import PlanningRobot
from planning.scene import Scene
from servoloop.api.arm_errors import ArmInputError
from servoloop.api.checks import checked_number
from servoloop.api.options import ArmOptions, setup_errors
from servoloop.api.planning.pose import ArmPose
from servoloop.api.trajectory import ArmTrajectory, PlannedTrajectory
from servoloop.extras import require_extras
from servoloop.motion_planning.robot import arm_groups, planning_robot

TIME_LIMIT_S: Final = 5.0
"""Default maximum search time, in seconds."""

SEARCH: Final = threading.Lock()
"""Lock that is held during a search, because OMPL's random number generator is global in the process."""

Positions = Mapping[str, float]
"""Joint positions in rad or m, keyed by joint name."""


class MotionPlanner:
    """Motion planner for one arm. The same seed, scene and request produce the same motion.

    Obstacles are the objects in the arm's scene file, such as a table, and all objects in ``scene``. The planner only
    computes trajectories, which ``Arm.follow`` executes.
    """

    def __init__(self, arm: str, tool: str | None = None, seed: int = 1) -> None:
        """Read the files of an arm.

        Args:
            arm: Name or folder of the arm.
            tool: Link or site in the scene file that is moved to a pose goal. If None, the group's tip is moved.
            seed: Seed for all random numbers, at least 1.

        Raises:
            ArmSetupError: The files of the arm are invalid, or the ``planning`` extra is not installed.
            PlanningError: A joint or the tool is missing from the scene file.
        """
        with setup_errors():
            require_extras("motion planning", "planning")
            files = ArmOptions(arm).files()
            self.robot: PlanningRobot = planning_robot(files)
            """Planning groups, kinematics and planner of the robot."""
            self._groups = [self.robot.group(group.name) for group in arm_groups(self.robot, files)]
            self._group = self._groups[0]
        warm_up()
        self._tool = self._group.chain(tool, self.robot.rest).tool
        self._seed = seed
        self.scene: Scene = self.robot.scene
        """Objects, and pairs of objects or links that may touch each other.

        To change the scene, assign a modified copy, for example from ``scene.with_object``.
        """
        self.joints = self._group.joints
        """Names of the planned joints. If the robot has several arms, these are the joints of the first arm."""
        self.links = self.robot.links
        """Names of the arm's links, to which objects can be attached."""
        self.objects = self.robot.objects
        """Names of the objects in the arm's scene file. To remove an object, use ``scene.without(name)``."""

    @property
    def plannable(self) -> tuple[str, ...]:
        """Names of the joints of all arms, which can be used in a goal."""
        return tuple(dict.fromkeys(joint for group in self._groups for joint in group.joints))

    @property
    def tool(self) -> str:
        """Link or site that is moved to a pose goal."""
        return self._tool

    @property
    def carrier(self) -> str:
        """Link to which objects are attached by default, which is the tip of the arm's group."""
        return self._group.group.tip or self.links[-1]

    def pose(self, positions: Positions, tool: str | None = None) -> tuple[FloatArray, FloatArray]:
        """Return the position (3,) in m and the quaternion (4,), x y z w, of the tool in the base frame."""
        state = self._state("the positions", positions)
        chain = self._group_of(tool).chain(tool or self._tool, state)
        pose = chain.pose(np.array([state[joint] for joint in chain.names]))
        return pose.position_m, pose.quaternion_xyzw

    def clearance(self, positions: Positions) -> Clearance:
        """Return the smallest distance from the arm to itself or any object, and the pair of links or objects at this
        distance."""
        return self._group.clearance(self._state("the positions", positions), self.scene)

    def plan(
        self,
        start: Positions,
        goal: Positions | PoseGoal | ArmPose,
        *,
        speed: float = 1.0,
        time_limit_s: float = TIME_LIMIT_S,
    ) -> PlannedTrajectory:
        """Plan a collision-free motion within the velocity, acceleration and jerk limits.

        Args:
            start: Start positions of all planned joints. Start positions of other joints, such as hand joints, are used
                only for the collision checks.
            goal: Positions of planned joints, or a region of tool poses in the base frame. Planned joints without a
                goal position keep their start positions. If a robot has several arms, the goal may be for one arm or
                for all arms.
            speed: Fraction of the velocity and acceleration limits, above 0 and at most 1.
            time_limit_s: Maximum time of the search, in seconds.

        Returns:
            A trajectory for ``Arm.follow``, which starts and ends at rest.

        Raises:
            ArmInputError: A joint is unknown or missing, a position is not finite, or ``time_limit_s`` is not a finite
                time above 0.
            PlanningError: The start or the goal is not feasible, or no path was found in time. ``code`` is MoveIt's
                error code.
        """
        end_s, state = time.monotonic() + _checked_limit(time_limit_s), self._state("the start", start)
        target, share = self._goal(goal), checked_number("speed", speed)
        group = self._group_for(target)
        request = MotionRequest(
            start=state,
            goals=(target,),
            scene=self.scene,
            remaining_s=lambda: end_s - time.monotonic(),
            scaling=Scaling(share, share),
            seed=self._seed,
        )
        with SEARCH:
            motion = group.plan(request)
        path = motion.path
        return PlannedTrajectory(
            path.times_s.tolist(),
            dict(zip(group.joints, path.positions.T.tolist(), strict=True)),
            dict(zip(group.joints, path.velocities.T.tolist(), strict=True)),
            state,
            motion.margins,
        )

    def _group_for(self, goal: JointGoal | ToolGoal) -> GroupPlanner:
        """Return the first group that contains all joints of a goal, or the group of the arm that carries the tool."""
        if isinstance(goal, JointGoal):
            return next(group for group in self._groups if set(group.joints).issuperset(goal.positions))
        return self._group_of(goal.link)

    def _group_of(self, tool: str | None) -> GroupPlanner:
        """Return the group whose tip is the tool. For other links and sites, return the group of the first arm."""
        return next((group for group in self._groups if group.group.tip == tool), self._group)

    def contact(self, trajectory: ArmTrajectory, start: Positions) -> str:
        """Describe what a trajectory of planned joints touches in ``scene``, or return an empty string.

        Args:
            trajectory: Points of some or all planned joints.
            start: Positions of all joints. Only the positions of joints that are not moved by the trajectory are used.
        """
        moved = set(trajectory.positions)
        groups = [group for group in self._groups if moved.issubset(group.joints)]
        group = min(groups, key=lambda group: len(group.joints), default=self._group)
        state, length = self._state("the start", start), len(trajectory.times_s)
        columns = [trajectory.positions.get(joint, [state[joint]] * length) for joint in group.joints]
        positions = np.array(columns).T
        path = TimedPath(np.array(trajectory.times_s), positions, np.zeros_like(positions), np.zeros_like(positions))
        margins = trajectory.margins if isinstance(trajectory, PlannedTrajectory) else None
        found = group.future_contact(path, 0.0, state, self.scene, margins or NEAR)
        return "" if found is None else f"{found.one} comes too close to {found.other} after {found.time_s:.1f} s"

    def _goal(self, goal: Positions | PoseGoal | ArmPose) -> JointGoal | ToolGoal:
        if isinstance(goal, ArmPose):
            quaternion = (0.0, 0.0, 0.0, 1.0) if goal.quaternion_xyzw is None else goal.quaternion_xyzw
            pose = checked_pose(goal.position_m, quaternion)
            region = PositionSphere(checked_number("tolerance_m", goal.tolerance_m))
            return ToolGoal(PoseGoal(pose, region, goal.tolerances_rad()), goal.tool or self._tool)
        if isinstance(goal, PoseGoal):
            return ToolGoal(goal, self._tool)
        _check_positions("the goal", goal)
        if unknown := [joint for joint in goal if joint not in self.plannable]:
            known = ", ".join(self.plannable)
            raise ArmInputError(f"no planning group moves joint {unknown[0]} of the goal: use only the joints {known}")
        if not any(set(group.joints).issuperset(goal) for group in self._groups):
            raise ArmInputError(f"no planning group has all of the joints {', '.join(goal)}: add a group to the SRDF")
        _check_finite("the goal", goal)
        return JointGoal(goal)

    def _state(self, what: str, positions: Positions) -> dict[str, float]:
        """Return the state of all driven joints. Positions of hand joints are optional. Raises ArmInputError."""
        _check_positions(what, positions)
        if missing := [joint for joint in self.joints if joint not in positions]:
            raise ArmInputError(
                f"{missing[0]} has no position in {what}: specify a position for each of {', '.join(self.joints)}"
            )
        if unknown := [joint for joint in positions if joint not in self.robot.description.joints]:
            known = ", ".join(self.robot.limits)
            raise ArmInputError(f"{what} has a position for {unknown[0]}, which is not a joint: choose from {known}")
        _check_finite(what, positions)
        return self.robot.state({**self.robot.rest, **positions})


def _checked_limit(time_limit_s: object) -> float:
    limit_s = checked_number("time_limit_s", time_limit_s)
    if not (math.isfinite(limit_s) and limit_s > 0.0):
        raise ArmInputError(f"time_limit_s must be a finite time above 0 s, not {time_limit_s}")
    return limit_s


def _check_positions(what: str, positions: object) -> None:
    if not isinstance(positions, Mapping):
        raise ArmInputError(f"{what} must be positions keyed by joint name, not {positions!r}")


def _check_finite(what: str, positions: Positions) -> None:
    for joint, position in positions.items():
        if not math.isfinite(checked_number(joint, position)):
            raise ArmInputError(f"{what}: {joint} is {position}: use a finite number", joint)
