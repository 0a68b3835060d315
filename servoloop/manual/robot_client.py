"""Move the joints of a running stack manually, through its controllers and over its command socket."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import monotonic
from typing import Any, Final

import numpy as np

from controller.guided_motion import HORIZON_S, GuidedMotion, JointPositions
from hal.types import FloatArray
from servoloop.command_socket.client import CommandClient
from servoloop.command_socket.command_errors import CommandError
from servoloop.manual.joints_now import HandlingError, MovableRobot, describe_faults

TRAJECTORY: Final = "joint_trajectory_controller/JointTrajectoryController"
FORWARD: Final = (
    "forward_command_controller/ForwardCommandController",
    "position_controllers/JointGroupPositionController",
)
SLOW: Final = 0.25
"""Maximum velocity of manual motion, in rad/s or m/s."""
SHARE: Final = 0.1
"""Maximum velocity of manual motion, as a fraction of the joint's velocity limit."""
FRESH_S: Final = 0.5
"""Maximum age of a measurement at which a motion may start, in seconds."""
REFRESH_S: Final = 0.2
"""Interval between requests for the controller list, in seconds."""
RELEASE_S: Final = 0.5
"""Time after the last command until other clients may move the arm, in seconds."""


@dataclass(slots=True)
class _DrivenController:
    """Active controller, its joints and the motion of these joints."""

    joints: tuple[str, ...]
    busy: bool = False
    """Whether a goal of another client is running."""
    motion: GuidedMotion | None = None
    commanded_s: float = 0.0


class RobotClient:
    """Client that jogs joints and moves them to poses, slowly and within limits.

    All calls must come from one thread. Each call to ``jog`` or ``approach`` moves a short distance, so call these
    methods at least ten times per second. The joints stop within 0.3 s after the last call, even if this process is
    killed. Methods raise HandlingError if a joint cannot be moved, and CommandError if the connection has been closed.
    """

    def __init__(self, commands: CommandClient, robot: MovableRobot, now: Callable[[], float] = monotonic) -> None:
        self._commands, self._robot, self._now = commands, robot, now
        self._controllers: dict[str, _DrivenController] = {}
        self._inactive: dict[str, str] = {}
        """Inactive controllers that could move the joints, keyed by joint name."""
        self._listed_s = self._commanded_s = -float("inf")
        self._owns = False
        """Whether this client has control of the arm."""

    @property
    def driven(self) -> dict[str, tuple[str, ...]]:
        """Joints of each active controller, keyed by controller name."""
        return {name: controller.joints for name, controller in self._controllers.items()}

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints that can be moved, because their controllers are active."""
        return tuple(joint for joints in self.driven.values() for joint in joints)

    def connect(self) -> None:
        """Find the active controllers. Raises HandlingError if none of the active controllers moves joints."""
        self._refresh()
        if not self._controllers:
            raise HandlingError(
                "no controller that moves joints is active: activate such a controller, or restart the stack"
            )

    def listen(self) -> None:
        """Receive messages between motions, and release control to other clients after a pause."""
        if any(event["event"] == "lost" for event in self._commands.events()):
            self._owns = False
        if self._owns and self._now() - self._commanded_s > RELEASE_S:
            self._owns = False
            self._commands.request("release")
        if self._now() - self._listed_s > REFRESH_S:
            self._refresh()

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
        self._send(name, controller, motion, [joint])

    def approach(self, pose: Mapping[str, float], share: float = 1.0) -> bool:
        """Move a short distance toward a pose.

        Args:
            pose: Target positions in rad or m, keyed by joint name.
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
        for name, controller in tuple(self._controllers.items()):
            moved = [joint for joint in controller.joints if joint in pose]
            if not moved:
                continue
            motion, passed_s, at = self._begin(name, controller)
            target = np.array(
                [pose.get(joint, here) for joint, here in zip(controller.joints, motion.set_point, strict=True)]
            )
            reached &= motion.go_to(target, passed_s * min(1.0, max(0.0, share)), at)
            self._send(name, controller, motion, moved)
        return reached

    def stop(self) -> None:
        """Stop all motions of all clients."""
        self._owns = False
        self._commands.request("stop")

    def _refresh(self) -> None:
        """Request the list of controllers. Discard the motions of controllers that are no longer active."""
        self._listed_s = self._now()
        listed = [_Listed.of(one) for one in self._commands.request("controllers")["controllers"]]
        movers = [one for one in listed if one.kind in (TRAJECTORY, *FORWARD) and one.positions]
        self._inactive = {joint: one.name for one in movers if one.state == "inactive" for joint in one.joints}
        known = self._controllers
        self._controllers = {
            one.name: known.get(one.name, _DrivenController(one.joints)) for one in movers if one.state == "active"
        }
        for one in movers:
            if one.name in self._controllers:
                self._controllers[one.name].busy = one.busy

    def _controller_of(self, joint: str) -> tuple[str, _DrivenController]:
        for name, controller in self._controllers.items():
            if joint in controller.joints:
                return name, controller
        raise HandlingError(self._no_controller([joint]))

    def _no_controller(self, joints: Sequence[str]) -> str:
        """Return an error message with a remedy for joints without an active controller."""
        inactive = dict.fromkeys(self._inactive[joint] for joint in joints if joint in self._inactive)
        advice = f"activate {', '.join(inactive)}" if inactive else "activate a controller that moves them"
        return f"no active controller moves {', '.join(joints)}: {advice}"

    def _begin(self, name: str, controller: _DrivenController) -> tuple[GuidedMotion, float, JointPositions]:
        """Return the motion of a controller, the time since its last command, and its joint positions.

        If no motion is running, a new motion starts at the commanded positions.
        """
        now_s = self._now()
        passed_s, controller.commanded_s = now_s - controller.commanded_s, now_s
        begins = controller.motion is None or passed_s > HORIZON_S
        try:
            return self._continued(name, controller, begins, passed_s)
        except HandlingError:
            controller.motion = None
            raise

    def _continued(
        self, name: str, controller: _DrivenController, begins: bool, passed_s: float
    ) -> tuple[GuidedMotion, float, JointPositions]:
        if begins:
            self._refresh()
            controller = self._controllers.get(name, controller)
        if controller.busy:
            raise HandlingError(f"{name} is executing a goal: stop the goal first")
        now = self._robot.joints_now()
        if not now.age_s <= FRESH_S:
            raise HandlingError("the joint positions are outdated: check that the stack is still running")
        if fault := describe_faults({joint: now.faults[joint] for joint in controller.joints if joint in now.faults}):
            raise HandlingError(fault)
        self._take()
        at = JointPositions(_array(now.commanded, controller.joints), _array(now.measured, controller.joints))
        if controller.motion is not None and not begins:
            return controller.motion, passed_s, at
        limits = [self._robot.limits[joint] for joint in controller.joints]
        lower, upper = np.array([limit.lower for limit in limits]), np.array([limit.upper for limit in limits])
        fastest = np.array([self.fastest(joint) for joint in controller.joints])
        controller.motion = GuidedMotion(at.commanded, lower, upper, fastest)
        return controller.motion, 0.0, at

    def _take(self) -> None:
        if not self._owns:
            self._ask("take")
            self._owns = True

    def _send(self, name: str, controller: _DrivenController, motion: GuidedMotion, joints: Sequence[str]) -> None:
        """Send the set point of a motion. ``joints`` are the joints that the user wants to move."""
        self._commanded_s = self._now()
        try:
            self._ask("set_point", controller=name, values=motion.set_point.tolist(), time_s=HORIZON_S)
        except HandlingError as error:
            controller.motion = None
            self._refresh()
            if name not in self._controllers:  # the controller was deactivated after the list was received
                raise HandlingError(self._no_controller(joints)) from error
            raise

    def _ask(self, op: str, **fields: Any) -> None:
        """Send a message. Raises HandlingError if the stack rejects the message."""
        try:
            self._commands.request(op, **fields)
        except CommandError as error:
            if error.kind == "ended":
                raise
            self._owns = self._owns and error.kind != "not_owner"
            raise HandlingError(str(error)) from error


@dataclass(frozen=True, slots=True)
class _Listed:
    """Controller in the list reported by the stack."""

    name: str
    kind: str
    state: str
    busy: bool
    joints: tuple[str, ...]
    positions: bool
    """Whether the controller commands only positions."""

    @classmethod
    def of(cls, fields: Mapping[str, Any]) -> "_Listed":
        interfaces = [str(name) for name in fields["interfaces"]]
        joints = tuple(name.removesuffix("/position") for name in interfaces)
        positions = all(name.endswith("/position") for name in interfaces)
        return cls(fields["name"], fields["type"], fields["state"], fields["busy"], joints, positions)


def _array(positions: Mapping[str, float], joints: tuple[str, ...]) -> FloatArray:
    array = np.array([positions.get(joint, np.nan) for joint in joints])
    if not np.isfinite(array).all():
        raise HandlingError("not all joints have been measured: check that all servos respond")
    return array
