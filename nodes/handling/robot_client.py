"""Move the joints of a running stack manually, through their controllers."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import monotonic
from typing import Final

import numpy as np
from action_msgs.msg import GoalStatus, GoalStatusArray
from action_msgs.srv import CancelGoal
from builtin_interfaces.msg import Duration
from controller_manager_msgs.msg import ControllerState
from controller_manager_msgs.srv import ListControllers
from rclpy.client import Client
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import qos_profile_action_status_default
from rclpy.task import Future
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from hal.types import FloatArray
from nodes.handling.guided_motion import HORIZON_S, GuidedMotion, JointPositions
from nodes.handling.robot import HandlingError, MovableRobot, describe_faults
from nodes.ros_process import spin_until_done

TRAJECTORY: Final = "joint_trajectory_controller/JointTrajectoryController"
FORWARD: Final = (
    "forward_command_controller/ForwardCommandController",
    "position_controllers/JointGroupPositionController",
)
GRIPPER: Final = "/GripperActionController"
"""Suffix of gripper controller types. Their goals can be canceled, but they cannot be moved manually."""
SLOW: Final = 0.25
"""Maximum velocity of manual motion, in rad/s or m/s."""
SHARE: Final = 0.1
"""Maximum velocity of manual motion as a fraction of the velocity limit of the joint."""
FRESH_S: Final = 0.5
"""Maximum age of a measurement from which a motion may start, in seconds."""
ANSWER_S: Final = 5.0
LISTEN_S: Final = 0.1
"""Time to listen before a motion starts, in seconds, so that it does not replace a running goal of another client."""
AT_ONCE: Final = 4
"""Maximum number of messages handled in one call without waiting."""
REFRESH_S: Final = 0.2
"""Interval between requests for the list of controllers, in seconds."""
RUNNING: Final = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING)


@dataclass(slots=True)
class _DrivenController:
    """A controller with its joints, its command publisher and the motion of the joints."""

    joints: tuple[str, ...]
    publisher: Publisher
    trajectories: bool
    motion: GuidedMotion | None = None
    commanded_s: float = 0.0
    cancel: Client | None = None
    busy: bool = False
    """Whether a goal is running, according to the newest status message."""
    status: str = ""
    """Name of the status topic."""
    reported_by: frozenset[bytes] = frozenset()
    """Publishers of the status topic at the newest message. A killed stack cannot report that its goals have ended."""


class RobotClient:
    """Client that jogs joints and approaches poses, slowly and within limits.

    All calls come from one thread, and each of them may spin ``executor``.

    Each call of ``jog`` or ``approach`` moves a short distance, so call them at least ten times per second. The joints
    stop within 0.3 s after the last call, even if this process is killed. Methods raise HandlingError if a joint cannot
    be moved.
    """

    def __init__(
        self, node: Node, executor: SingleThreadedExecutor, robot: MovableRobot, now: Callable[[], float] = monotonic
    ) -> None:
        self._node, self._executor, self._robot, self._now = node, executor, robot, now
        self._known: dict[str, _DrivenController] = {}
        """All controllers that have been active since the start, by name."""
        self._controllers: dict[str, _DrivenController] = {}
        self._grippers: dict[str, Client] = {}
        self._inactive: dict[str, str] = {}
        """Inactive controller that could move each joint, by joint."""
        self._listing: Future | None = None
        """Pending request for the list of controllers, or None."""
        self._listed_s = -math.inf
        """Time of the latest request, in seconds."""
        self._listens_since_s = self._listened_s = -math.inf
        """Start of the present uninterrupted listening period, and time of the last listening, in seconds."""
        self._list = node.create_client(ListControllers, "/controller_manager/list_controllers")

    @property
    def driven(self) -> dict[str, tuple[str, ...]]:
        """Joints of each active controller, by its name."""
        return {name: controller.joints for name, controller in self._controllers.items()}

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints that can be moved, because their controllers are active."""
        return tuple(joint for joints in self.driven.values() for joint in joints)

    @property
    def found(self) -> bool:
        """Whether a stack is running, so that ``connect`` need not wait."""
        return bool(self._list.service_is_ready())

    def connect(self) -> None:
        """Find the active controllers.

        Raises:
            HandlingError: No stack responds, or no active controller moves joints.
        """
        if not self._list.wait_for_service(ANSWER_S):
            raise HandlingError("no running stack was found: start `servoloop up` with the same ROS_DOMAIN_ID")
        answer = self._list.call_async(ListControllers.Request())
        if not spin_until_done(self._executor, answer, ANSWER_S):
            raise HandlingError(
                f"the controller manager did not respond within {ANSWER_S:.0f} s: check the log of the stack"
            )
        self._store(answer.result())
        if not self._controllers:
            raise HandlingError("no controller that moves joints is active: activate one, or restart the stack")

    def listen(self) -> None:
        """Receive messages between motions. Frequent calls let a motion start without delay."""
        self._refresh()
        self._listen(0.0)

    def _refresh(self) -> None:
        """Request the list of controllers and process a response that has arrived, without waiting."""
        now_s = monotonic()
        if self._listing is not None and self._listing.done():
            listing, self._listing = self._listing, None
            if listing.exception() is None:
                self._store(listing.result())
        if now_s - self._listed_s > (REFRESH_S if self._listing is None else ANSWER_S):
            self._listed_s, self._listing = now_s, self._list.call_async(ListControllers.Request())

    def _store(self, answer: ListControllers.Response) -> None:
        """Store the active controllers. A controller that is no longer active loses its motion."""
        active = [controller for controller in answer.controller if controller.state == "active"]
        self._inactive = {
            joint: controller.name
            for controller in answer.controller
            if controller.state == "inactive" and controller.type in (TRAJECTORY, *FORWARD)
            for joint in _joints_of(controller)
        }
        for controller in active:
            if controller.type.endswith(GRIPPER) and controller.name not in self._grippers:
                service = f"/{controller.name}/gripper_cmd/_action/cancel_goal"
                self._grippers[controller.name] = self._node.create_client(CancelGoal, service)
            if controller.name not in self._known and (created := self._create(controller)):
                self._known[controller.name] = created
                self._listened_s = -math.inf  # The new controller may have a running goal.
        self._controllers = {
            controller.name: self._known[controller.name] for controller in active if controller.name in self._known
        }
        for name in self._known.keys() - self._controllers.keys():
            self._known[name].motion = None

    def fastest(self, joint: str) -> float:
        """Return the velocity of a joint at full speed, in rad/s or m/s."""
        return min(SLOW, SHARE * self._robot.limits[joint].velocity)

    def jog(self, joint: str, share: float) -> None:
        """Move a joint a short distance, at a fraction ``share`` (-1 to 1) of its full speed."""
        self.listen()
        name, controller = self._controller_of(joint)
        motion, passed_s, at = self._begin(name, controller)
        velocity = np.zeros(len(controller.joints))
        velocity[controller.joints.index(joint)] = np.clip(share, -1.0, 1.0) * self.fastest(joint)
        motion.go(velocity, passed_s, at)
        self._send(controller, motion)

    def approach(self, pose: Mapping[str, float], share: float = 1.0) -> bool:
        """Move a short distance toward a pose.

        Args:
            pose: Target positions by joint, in rad or m.
            share: Fraction of full speed, from 0 to 1.

        Returns:
            Whether all joints are commanded to be at the pose.

        Raises:
            HandlingError: A joint cannot be moved.
        """
        self.listen()
        if missing := sorted(pose.keys() - set(self.joints)):
            raise HandlingError(self._no_controller(missing))
        reached = True
        for name, controller in self._controllers.items():
            if not any(joint in pose for joint in controller.joints):
                continue
            motion, passed_s, at = self._begin(name, controller)
            target = np.array(
                [pose.get(joint, here) for joint, here in zip(controller.joints, motion.set_point, strict=True)]
            )
            reached &= motion.go_to(target, passed_s * min(1.0, max(0.0, share)), at)
            self._send(controller, motion)
        return reached

    def stop(self) -> None:
        """Cancel all goals of all clients. Motions of this client stop without further calls."""
        trajectories = (controller.cancel for controller in self._known.values() if controller.cancel is not None)
        for cancel in (*trajectories, *self._grippers.values()):
            cancel.call_async(CancelGoal.Request())

    def _create(self, state: ControllerState) -> _DrivenController | None:
        joints = _joints_of(state)
        if any("/" in joint for joint in joints):
            return None
        if state.type == TRAJECTORY:
            publisher = self._node.create_publisher(JointTrajectory, f"/{state.name}/joint_trajectory", 1)
            created = _DrivenController(joints, publisher, True)
            action = f"/{state.name}/follow_joint_trajectory/_action"
            created.status = f"{action}/status"
            created.cancel = self._node.create_client(CancelGoal, f"{action}/cancel_goal")

            def on_status(message: GoalStatusArray) -> None:
                created.busy = any(goal.status in RUNNING for goal in message.status_list)
                created.reported_by = self._publishers(created.status)

            self._node.create_subscription(
                GoalStatusArray, created.status, on_status, qos_profile_action_status_default
            )
            return created
        if state.type in FORWARD:
            return _DrivenController(
                joints, self._node.create_publisher(Float64MultiArray, f"/{state.name}/commands", 1), False
            )
        return None

    def _controller_of(self, joint: str) -> tuple[str, _DrivenController]:
        for name, controller in self._controllers.items():
            if joint in controller.joints:
                return name, controller
        raise HandlingError(self._no_controller([joint]))

    def _no_controller(self, joints: Sequence[str]) -> str:
        """Return an error message with a remedy for joints without an active controller."""
        inactive = dict.fromkeys(self._inactive[joint] for joint in joints if joint in self._inactive)
        advice = f"activate {', '.join(inactive)}" if inactive else "activate a controller that does"
        return f"no active controller moves {', '.join(joints)}: {advice}"

    def _begin(self, name: str, controller: _DrivenController) -> tuple[GuidedMotion, float, JointPositions]:
        """Return the motion of a controller, the time since its last command, and the positions of its joints.

        If no motion is running, a new motion starts at the commanded positions.
        """
        now_s = self._now()
        passed_s, controller.commanded_s = now_s - controller.commanded_s, now_s
        begins = controller.motion is None or passed_s > HORIZON_S
        if begins:
            self._listen(self._remaining_listen_s())
        if controller.busy and self._still_busy(controller):
            controller.motion = None
            raise HandlingError(f"{name} has a goal under way: stop it first")
        now = self._robot.joints_now()
        if not now.age_s <= FRESH_S:
            controller.motion = None
            raise HandlingError("the joint positions are outdated: check that the stack is still running")
        if fault := describe_faults({joint: now.faults[joint] for joint in controller.joints if joint in now.faults}):
            controller.motion = None
            raise HandlingError(fault)
        at = JointPositions(_array(now.commanded, controller.joints), _array(now.measured, controller.joints))
        if controller.motion is None or begins:
            limits = [self._robot.limits[joint] for joint in controller.joints]
            lower, upper = np.array([limit.lower for limit in limits]), np.array([limit.upper for limit in limits])
            controller.motion = GuidedMotion(
                at.commanded, lower, upper, np.array([self.fastest(joint) for joint in controller.joints])
            )
            passed_s = 0.0
        return controller.motion, passed_s, at

    def _still_busy(self, controller: _DrivenController) -> bool:
        """Return whether the goal is still running. A stack that was killed or restarted has no running goal."""
        now = self._publishers(controller.status)
        # The graph may discover the publisher slightly after its message.
        controller.reported_by = controller.reported_by or now
        controller.busy = bool(now) and now <= controller.reported_by
        return controller.busy

    def _publishers(self, topic: str) -> frozenset[bytes]:
        return frozenset(bytes(info.endpoint_gid) for info in self._node.get_publishers_info_by_topic(topic))

    def _remaining_listen_s(self) -> float:
        """Return how long this client must still listen to know all running goals, in seconds."""
        now_s = monotonic()
        since_s = self._listens_since_s if now_s - self._listened_s <= LISTEN_S else now_s
        return max(0.0, LISTEN_S - (now_s - since_s))

    def _listen(self, seconds: float) -> None:
        """Receive messages for ``seconds``, in particular the status of running goals."""
        now_s = monotonic()
        if now_s - self._listened_s > LISTEN_S:
            self._listens_since_s = now_s
        until_s = now_s + seconds
        for _ in range(AT_ONCE):
            self._executor.spin_once(timeout_sec=0.0)
        while monotonic() < until_s:
            self._executor.spin_once(timeout_sec=0.02)
        self._listened_s = monotonic()

    def _send(self, controller: _DrivenController, motion: GuidedMotion) -> None:
        set_point = motion.set_point.tolist()
        if controller.trajectories:
            point = JointTrajectoryPoint(positions=set_point, time_from_start=Duration(nanosec=int(HORIZON_S * 1e9)))
            controller.publisher.publish(JointTrajectory(joint_names=list(controller.joints), points=[point]))
        else:  # A forward command controller holds its newest command.
            controller.publisher.publish(Float64MultiArray(data=set_point))


def _joints_of(state: ControllerState) -> tuple[str, ...]:
    """Return the joints that a controller commands."""
    return tuple(interface.removesuffix("/position") for interface in state.required_command_interfaces)


def _array(positions: Mapping[str, float], joints: tuple[str, ...]) -> FloatArray:
    array = np.array([positions.get(joint, np.nan) for joint in joints])
    if not np.isfinite(array).all():
        raise HandlingError("not all joints have been measured: check that all servos answer")
    return array
