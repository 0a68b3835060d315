"""Trajectory of a robot, as returned by the planner."""

from collections.abc import Iterator, Sequence
from copy import deepcopy

from moveit_msgs.msg import RobotState as RobotStateMsg
from moveit_msgs.msg import RobotTrajectory as RobotTrajectoryMsg
from rclpy.time import Duration

from moveit.core.robot_model import RobotModel
from moveit.core.robot_state import RobotState


class RobotTrajectory:
    """Sequence of states, with the times between them."""

    def __init__(self, robot_model: RobotModel) -> None:
        self._model = robot_model
        self._message = RobotTrajectoryMsg()
        self._start = RobotState(robot_model)
        self.joint_model_group_name = ""

    @property
    def robot_model(self) -> RobotModel:
        """Model of the robot."""
        return self._model

    @property
    def duration(self) -> float:
        """Duration in seconds."""
        return self._times_s()[-1] if len(self) else 0.0

    @property
    def average_segment_duration(self) -> float:
        """Average time between two states, in seconds."""
        return self.duration / (len(self) - 1) if len(self) > 1 else 0.0

    def __len__(self) -> int:
        """Return the number of states."""
        return len(self._message.joint_trajectory.points)

    def __getitem__(self, idx: int) -> RobotState:
        """Return the state at an index."""
        state = RobotState.from_message(self._model, self._start.message())
        joint_trajectory = self._message.joint_trajectory
        named = zip(joint_trajectory.joint_names, joint_trajectory.points[idx].positions, strict=True)
        state.joint_positions = dict(named)
        return state

    def __iter__(self) -> Iterator[RobotState]:
        """Iterate over the states."""
        return (self[idx] for idx in range(len(self)))

    def get_waypoint_durations(self) -> list[float]:
        """Return the time from the previous state to each state, in seconds."""
        times_s = self._times_s()
        return [now - before for before, now in zip([0.0, *times_s], times_s, strict=False)]

    def get_robot_trajectory_msg(self, joint_filter: Sequence[str] = ()) -> RobotTrajectoryMsg:
        """Return the trajectory as a message. Filtering by joints is not supported, so the filter must be empty."""
        if joint_filter:
            raise ValueError("joint_filter is not supported: select the joints in the message")
        return deepcopy(self._message)

    def set_robot_trajectory_msg(self, robot_state: RobotState, msg: RobotTrajectoryMsg) -> "RobotTrajectory":
        """Set the trajectory from a message. ``robot_state`` provides the positions of joints that are missing from the
        message."""
        self._start, self._message = RobotState.from_message(self._model, robot_state.message()), deepcopy(msg)
        return self

    def set_response(self, start: RobotStateMsg, message: RobotTrajectoryMsg, group: str) -> None:
        """Set the trajectory from the response of move_group."""
        self.set_robot_trajectory_msg(RobotState.from_message(self._model, start), message)
        self.joint_model_group_name = group

    def _times_s(self) -> list[float]:
        points = self._message.joint_trajectory.points
        return [Duration.from_msg(point.time_from_start).nanoseconds * 1e-9 for point in points]
