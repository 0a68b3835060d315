"""A client of a running stack that moves its joints through their controllers, as long as somebody says so."""

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
from nodes.handling.guided_motion import HORIZON_S, GuidedMotion, Standing
from nodes.handling.robot import HandlingError, Robot, in_words
from nodes.ros_process import spin_until_done

TRAJECTORY: Final = "joint_trajectory_controller/JointTrajectoryController"
FORWARD: Final = (
    "forward_command_controller/ForwardCommandController",
    "position_controllers/JointGroupPositionController",
)
GRIPPER: Final = "/GripperActionController"
"""The end of the types whose goals can be cancelled, and that are not moved by hand."""
SLOW: Final = 0.25
"""rad/s, and m/s: see ``fastest``."""
SHARE: Final = 0.1
"""Of a joint's velocity limit at the most."""
FRESH_S: Final = 0.5
"""A measurement that is older is none to begin from."""
ANSWER_S: Final = 5.0
LISTEN_S: Final = 0.1
"""So long it listens before a motion begins: a goal of somebody else must not be overridden."""
AT_ONCE: Final = 4
"""Number of messages that are taken without waiting."""
REFRESH_S: Final = 0.2
"""Time between two questions about which controllers are active, in seconds."""
RUNNING: Final = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING)


@dataclass(slots=True)
class _Moved:
    """A controller with its joints, and what is published to it."""

    joints: tuple[str, ...]
    publisher: Publisher
    trajectories: bool
    motion: GuidedMotion | None = None
    said_s: float = 0.0
    cancel: Client | None = None
    busy: bool = False
    """Whether a goal of somebody is under way, as was said last."""
    status: str = ""
    """The topic on which it is said."""
    said_by: frozenset[bytes] = frozenset()
    """Who could have said it: a stack that was killed says no more that its goals have ended."""


class RobotClient:
    """Jogs joints and approaches poses, slowly and within their limits. One thread, which spins ``executor``.

    ``jog`` and ``approach`` are called ten times a second and more, each time for a little way: 0.3 s after the last
    call the joints are at rest, also where this process was killed. Raises HandlingError where a joint cannot be moved.
    """

    def __init__(
        self, node: Node, executor: SingleThreadedExecutor, robot: Robot, now: Callable[[], float] = monotonic
    ) -> None:
        self._node, self._executor, self._robot, self._now = node, executor, robot, now
        self._known: dict[str, _Moved] = {}
        """All that have been active since the beginning."""
        self._controllers: dict[str, _Moved] = {}
        self._grippers: dict[str, Client] = {}
        self._inactive: dict[str, str] = {}
        """The inactive controllers that could move a joint, by joint."""
        self._listing: Future | None = None
        """The question which controllers are active, that was asked last and has not been answered."""
        self._listed_s = -math.inf
        """When that was asked."""
        self._listens_since_s = self._listened_s = -math.inf
        """Since when this client has taken what others publish, without a gap, and when it last did."""
        self._list = node.create_client(ListControllers, "/controller_manager/list_controllers")

    @property
    def driven(self) -> dict[str, tuple[str, ...]]:
        """The joints that each active controller moves."""
        return {name: one.joints for name, one in self._controllers.items()}

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that can be moved, as far as their controllers are active."""
        return tuple(joint for joints in self.driven.values() for joint in joints)

    @property
    def found(self) -> bool:
        """Whether a stack is there, so that ``connect`` need not wait for one."""
        return bool(self._list.service_is_ready())

    def connect(self) -> None:
        """Look for the active controllers. Raises HandlingError where there are none, or nobody answers."""
        if not self._list.wait_for_service(ANSWER_S):
            raise HandlingError("no stack answers under ROS: is `servoloop up` running, with the same ROS_DOMAIN_ID?")
        answer = self._list.call_async(ListControllers.Request())
        if not spin_until_done(self._executor, answer, ANSWER_S):
            raise HandlingError(f"the controller manager did not answer within {ANSWER_S:.0f} s")
        self._take(answer.result())
        if not self._controllers:
            raise HandlingError("no controller that moves joints is active: activate one, or start the stack anew")

    def listen(self) -> None:
        """Take what others have published, between motions: called often, a motion then begins without a delay."""
        self._refresh()
        self._listen(0.0)

    def _refresh(self) -> None:
        """Ask which controllers are active, and take the answer when it has come; never waits."""
        now_s = monotonic()
        if self._listing is not None and self._listing.done():
            listing, self._listing = self._listing, None
            if listing.exception() is None:
                self._take(listing.result())
        if now_s - self._listed_s > (REFRESH_S if self._listing is None else ANSWER_S):
            self._listed_s, self._listing = now_s, self._list.call_async(ListControllers.Request())

    def _take(self, answer: ListControllers.Response) -> None:
        """Note the active controllers. One that is no more active has lost its motion."""
        active = [one for one in answer.controller if one.state == "active"]
        self._inactive = {
            joint: one.name
            for one in answer.controller
            if one.state == "inactive" and one.type in (TRAJECTORY, *FORWARD)
            for joint in _joints_of(one)
        }
        for one in active:
            if one.type.endswith(GRIPPER) and one.name not in self._grippers:
                service = f"/{one.name}/gripper_cmd/_action/cancel_goal"
                self._grippers[one.name] = self._node.create_client(CancelGoal, service)
            if one.name not in self._known and (made := self._made(one)):
                self._known[one.name] = made
                self._listened_s = -math.inf  # it may have a goal under way
        self._controllers = {one.name: self._known[one.name] for one in active if one.name in self._known}
        for name in self._known.keys() - self._controllers.keys():
            self._known[name].motion = None

    def fastest(self, joint: str) -> float:
        """The velocity (rad/s, m/s) of a joint at full speed."""
        return min(SLOW, SHARE * self._robot.limits[joint].velocity)

    def jog(self, joint: str, share: float) -> None:
        """Turn a joint on a little, at this share (-1 to 1) of its full speed."""
        self.listen()
        name, one = self._of(joint)
        motion, passed_s, at = self._begin(name, one)
        velocity = np.zeros(len(one.joints))
        velocity[one.joints.index(joint)] = np.clip(share, -1.0, 1.0) * self.fastest(joint)
        motion.go(velocity, passed_s, at)
        self._send(one, motion)

    def approach(self, pose: Mapping[str, float], share: float = 1.0) -> bool:
        """Go on a little towards a pose (rad or m by joint), at this share of full speed; whether all is there."""
        self.listen()
        if missing := sorted(pose.keys() - set(self.joints)):
            raise HandlingError(self._not_moved(missing))
        there = True
        for name, one in self._controllers.items():
            if not any(joint in pose for joint in one.joints):
                continue
            motion, passed_s, at = self._begin(name, one)
            target = np.array([pose.get(joint, here) for joint, here in zip(one.joints, motion.set_point, strict=True)])
            there &= motion.go_to(target, passed_s * min(1.0, max(0.0, share)), at)
            self._send(one, motion)
        return there

    def stop(self) -> None:
        """Cancel every goal of everybody's. What this client moves rests by itself."""
        trajectories = (one.cancel for one in self._known.values() if one.cancel is not None)
        for cancel in (*trajectories, *self._grippers.values()):
            cancel.call_async(CancelGoal.Request())

    def _made(self, state: ControllerState) -> _Moved | None:
        joints = _joints_of(state)
        if any("/" in joint for joint in joints):
            return None
        if state.type == TRAJECTORY:
            publisher = self._node.create_publisher(JointTrajectory, f"/{state.name}/joint_trajectory", 1)
            made = _Moved(joints, publisher, True)
            action = f"/{state.name}/follow_joint_trajectory/_action"
            made.status = f"{action}/status"
            made.cancel = self._node.create_client(CancelGoal, f"{action}/cancel_goal")

            def heard(message: GoalStatusArray) -> None:
                made.busy = any(goal.status in RUNNING for goal in message.status_list)
                made.said_by = self._publishers(made.status)

            self._node.create_subscription(GoalStatusArray, made.status, heard, qos_profile_action_status_default)
            return made
        if state.type in FORWARD:
            return _Moved(joints, self._node.create_publisher(Float64MultiArray, f"/{state.name}/commands", 1), False)
        return None

    def _of(self, joint: str) -> tuple[str, _Moved]:
        for name, one in self._controllers.items():
            if joint in one.joints:
                return name, one
        raise HandlingError(self._not_moved([joint]))

    def _not_moved(self, joints: Sequence[str]) -> str:
        """Why no active controller moves these joints, and what to do."""
        inactive = dict.fromkeys(self._inactive[joint] for joint in joints if joint in self._inactive)
        advice = f"activate {', '.join(inactive)}" if inactive else "activate one that does"
        return f"no active controller moves {', '.join(joints)}: {advice}"

    def _begin(self, name: str, one: _Moved) -> tuple[GuidedMotion, float, Standing]:
        """A controller's motion, from where its joints stand where none is under way; the time passed, and where."""
        now_s = self._now()
        passed_s, one.said_s = now_s - one.said_s, now_s
        begins = one.motion is None or passed_s > HORIZON_S
        if begins:
            self._listen(self._unheard_s())
        if one.busy and self._still_said(one):
            one.motion = None
            raise HandlingError(f"{name} has a goal under way: stop it first")
        now = self._robot.joints_now()
        if not now.age_s <= FRESH_S:
            one.motion = None
            raise HandlingError("the joints' positions are old: does the stack still run?")
        if wrong := in_words({joint: now.faults[joint] for joint in one.joints if joint in now.faults}):
            one.motion = None
            raise HandlingError(wrong)
        at = Standing(_array(now.commanded, one.joints), _array(now.measured, one.joints))
        if one.motion is None or begins:
            limits = [self._robot.limits[joint] for joint in one.joints]
            lower, upper = np.array([one.lower for one in limits]), np.array([one.upper for one in limits])
            one.motion = GuidedMotion(
                at.commanded, lower, upper, np.array([self.fastest(joint) for joint in one.joints])
            )
            passed_s = 0.0
        return one.motion, passed_s, at

    def _still_said(self, one: _Moved) -> bool:
        """Whether the stack that said so is still there, and none has begun since."""
        now = self._publishers(one.status)
        one.said_by = one.said_by or now  # what is heard may be known to the graph a moment later
        one.busy = bool(now) and now <= one.said_by
        return one.busy

    def _publishers(self, topic: str) -> frozenset[bytes]:
        return frozenset(bytes(one.endpoint_gid) for one in self._node.get_publishers_info_by_topic(topic))

    def _unheard_s(self) -> float:
        """Time that this client must still listen before it has seen all goals under way."""
        now_s = monotonic()
        since_s = self._listens_since_s if now_s - self._listened_s <= LISTEN_S else now_s
        return max(0.0, LISTEN_S - (now_s - since_s))

    def _listen(self, seconds: float) -> None:
        """Hear whose goals are under way."""
        now_s = monotonic()
        if now_s - self._listened_s > LISTEN_S:
            self._listens_since_s = now_s
        until_s = now_s + seconds
        for _ in range(AT_ONCE):
            self._executor.spin_once(timeout_sec=0.0)
        while monotonic() < until_s:
            self._executor.spin_once(timeout_sec=0.02)
        self._listened_s = monotonic()

    def _send(self, one: _Moved, motion: GuidedMotion) -> None:
        set_point = motion.set_point.tolist()
        if one.trajectories:
            point = JointTrajectoryPoint(positions=set_point, time_from_start=Duration(nanosec=int(HORIZON_S * 1e9)))
            one.publisher.publish(JointTrajectory(joint_names=list(one.joints), points=[point]))
        else:  # the newest command is held
            one.publisher.publish(Float64MultiArray(data=set_point))


def _joints_of(state: ControllerState) -> tuple[str, ...]:
    """The joints that a controller commands."""
    return tuple(interface.removesuffix("/position") for interface in state.required_command_interfaces)


def _array(positions: Mapping[str, float], joints: tuple[str, ...]) -> FloatArray:
    array = np.array([positions.get(joint, np.nan) for joint in joints])
    if not np.isfinite(array).all():
        raise HandlingError("not all joints have been measured")
    return array
