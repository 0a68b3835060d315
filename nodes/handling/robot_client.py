"""A client of a running stack that moves its joints through their controllers, as long as somebody says so."""

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
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import qos_profile_action_status_default
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from hal.types import FloatArray
from nodes.handling.guided_motion import GuidedMotion, WayPoint
from nodes.handling.robot import HandlingError, Robot, Standing

TRAJECTORY: Final = "joint_trajectory_controller/JointTrajectoryController"
FORWARD: Final = ("forward_command_controller/ForwardCommandController", "position_controllers/")
SLOW: Final = 0.25
"""rad/s, and m/s: see ``fastest``."""
SHARE: Final = 0.1
"""Of a joint's velocity limit at the most."""
FRESH_S: Final = 0.5
"""A measurement that is older is none to begin from."""
SAID_S: Final = 0.5
"""A motion that nobody has said a word for is over: the next one begins where the joints stand."""
ANSWER_S: Final = 5.0
LISTEN_S: Final = 0.1
"""So long it listens before a motion begins: a goal of somebody else must not be overridden."""
RUNNING: Final = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING)


@dataclass(slots=True)
class _Moved:
    """A controller with its joints, and what is published to it."""

    joints: tuple[str, ...]
    publisher: Publisher
    trajectories: bool
    motion: GuidedMotion | None = None
    said_s: float = 0.0
    busy: bool = False
    """Whether a goal of somebody is under way."""


class RobotClient:
    """Jogs joints and approaches poses, slowly and within their limits. One thread, which spins ``executor``.

    ``jog`` and ``approach`` are called ten times a second and more, each time for a little way: 0.3 s after the last
    call the joints are at rest, also where this process was killed. Raises HandlingError where a joint cannot be moved.
    """

    def __init__(
        self, node: Node, executor: SingleThreadedExecutor, robot: Robot, now: Callable[[], float] = monotonic
    ) -> None:
        self._node, self._executor, self._robot, self._now = node, executor, robot, now
        self._controllers: dict[str, _Moved] = {}
        self._list = node.create_client(ListControllers, "/controller_manager/list_controllers")

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that can be moved, as far as their controllers are active."""
        return tuple(joint for one in self._controllers.values() for joint in one.joints)

    def connect(self) -> None:
        """Look for the active controllers. Raises HandlingError where there are none, or nobody answers."""
        if not self._list.wait_for_service(ANSWER_S):
            raise HandlingError("no stack answers under ROS: is `servoloop up` running, with the same ROS_DOMAIN_ID?")
        answer = self._list.call_async(ListControllers.Request())
        self._executor.spin_until_future_complete(answer, timeout_sec=ANSWER_S)
        if not answer.done():
            raise HandlingError(f"the controller manager did not answer within {ANSWER_S:.0f} s")
        active = [one for one in answer.result().controller if one.state == "active"]
        for one in active:
            if one.name not in self._controllers and (made := self._made(one)):
                self._controllers[one.name] = made
        for name in self._controllers.keys() - {one.name for one in active}:
            del self._controllers[name]
        if not self._controllers:
            raise HandlingError("no controller that moves joints is active: activate one, or start the stack anew")

    def fastest(self, joint: str) -> float:
        """The velocity (rad/s, m/s) of a joint at full speed."""
        return min(SLOW, SHARE * self._robot.limits[joint].velocity)

    def jog(self, joint: str, share: float) -> None:
        """Turn a joint on a little, at this share (-1 to 1) of its full speed."""
        name, one = self._of(joint)
        motion, passed_s = self._begin(name, one)
        velocity = np.zeros(len(one.joints))
        velocity[one.joints.index(joint)] = np.clip(share, -1.0, 1.0) * self.fastest(joint)
        motion.go(velocity, self.fastest(joint), passed_s)
        self._send(one, motion.way())

    def approach(self, pose: Mapping[str, float], share: float = 1.0) -> bool:
        """Go on a little towards a pose (rad or m by joint); whether all its joints are there."""
        there = True
        for name, one in self._controllers.items():
            if not (own := [joint for joint in one.joints if joint in pose]):
                continue
            motion, passed_s = self._begin(name, one)
            target = np.array([pose.get(joint, at) for joint, at in zip(one.joints, motion.position, strict=True)])
            fastest = share * min(self.fastest(joint) for joint in own)
            there &= motion.go_to(target, fastest, passed_s)
            self._send(one, motion.way())
        if missing := pose.keys() - set(self.joints):
            raise HandlingError(f"no active controller moves {', '.join(sorted(missing))}")
        return there

    def rest(self) -> None:
        """Bring what this client moves to rest at once."""
        for one in self._controllers.values():
            if one.motion is not None:
                self._send(one, one.motion.end())
                one.motion = None

    def stop(self) -> None:
        """Bring what this client moves to rest, and cancel every goal of everybody's."""
        self.rest()
        for name, one in self._controllers.items():
            if one.trajectories:
                client = self._node.create_client(CancelGoal, f"/{name}/follow_joint_trajectory/_action/cancel_goal")
                client.call_async(CancelGoal.Request())

    def _made(self, state: ControllerState) -> _Moved | None:
        joints = tuple(interface.removesuffix("/position") for interface in state.required_command_interfaces)
        if any("/" in joint for joint in joints):
            return None
        if state.type == TRAJECTORY:
            publisher = self._node.create_publisher(JointTrajectory, f"/{state.name}/joint_trajectory", 1)
            made = _Moved(joints, publisher, True)

            def heard(message: GoalStatusArray) -> None:
                made.busy = any(goal.status in RUNNING for goal in message.status_list)

            topic = f"/{state.name}/follow_joint_trajectory/_action/status"
            self._node.create_subscription(GoalStatusArray, topic, heard, qos_profile_action_status_default)
            return made
        if state.type.startswith(FORWARD):
            return _Moved(joints, self._node.create_publisher(Float64MultiArray, f"/{state.name}/commands", 1), False)
        return None

    def _of(self, joint: str) -> tuple[str, _Moved]:
        for name, one in self._controllers.items():
            if joint in one.joints:
                return name, one
        raise HandlingError(f"no active controller moves {joint}")

    def _begin(self, name: str, one: _Moved) -> tuple[GuidedMotion, float]:
        """The motion of a controller's joints, from where they stand where none is under way; and the time passed."""
        now_s = self._now()
        passed_s, one.said_s = now_s - one.said_s, now_s
        begins = one.motion is None or passed_s > SAID_S
        self._listen(LISTEN_S if begins else 0.0)
        if one.busy:
            one.motion = None
            raise HandlingError(f"{name} has a goal under way: stop it first")
        if one.motion is None or begins:
            standing = self._robot.standing()
            if not standing.age_s <= FRESH_S:
                raise HandlingError("the joints' positions are old: does the stack still run?")
            limits = [self._robot.limits[joint] for joint in one.joints]
            lower, upper = np.array([one.lower for one in limits]), np.array([one.upper for one in limits])
            one.motion = GuidedMotion(_positions(standing, one.joints), lower, upper)
            passed_s = 0.0
        return one.motion, passed_s

    def _listen(self, seconds: float) -> None:
        """Hear whose goals are under way."""
        until_s = monotonic() + seconds
        self._executor.spin_once(timeout_sec=0.0)
        while monotonic() < until_s:
            self._executor.spin_once(timeout_sec=0.02)

    def _send(self, one: _Moved, way: Sequence[WayPoint]) -> None:
        if one.trajectories:
            made = [_point(point) for point in way]
            one.publisher.publish(JointTrajectory(joint_names=list(one.joints), points=made))
        else:  # the newest command is held: it is the set point itself
            assert one.motion is not None
            one.publisher.publish(Float64MultiArray(data=one.motion.position.tolist()))


def _positions(standing: Standing, joints: tuple[str, ...]) -> FloatArray:
    position = np.array([standing.position.get(joint, np.nan) for joint in joints])
    if not np.isfinite(position).all():
        raise HandlingError("not all joints have been measured")
    return position


def _point(point: WayPoint) -> JointTrajectoryPoint:
    whole, part = divmod(round(point.time_s * 1e9), 1_000_000_000)
    return JointTrajectoryPoint(
        positions=point.position.tolist(),
        velocities=point.velocity.tolist(),
        time_from_start=Duration(sec=whole, nanosec=part),
    )
