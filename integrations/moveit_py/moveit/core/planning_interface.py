"""Result of a plan."""

from dataclasses import dataclass

from moveit_msgs.msg import MoveItErrorCodes

from moveit.core.robot_trajectory import RobotTrajectory


@dataclass(frozen=True, slots=True)
class MotionPlanResponse:
    """Result of a plan, which is true if the plan succeeded."""

    trajectory: RobotTrajectory
    planning_time: float
    """Time that the planner needed, in seconds."""
    error_code: MoveItErrorCodes
    planner_id: str = ""

    def __bool__(self) -> bool:
        """Return whether the plan succeeded."""
        return bool(self.error_code.val == MoveItErrorCodes.SUCCESS)
