"""State of a robot: positions of all joints, with kinematics computed by move_group."""

from collections.abc import Mapping, Sequence
from copy import copy
from typing import Any, Self

import numpy as np
from geometry_msgs.msg import Pose
from moveit_msgs.msg import MoveItErrorCodes, PositionIKRequest
from moveit_msgs.msg import RobotState as RobotStateMsg
from numpy.typing import NDArray
from rclpy.duration import Duration

from hal.robot_description.urdf import UrdfJoint
from hal.rotations import matrices
from moveit.core.robot_model import JointModelGroup, RobotModel

Vector = NDArray[np.float64]


def _default(joint: UrdfJoint) -> float:
    """Return 0, or the middle of the range if 0 is outside the range."""
    return 0.0 if joint.lower <= 0.0 <= joint.upper else (joint.lower + joint.upper) / 2.0


class RobotState:
    """Positions of all joints except fixed joints and mimic joints, in rad or m."""

    def __init__(self, robot_model: RobotModel) -> None:
        self._model = robot_model
        self._positions = {name: _default(joint) for name, joint in robot_model.joints.items()}

    @classmethod
    def from_message(cls, robot_model: RobotModel, message: RobotStateMsg) -> Self:
        """Return the state that a moveit_msgs/RobotState describes. Joints that the message does not contain have their
        default positions."""
        state = cls(robot_model)
        named = zip(message.joint_state.name, message.joint_state.position, strict=True)
        state.joint_positions = {name: position for name, position in named if name in state._positions}
        return state

    def __copy__(self) -> "RobotState":
        """Return an independent copy."""
        other = RobotState(self._model)
        other.joint_positions = self.joint_positions
        return other

    def __deepcopy__(self, memo: dict[int, Any]) -> "RobotState":
        """Return an independent copy with the same model."""
        return copy(self)

    @property
    def robot_model(self) -> RobotModel:
        """Model of the robot."""
        return self._model

    @property
    def dirty(self) -> bool:
        """Always False, because move_group computes transforms when they are needed."""
        return False

    @property
    def joint_positions(self) -> dict[str, float]:
        """Positions in rad or m, keyed by joint name. An assigned mapping may contain only some of the joints."""
        return dict(self._positions)

    @joint_positions.setter
    def joint_positions(self, positions: Mapping[str, float]) -> None:
        for name, position in positions.items():
            if name not in self._positions:
                raise ValueError(f"there is no joint {name}: choose from {', '.join(self._positions)}")
            self._positions[name] = float(position)

    def update(self, force: bool = False, type: str = "all") -> None:
        """Do nothing, because move_group computes transforms when they are needed."""

    def set_to_default_values(self, joint_model_group_name: str | None = None, name: str | None = None) -> bool:
        """Set all joints to their defaults, or a group to a named state. Return whether the state exists."""
        if joint_model_group_name is None:
            self.joint_positions = {joint: _default(self._model.joints[joint]) for joint in self._positions}
            return True
        states = self._group(joint_model_group_name).states
        if name not in states:
            return False
        self.joint_positions = states[name]
        return True

    def set_to_random_positions(self, joint_model_group: JointModelGroup | None = None) -> None:
        """Set all joints, or those of a group, to random positions within their limits."""
        names = list(self._positions) if joint_model_group is None else joint_model_group.active_joint_model_names
        joints = [self._model.joints[name] for name in names]
        low, high = np.array([(max(j.lower, -np.pi), min(j.upper, np.pi)) for j in joints]).T
        self.joint_positions = dict(zip(names, np.random.default_rng().uniform(low, high).tolist(), strict=True))

    def get_joint_group_positions(self, joint_model_group_name: str) -> Vector:
        """Return the positions (n,) of a group, in rad or m."""
        return np.array([self._positions[name] for name in self._group(joint_model_group_name).joint_model_names])

    def set_joint_group_positions(self, joint_model_group_name: str, position_values: Sequence[float] | Vector) -> None:
        """Set the positions (n,) of a group, in rad or m. Raises ValueError if the number of positions is wrong."""
        names = self._group(joint_model_group_name).joint_model_names
        values = np.asarray(position_values, dtype=float).ravel()
        if len(values) != len(names):
            raise ValueError(
                f"Expected {len(names)} values for joint model group '{joint_model_group_name}', got {len(values)}"
            )
        self.joint_positions = dict(zip(names, values.tolist(), strict=True))

    set_joint_group_active_positions = set_joint_group_positions

    def get_pose(self, link_name: str) -> Pose:
        """Return the pose of a link in the frame of the model. Raises RuntimeError if the link does not exist."""
        response = self._client().forward(self.message(), [link_name], self._model.model_frame)
        if response.error_code.val != MoveItErrorCodes.SUCCESS:
            raise RuntimeError(response.error_code.message or f"move_group cannot compute a pose of {link_name}")
        return response.pose_stamped[0].pose

    def get_global_link_transform(self, link_name: str) -> Vector:
        """Return the transform (4, 4) from the frame of a link to the frame of the model. Raises RuntimeError."""
        pose, transform = self.get_pose(link_name), np.eye(4)
        turn = pose.orientation
        transform[:3, :3] = matrices(np.array([turn.x, turn.y, turn.z, turn.w]))
        transform[:3, 3] = pose.position.x, pose.position.y, pose.position.z
        return transform

    get_frame_transform = get_global_link_transform

    def set_from_ik(
        self, joint_model_group_name: str, geometry_pose: Pose, tip_name: str, timeout: float = 0.0
    ) -> bool:
        """Set the joints of a group so that a link is at a pose in the frame of the model. Return whether there is a
        solution."""
        request = PositionIKRequest(
            group_name=joint_model_group_name, ik_link_name=tip_name, robot_state=self.message()
        )
        request.pose_stamped.header.frame_id = self._model.model_frame
        request.pose_stamped.pose = geometry_pose
        request.timeout = Duration(seconds=timeout).to_msg()
        response = self._client().inverse(request, timeout)
        if response.error_code.val != MoveItErrorCodes.SUCCESS:
            return False
        solved = RobotState.from_message(self._model, response.solution)
        self.set_joint_group_positions(joint_model_group_name, solved.get_joint_group_positions(joint_model_group_name))
        return True

    def message(self) -> RobotStateMsg:
        """Return the state as moveit_msgs/RobotState. Objects attached to the robot stay attached."""
        message = RobotStateMsg(is_diff=True)
        message.joint_state.name = list(self._positions)
        message.joint_state.position = list(self._positions.values())
        return message

    def _group(self, name: str) -> JointModelGroup:
        return self._model.get_joint_model_group(name)

    def _client(self) -> Any:
        if self._model.client is None:
            raise RuntimeError("this robot model has no connection to move_group: use MoveItPy.get_robot_model()")
        return self._model.client


def robotStateToRobotStateMsg(state: RobotState, copy_attached_bodies: bool = True) -> RobotStateMsg:
    """Return a state as moveit_msgs/RobotState."""
    return state.message()
