"""Plan motions for a running arm from its measured state."""

import math
from collections.abc import Callable, Mapping
from typing import Final

from hal.types import JointLimits
from servoloop.api.arm_errors import ArmInputError, PlanFailedError
from servoloop.api.backend import ArmState
from servoloop.api.planning.arm_scene import ArmScene, plan_errors
from servoloop.api.planning.motion_planner import MotionPlanner
from servoloop.api.planning.pose import ArmPose
from servoloop.api.trajectory import ArmTrajectory, PlannedTrajectory

MOVED: Final = 0.01
"""Maximum accepted distance of a joint from the start of a plan, as a fraction of the joint's range."""


class ArmPlanner:
    """Motion planner for a running arm. The planner avoids the obstacles in the arm's scene."""

    def __init__(self, arm: str, limits: Mapping[str, JointLimits], state: Callable[[], ArmState]) -> None:
        """Read the files of an arm.

        Args:
            arm: Name or folder of the arm.
            limits: Joint limits, keyed by joint name.
            state: Function that returns the latest state of the arm.

        Raises:
            ArmSetupError: The ``planning`` extra is not installed, or the files of the arm are invalid.
            PlanFailedError: A joint or the tool is missing from the scene file.
        """
        with plan_errors():
            self._planner = MotionPlanner(arm)
        self._limits, self._state = limits, state
        self.scene = ArmScene(self._planner, self.position)

    def position(self) -> Mapping[str, float]:
        """Return the measured positions of all joints. Raises ArmInputError if a position is unknown."""
        state = self._state()
        for joint, position in state.position.items():
            if not math.isfinite(position):
                raise ArmInputError(
                    f"{joint} has not responded yet, so its position is unknown: check its servo", joint
                )
        return state.position

    def pose(self, tool: str | None) -> ArmPose:
        """Return the measured pose of a tool."""
        with plan_errors():
            position_m, quaternion = self._planner.pose(self.position(), tool)
        return ArmPose(tuple(position_m.tolist()), tuple(quaternion.tolist()), tool=tool)

    def plan(self, goal: Mapping[str, float] | ArmPose, speed: float, time_limit_s: float) -> PlannedTrajectory:
        """Plan a motion from the measured state to a goal. The goal may include the gripper's current position."""
        start = self.position()
        if not isinstance(goal, ArmPose):
            goal = {
                j: at for j, at in goal.items() if j in self._planner.plannable or not self._is_near(j, at, start[j])
            }
        with plan_errors():
            return self._planner.plan(start, goal, speed=speed, time_limit_s=time_limit_s)

    def check(self, trajectory: ArmTrajectory) -> None:
        """Check that the arm is at the start of a planned trajectory and that the path is not blocked by an obstacle.

        Raises:
            PlanFailedError: The arm has moved since the trajectory was planned, or an obstacle blocks the path.
        """
        if not isinstance(trajectory, PlannedTrajectory):
            return
        now = self.position()
        for joint, planned in trajectory.start.items():
            if not self._is_near(joint, now[joint], planned):
                raise PlanFailedError(
                    f"{joint} is at {now[joint]:.4f}, but the plan begins at {planned:.4f}: plan again",
                    joint,
                    "START_STATE_INVALID",
                )
        if text := self._planner.contact(trajectory, now):
            raise PlanFailedError(f"{text}: plan again", code="INVALID_MOTION_PLAN")

    def _is_near(self, joint: str, one: float, other: float) -> bool:
        limit = self._limits[joint]
        room = MOVED * (limit.upper - limit.lower)
        return abs(one - other) <= (room if math.isfinite(room) else MOVED)
