"""Convert one cycle's sample to the ROS 2 messages of a recording."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from rosbags.typesys.stores import ros2_jazzy as ros

from controller.diagnostics import LOOP, Level, Status
from controller.gripper.goal import GripperGoal
from controller.trajectory.goal import TrajectoryGoal
from hal.robot_description.description import Description
from hal.types import FloatArray
from servoloop.recording.bus_tap import Transfer
from servoloop.recording.mcap_messages import SCENE
from servoloop.recording.message_types import (
    BUS_TRAFFIC,
    CONTROLLER_STATE,
    CYCLE,
    DIAGNOSTICS,
    GOAL_RESULT,
    JOINT_STATE,
    STRING,
    TF,
    TRAJECTORY,
    typestore,
)
from servoloop.recording.sampler import CycleSample, CycleTiming, GoalBegin, GoalEnd, LinkPose, LinkPoses, Tracked

INTERFACES = ("position", "velocity", "effort")
NONE = np.empty(0)


class Recorded(NamedTuple):
    """Message of a recording with its topic, type and log time."""

    topic: str
    kind: str
    stamp_ns: int
    message: object


class Messages:
    """Factory of the ROS messages in a robot's recording."""

    def __init__(
        self, description: Description, joints: Sequence[str], command_interfaces: Sequence[str], offset_s: float
    ) -> None:
        """Create the message factory of a robot.

        Args:
            description: Robot description.
            joints: Joints of the hardware, in the order used in its states.
            command_interfaces: Command interfaces of the hardware, in the order of its commands.
            offset_s: ROS time minus the time of the loop's clock, in seconds.
        """
        self._description = description
        self._joints = list(joints)
        self._commanded = list(dict.fromkeys(name.rpartition("/")[0] for name in command_interfaces))
        split = [name.rpartition("/") for name in command_interfaces]
        self._places = [(INTERFACES.index(kind), self._commanded.index(joint)) for joint, _, kind in split]
        self._links = LinkPoses(description.joints, joints)
        self._offset_s = offset_s
        types: dict[str, Callable[..., Any]] = dict(typestore().types)
        self._controller_state, self._bus_traffic = types[CONTROLLER_STATE], types[BUS_TRAFFIC]
        self._cycle, self._goal_result = types[CYCLE], types[GOAL_RESULT]

    def latched(self, stamp_s: float) -> Iterator[Recorded]:
        """Yield the messages that never change: the robot description and the fixed transforms."""
        yield self._of("/robot_description", STRING, stamp_s, _STRING(self._description.xml))
        yield self._of("/tf_static", TF, stamp_s, self._transforms(self._links.fixed, stamp_s))

    def of_cycle(self, sample: CycleSample) -> Iterator[Recorded]:
        """Yield all messages of one cycle."""
        state = sample.state
        stamp_s = state.stamp_s
        yield from map(self._traffic, sample.transfers)
        if sample.timing is not None:
            yield self._timing(sample.timing)
        states = _JOINT_STATE(self._header(stamp_s), self._joints, state.position, state.velocity, state.effort)
        yield self._of("/joint_states", JOINT_STATE, stamp_s, states)
        yield self._of("/servoloop/commands", JOINT_STATE, stamp_s, self._command(sample.command, stamp_s))
        for tracked in sample.tracked:
            yield self._of(f"/{tracked.controller}/controller_state", CONTROLLER_STATE, stamp_s, self._state(tracked))
        for goal in sample.goals:
            yield self._goal_begin(goal, stamp_s) if isinstance(goal, GoalBegin) else self._goal_end(goal, stamp_s)
        yield self._of("/tf", TF, stamp_s, self._transforms(self._links.moving(state.position), stamp_s))
        if sample.scene:
            yield self._of(SCENE, TF, stamp_s, self._transforms(sample.scene, stamp_s))
        if sample.diagnostics:
            yield self._diagnostics(sample.diagnostics, stamp_s)

    def of_failure(self, stamp_s: float) -> Recorded:
        """Return the message for a loop that ended with an error, such as a lost arm, after its last cycle."""
        text = "the control loop or its shutdown failed: check the log"
        return self._diagnostics([Status(Level.ERROR, LOOP, text, "")], stamp_s)

    def of_transfers(self, transfers: Iterable[Transfer]) -> Iterator[Recorded]:
        """Return the messages for bus traffic after the last cycle."""
        return map(self._traffic, transfers)

    def _of(self, topic: str, kind: str, stamp_s: float, message: object) -> Recorded:
        return Recorded(topic, kind, round((stamp_s + self._offset_s) * 1e9), message)

    def _header(self, stamp_s: float, frame_id: str = "") -> "ros.std_msgs__msg__Header":
        sec, nanosec = divmod(round((stamp_s + self._offset_s) * 1e9), 1_000_000_000)
        return _HEADER(_TIME(sec, nanosec), frame_id)

    def _traffic(self, transfer: Transfer) -> Recorded:
        stamp_s, port, sent, data = transfer
        message = self._bus_traffic(self._header(stamp_s, port), sent, np.frombuffer(data, np.uint8))
        return self._of("/servoloop/bus_traffic", BUS_TRAFFIC, stamp_s, message)

    def _timing(self, timing: CycleTiming) -> Recorded:
        stamp_s, *figures = timing
        return self._of("/servoloop/cycles", CYCLE, stamp_s, self._cycle(self._header(stamp_s), *figures))

    def _command(self, command: FloatArray, stamp_s: float) -> object:
        """Return the commands as a JointState message, with NaN for interfaces without a command."""
        values = np.full((len(INTERFACES), len(self._commanded)), np.nan)
        for place, value in zip(self._places, command.tolist(), strict=True):
            values[place] = value
        used = {kind for kind, _ in self._places}
        columns = [values[kind] if kind in used else NONE for kind in range(len(INTERFACES))]
        return _JOINT_STATE(self._header(stamp_s), self._commanded, *columns)

    def _state(self, tracked: Tracked) -> object:
        tracking = tracked.tracking
        reference, velocity = tracking.reference, tracking.feedback_velocity
        return self._controller_state(
            header=self._header(tracking.stamp_s),
            joint_names=list(tracked.joints),
            reference=_point(reference.position, reference.velocity, reference.acceleration),
            feedback=_point(tracking.feedback_position, velocity),
            error=_point(tracking.error, reference.velocity - velocity),
            output=_point(tracking.output),
            multi_dof_joint_names=[],
            multi_dof_reference=_NO_POINT,
            multi_dof_feedback=_NO_POINT,
            multi_dof_error=_NO_POINT,
            multi_dof_output=_NO_POINT,
            speed_scaling_factor=tracking.speed_scaling_factor,
        )

    def _goal_begin(self, begin: GoalBegin, stamp_s: float) -> Recorded:
        topic, goal, header = f"/{begin.controller}/goal", begin.goal, self._header(stamp_s)
        if isinstance(goal, GripperGoal):
            values = (np.array([value]) for value in (goal.position, goal.max_velocity, goal.max_effort))
            return self._of(topic, JOINT_STATE, stamp_s, _JOINT_STATE(header, list(begin.joints), *values))
        return self._of(topic, TRAJECTORY, stamp_s, _TRAJECTORY(header, list(begin.joints), _points(goal)))

    def _goal_end(self, end: GoalEnd, stamp_s: float) -> Recorded:
        message = self._goal_result(self._header(stamp_s), end.status.value, end.error_code, end.text)
        return self._of(f"/{end.controller}/goal_result", GOAL_RESULT, stamp_s, message)

    def _transforms(self, poses: Iterable[LinkPose], stamp_s: float) -> object:
        return _TF([_transform(pose, self._header(stamp_s, pose.parent)) for pose in poses])

    def _diagnostics(self, statuses: Iterable[Status], stamp_s: float) -> Recorded:
        found = [
            _STATUS(
                int(one.level),
                one.name,
                one.message,
                one.hardware_id,
                [_KEY_VALUE(*item) for item in one.values.items()],
            )
            for one in statuses
        ]
        return self._of("/diagnostics", DIAGNOSTICS, stamp_s, _DIAGNOSTICS(self._header(stamp_s), found))


_TIME, _DURATION = ros.builtin_interfaces__msg__Time, ros.builtin_interfaces__msg__Duration
_HEADER, _STRING = ros.std_msgs__msg__Header, ros.std_msgs__msg__String
_JOINT_STATE = ros.sensor_msgs__msg__JointState
_POINT, _TRAJECTORY = ros.trajectory_msgs__msg__JointTrajectoryPoint, ros.trajectory_msgs__msg__JointTrajectory
_STAMPED, _TF = ros.geometry_msgs__msg__TransformStamped, ros.tf2_msgs__msg__TFMessage
_STATUS, _DIAGNOSTICS = ros.diagnostic_msgs__msg__DiagnosticStatus, ros.diagnostic_msgs__msg__DiagnosticArray
_KEY_VALUE = ros.diagnostic_msgs__msg__KeyValue
_NO_POINT = ros.trajectory_msgs__msg__MultiDOFJointTrajectoryPoint([], [], [], _DURATION(0, 0))


def _point(
    position: FloatArray, velocity: FloatArray = NONE, acceleration: FloatArray = NONE, from_start_s: float = 0.0
) -> ros.trajectory_msgs__msg__JointTrajectoryPoint:
    sec, nanosec = divmod(round(from_start_s * 1e9), 1_000_000_000)
    return _POINT(position, velocity, acceleration, NONE, _DURATION(sec, nanosec))


def _points(goal: TrajectoryGoal) -> list[ros.trajectory_msgs__msg__JointTrajectoryPoint]:
    return [
        _point(
            np.array(point.positions, np.float64),
            np.array(point.velocities, np.float64),
            np.array(point.accelerations, np.float64),
            point.time_from_start_s,
        )
        for point in goal.points
    ]


def _transform(pose: LinkPose, header: ros.std_msgs__msg__Header) -> ros.geometry_msgs__msg__TransformStamped:
    place = ros.geometry_msgs__msg__Vector3(*pose.position_m)
    turn = ros.geometry_msgs__msg__Quaternion(*pose.quaternion)
    return _STAMPED(header, pose.child, ros.geometry_msgs__msg__Transform(place, turn))
