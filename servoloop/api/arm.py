"""Control a real or virtual arm from a program without ROS: motions, streams, gripper, state and torque."""

import math
import os
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, overload

from hal.types import JointLimits
from servoloop.api.arm_errors import ArmInputError, ArmSetupError
from servoloop.api.backend import ArmBackend, ArmState, MotionGoal, Observer
from servoloop.api.checks import (
    check_boolean,
    check_joints,
    checked_goal,
    checked_number,
    checked_path,
    checked_ports,
    checked_timeout,
)
from servoloop.api.gripper import ArmGripper
from servoloop.api.motion import ArmMotion, TargetStream
from servoloop.api.targets import Positions, approach_s, by_joint, duration_of, goal_of, pose_named
from servoloop.api.trajectory import ArmTrajectory, PlannedTrajectory

if TYPE_CHECKING:
    from controller.interface import Controller, ControllerType
    from servoloop.api.planning.arm_planner import ArmPlanner
    from servoloop.api.planning.arm_scene import ArmScene
    from servoloop.api.planning.pose import ArmPose

STREAM_AGE_S = 0.2
"""Default maximum time between two streamed targets, in seconds, which is six periods of a policy that runs at 30
Hz."""
BACKLASH_DEG = 1.0
"""Default backlash of virtual servos, in degrees."""


class Arm:
    """An arm whose control loop runs in a separate thread of this program.

    The arm is active when the constructor returns: its torque is enabled and it holds its position. Use ``Arm`` as a
    context manager, or call ``close``. The arm then stops within its limits, and either holds its position or parks, as
    its robot file specifies. Signals that terminate the program shut the arm down in the same way. All methods may be
    called from any thread.
    """

    def __init__(
        self,
        name_or_folder: str | Path,
        port: str | Sequence[str] | None = None,
        *,
        rate_hz: int | None = None,
        controllers: str | Path | None = None,
        record: str | Path | None = None,
    ) -> None:
        """Start an arm.

        Args:
            name_or_folder: Name of an arm listed by ``servoloop arms``, or the path of an arm folder.
            port: Serial port of the servos, such as ``/dev/ttyACM0``, or ``NAME=PATH`` for each of several buses. If
                None, virtual servos run in a separate process.
            rate_hz: Rate of the control loop, from 1 to 1000 Hz. If None, the rate in the controllers file is used.
            controllers: Controllers file to use instead of the arm's own.
            record: Path of a new recording of the whole run, if any.

        Raises:
            ArmSetupError: The arm does not exist, its files are invalid, its port cannot be opened, or its servos
                cannot be activated safely.
        """
        from servoloop.api.options import ArmOptions
        from servoloop.api.thread_loop import ThreadLoop

        options = ArmOptions(_source(name_or_folder), rate_hz, *_paths(controllers, record))
        loop = ThreadLoop(options.files(), checked_ports(port), options.record)
        self._use(loop.backend, loop.close, options.arm)

    @classmethod
    def simulated(
        cls,
        name_or_folder: str | Path,
        *,
        seed: int | None = None,
        rate_hz: int | None = None,
        controllers: str | Path | None = None,
        record: str | Path | None = None,
        backlash_deg: float = BACKLASH_DEG,
    ) -> Self:
        """Start a virtual arm in simulated time.

        Time passes only while the program waits: in ``move_to``, ``ArmMotion.wait``, ``sleep`` and ``step``. The cycles
        then run as fast as possible, in the calling thread. The same program produces the same result in every run.

        Args:
            name_or_folder: Name or folder of the arm.
            seed: Random seed for variations of up to 10 % in friction, motors, masses and supply voltage. If
                None, the nominal arm is used.
            rate_hz: Rate of the control loop, from 1 to 1000 Hz. If None, the rate in the controllers file is used.
            controllers: Controllers file to use instead of the arm's own.
            record: Path of a new recording of the whole run, if any.
            backlash_deg: Backlash of each servo, in degrees.

        Raises:
            ArmSetupError: The arm does not exist, its files or an argument are invalid, or its servos cannot be
                activated.
        """
        from servoloop.api.options import ArmOptions
        from servoloop.api.simulated_loop import SimulatedLoop

        options = ArmOptions(_source(name_or_folder), rate_hz, *_paths(controllers, record))
        arm = cls.__new__(cls)
        loop = SimulatedLoop(options.files(), options.record, seed, backlash_deg)
        arm._use(loop.backend, loop.close, options.arm)
        return arm

    @classmethod
    def connect(cls, arm: str | os.PathLike[str] | int | None = None, *, namespace: str | None = None) -> Self:
        """Attach to an arm whose control loop runs in ``servoloop up`` on this machine.

        The arm keeps running after ``close``, but this program's motions stop within the arm's limits. Only one program
        at a time can move the arm. From its first motion until ``close``, this program has control of the arm. All
        durations are in real time.

        Args:
            arm: Name, folder or process ID of the running arm. If None, any arm is accepted.
            namespace: ROS namespace of the running stack, such as ``left``. If None, any namespace is accepted.

        Raises:
            ArmSetupError: No matching arm or more than one is running, or the namespace is invalid.
        """
        from servoloop.api.socket_backend import SocketBackend

        connected = cls.__new__(cls)
        backend = SocketBackend.find(None if arm is None else str(arm), namespace)
        connected._use(backend, backend.close, str(backend.description.folder or backend.description.name))
        return connected

    def _use(self, backend: ArmBackend, close: Callable[[], None], source: str) -> None:
        self._backend, self._close, self._arm = backend, close, backend.description
        self._source = source
        self._own_planner: ArmPlanner | None = None
        self.gripper = ArmGripper(self._arm, self.move_to)
        """Gripper of the arm."""

    @property
    def name(self) -> str:
        """Name of the arm."""
        return self._arm.name

    @property
    def folder(self) -> Path | None:
        """Folder of the arm, with its named poses and motions, or None if the files are not from an arm folder."""
        return self._arm.folder

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the n joints, in the order used by all arrays and mappings."""
        return self._arm.joints

    @property
    def limits(self) -> Mapping[str, JointLimits]:
        """Limits of each joint, in rad or m and seconds, keyed by joint name."""
        return self._arm.limits

    @property
    def rate_hz(self) -> float:
        """Rate of the control loop, in Hz."""
        return 1.0 / self._arm.period_s

    @property
    def state(self) -> ArmState:
        """Latest state: the position, velocity, effort, temperature, command and faults of each joint, and the age of
        the state."""
        return self._backend.state()

    @property
    def faults(self) -> Mapping[str, str]:
        """Sentences that describe faults and alarms, keyed by joint name, or empty if there are none."""
        return self.state.faults

    @property
    def scene(self) -> "ArmScene":
        """Obstacles around the arm, used by ``plan``, ``follow`` and ``move_to(pose=...)``."""
        return self._planner.scene

    def pose(self, tool: str | None = None) -> "ArmPose":
        """Return the measured pose of a link or site, by default the arm's tool, in the base frame."""
        return self._planner.pose(tool)

    def move_to(
        self,
        target: Positions | str | None = None,
        *,
        pose: "ArmPose | None" = None,
        duration: float | None = None,
        speed: float | None = None,
        wait: bool = True,
        timeout: float = math.inf,
    ) -> ArmMotion:
        """Move to a target, and wait until the arm reaches the target. A running motion blends into the new motion.

        Args:
            target: Positions keyed by joint name, an array with one position for each of ``joints``, in rad or m, or
                the name of a saved pose. Other joints do not move. A motion to joint positions ignores obstacles.
            pose: Tool pose to use instead of a target. The motion is planned around the obstacles of ``scene``.
            duration: Duration of the motion, in seconds. The joint limits may make the motion take longer.
            speed: Fraction of the velocity limits to use instead of a duration, above 0 and at most 1. Default: 0.25.
            wait: Whether to wait until the motion ends.
            timeout: Maximum time to wait, in seconds.

        Returns:
            Handle that the program can use to wait for, await or cancel the motion.

        Raises:
            ArmInputError: A joint or a pose does not exist, or a value is not finite or outside the limits. The arm
                does not move.
            PlanFailedError: No motion to ``pose`` was found. The arm does not move.
            ArmBusyError: A stream is open, the torque is off, or another controller drives the joint.
            MotionFailedError: The motion stopped before it reached its target.
            ArmTimeoutError: The motion takes longer than ``timeout``. The arm keeps moving.
            ArmEndedError: The control loop has ended.
        """
        asked_s, share = duration_of(duration, speed)
        if (target is None) == (pose is None) or (pose is not None and duration is not None):
            raise ArmInputError("pass either a target or a pose; a duration cannot be combined with a pose")
        if pose is not None:
            return self.follow(self.plan(pose, speed=share), wait=wait, timeout=timeout)
        assert target is not None
        positions = pose_named(target, self._arm) if isinstance(target, str) else by_joint(target, self._arm)
        goal = checked_goal(MotionGoal(tuple(positions), (asked_s or 1.0,), (tuple(positions.values()),)), self._arm)
        if asked_s is None:
            planned_s = approach_s(positions, self.state.command, self.limits, share)
            goal = MotionGoal(goal.joints, (planned_s,), goal.positions)
        return self._started(goal, wait, timeout)

    def plan(
        self, goal: "Positions | str | ArmPose", *, speed: float = 0.25, time_limit_s: float = 5.0
    ) -> PlannedTrajectory:
        """Plan a motion from the measured state around the obstacles of ``scene``, without moving the arm.

        Args:
            goal: Positions of the arm's joints without the gripper, as for ``move_to``, or a tool pose.
            speed: Fraction of the velocity and acceleration limits, above 0 and at most 1.
            time_limit_s: Maximum search time, in seconds.

        Returns:
            A trajectory for ``follow``.

        Raises:
            ArmSetupError: The ``planning`` extra is not installed.
            ArmInputError: A joint or a named pose does not exist, a value is not finite, or ``time_limit_s`` is not
                above 0.
            PlanFailedError: The start or the goal is not feasible, or no path was found in time.
        """
        from servoloop.api.planning.pose import ArmPose

        _, share = duration_of(None, speed)
        if isinstance(goal, ArmPose):
            return self._planner.plan(goal, share, time_limit_s)
        positions = pose_named(goal, self._arm) if isinstance(goal, str) else by_joint(goal, self._arm)
        check_joints(positions, self._arm)
        return self._planner.plan(positions, share, time_limit_s)

    def attach(self, name: str, link: str | None = None, touch_links: Sequence[str] | None = None) -> None:
        """Attach a ``scene`` object, such as a cube in the gripper, to a link, so that the object moves with the link.

        Args:
            name: Name of the object.
            link: Link that carries the object. If None, the object is attached to the last link of the arm, which
                carries the gripper.
            touch_links: Links that may touch the object. If None, the link that carries the object and all links after
                it may touch the object.

        Raises:
            PlanFailedError: The object or a link does not exist.
        """
        self.scene.attach(name, link, touch_links)

    def detach(self, name: str) -> None:
        """Detach an object and leave it at its current position. Raises PlanFailedError if the object is not
        attached."""
        self.scene.detach(name)

    def follow(
        self, trajectory: ArmTrajectory, *, approach: float = 0.25, wait: bool = True, timeout: float = math.inf
    ) -> ArmMotion:
        """Follow a trajectory. The arm first moves to the trajectory's first point.

        Args:
            trajectory: Trajectory for some or all joints. A trajectory from ``plan`` is rejected if the arm is no
                longer at the start of the trajectory, or if an obstacle now blocks the path.
            approach: Fraction of the velocity limits on the way to the first point, above 0 and at most 1.
            wait: Whether to wait for the end of the motion.
            timeout: Maximum time to wait, in seconds.

        Returns:
            Handle for the motion.

        Raises:
            ArmInputError: The trajectory is invalid or exceeds the limits. The arm does not move.
            PlanFailedError: The trajectory was planned for a different start or scene. The arm does not move.
            ArmBusyError: A stream is open, the torque is off, or another controller drives a joint.
            MotionFailedError: The motion stopped before it reached its target.
            ArmTimeoutError: The motion takes longer than ``timeout`` and continues.
            ArmEndedError: The control loop has ended.
        """
        _, share = duration_of(None, approach)
        goal = checked_goal(goal_of(trajectory, 0.0), self._arm)
        if isinstance(trajectory, PlannedTrajectory):
            self._planner.check(trajectory)
        first = dict(zip(goal.joints, goal.positions[0], strict=True))
        needed_s = approach_s(first, self.state.command, self.limits, share)
        return self._started(goal_of(trajectory, max(0.0, needed_s - goal.times_s[0])), wait, timeout)

    @overload
    def stream(self, targets: None = None, *, max_age: float = ..., rate_hz: float | None = ...) -> TargetStream: ...

    @overload
    def stream(self, targets: Iterable[Positions], *, max_age: float = ..., rate_hz: float | None = ...) -> None: ...

    def stream(
        self,
        targets: Iterable[Positions] | None = None,
        *,
        max_age: float = STREAM_AGE_S,
        rate_hz: float | None = None,
    ) -> TargetStream | None:
        """Follow targets that the program computes at its own rate, for example with a policy at 30 to 50 Hz.

        The arm moves toward the latest target within its velocity and acceleration limits, and holds its position at
        the last target. If no target arrives for ``max_age`` seconds, the stream ends. The joints then slow down within
        their limits and hold their positions.

        Args:
            targets: Targets to send, one after another. If None, the method returns an open stream, through which
                the program sends targets.
            max_age: Maximum time between two targets, in seconds.
            rate_hz: Rate at which ``targets`` are sent, in Hz. If None, each target is sent as soon as the iterator
                yields it. Use None if the iterator controls its own rate.

        Returns:
            The open stream, which is a context manager, or None after all ``targets`` were sent.

        Raises:
            ArmInputError: A target is invalid.
            ArmBusyError: A motion is running, another stream is open, or the torque is off.
            StreamEndedError: The targets arrived too slowly.
            ArmEndedError: The control loop has ended.
        """
        rate = None if rate_hz is None else checked_number("rate_hz", rate_hz)
        if rate is not None and not rate > 0.0:
            raise ArmInputError(f"rate_hz must be above 0, not {rate:g}")
        age_s = checked_number("max_age", max_age)
        stream = TargetStream(self._backend, lambda positions: by_joint(positions, self._arm), age_s)
        if targets is None:
            return stream
        with stream:
            for target in targets:
                stream.send(target)
                if rate is not None:
                    self.sleep(1.0 / rate)
        return None

    def stop(self) -> None:
        """Stop all motions, and end any stream and freedrive.

        The joints slow down within their limits and hold their positions.
        """
        self._backend.stop()

    def torque(self, on: bool, *, park: bool = True) -> None:
        """Enable or disable the torque of all servos.

        Args:
            on: Whether to enable the torque. If True, each servo then holds its current position.
            park: Whether to move to the park pose of the robot file before the torque is disabled, so that the arm does
                not drop. If False, support the arm by hand.

        Raises:
            ArmInputError: ``on`` or ``park`` is not a Boolean.
            MotionFailedError: The park pose was not reached. The torque stays enabled.
            ArmError: A servo does not respond or cannot be activated safely.
        """
        check_boolean("on", on)
        check_boolean("park", park)
        self._backend.set_torque(on, park)

    @contextmanager
    def freedrive(self) -> Iterator[None]:
        """Let a person move the joints by hand for the duration of the context.

        The servos carry most of the arm's weight, and each joint resists motion like a slipping brake. When the context
        ends, each joint holds the position at which it was left. Calling ``stop`` from another thread also ends the
        freedrive.

        Raises:
            ArmBusyError: A motion is running, a stream is open, the torque is off, or another program moves the arm.
            ArmError: The stiffness or the weight of the arm is unknown, or a servo does not respond. When the context
                ends, the message names the servos whose torque limits are still reduced.
        """
        self._backend.begin_freedrive()
        try:
            yield
        finally:
            self._backend.end_freedrive()

    def controller(
        self, kind: "ControllerType", name: str = "own_controller", **parameters: Any
    ) -> "AbstractContextManager[Controller]":
        """Let your own controller drive its joints for the duration of the context.

        Args:
            kind: Class of the controller, with the interface of ``controller.interface.ControllerType``.
            name: Name of the controller.
            **parameters: Parameters for the controller.

        Returns:
            Context manager that yields the controller. The previous controllers become active again after the context.

        Raises:
            ArmInputError: The parameters are invalid, or the control loop runs in another program.
            ArmBusyError: A stream is open, the torque is off, or the controller cannot be activated.
        """
        start = getattr(self._backend, "controller", None)
        if start is None:
            raise ArmInputError(
                "your own controller must run in the control loop's process: use Arm(...) instead of Arm.connect(...)"
            )
        started: AbstractContextManager[Controller] = start(name, kind, parameters)
        return started

    def record(self, path: str | Path) -> AbstractContextManager[None]:
        """Record all cycles in a new MCAP file for the duration of the context.

        Raises ArmInputError if the file exists or cannot be created.
        """
        return self._backend.record(Path(path))

    def on_state(self, callback: Observer) -> Callable[[], None]:
        """Call a function with the latest state after each cycle.

        All calls are made by a single thread of the arm or, in simulated time, by the waiting thread. If a call takes
        longer than a cycle, the function misses states.

        Args:
            callback: Function that receives the state.

        Returns:
            Function that ends the calls.
        """
        return self._backend.observe(callback)

    async def states(self) -> AsyncIterator[ArmState]:
        """Yield the latest state after each cycle, in a coroutine. Raises ArmEndedError."""
        last_s = -math.inf
        while True:
            await self._backend.wait_async(self._measured_after(last_s), math.inf)
            state = self.state
            last_s = state.time_s
            yield state

    def sleep(self, seconds: float) -> None:
        """Wait for a number of seconds on the arm's clock. In simulated time, this call runs the arm's cycles.

        Raises ArmEndedError if the control loop ends.
        """
        seconds = checked_number("seconds", seconds)
        if seconds > 0.0:
            self._backend.wait(lambda: False, seconds)

    def step(self, cycles: int = 1) -> ArmState:
        """Wait for a number of cycles. In simulated time, exactly this number of cycles is run.

        Returns:
            The state after the last cycle.

        Raises:
            ArmEndedError: The control loop has ended.
        """
        for _ in range(cycles):
            self._backend.wait(self._measured_after(self.state.time_s), math.inf)
        return self.state

    def clip(self, target: Positions) -> dict[str, float]:
        """Return a target in which each position is clipped to the limits of its joint.

        Args:
            target: Positions keyed by joint name, or an array of positions, in rad or m.

        Returns:
            Positions keyed by joint name.

        Raises:
            ArmInputError: A joint is unknown, or the array has the wrong size.
        """
        positions = by_joint(target, self._arm)
        check_joints(positions, self._arm)
        return {j: min(max(at, self.limits[j].lower), self.limits[j].upper) for j, at in positions.items()}

    def close(self) -> None:
        """Stop the arm. The arm then holds its position, or parks and disables the torque, as its robot file specifies.

        A second call has no effect. Raises ArmError if a shutdown step fails.
        """
        self._close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def _planner(self) -> "ArmPlanner":
        """Planner of the arm, created on first use."""
        from servoloop.extras import missing_extras

        if self._own_planner is None:
            if sentence := missing_extras("motion planning", "planning"):
                raise ArmSetupError(sentence)
            from servoloop.api.planning.arm_planner import ArmPlanner

            self._own_planner = ArmPlanner(self._source, self.limits, lambda: self.state)
        return self._own_planner

    def _measured_after(self, time_s: float) -> Callable[[], bool]:
        return lambda: self.state.time_s > time_s

    def _started(self, goal: MotionGoal, wait: bool, timeout_s: float) -> ArmMotion:
        timeout_s = checked_timeout(timeout_s)
        motion = ArmMotion(self._backend, self._backend.start(goal))
        if wait:
            motion.wait(timeout_s)
        return motion


def _source(name_or_folder: object) -> str:
    if not isinstance(name_or_folder, str | Path):
        raise ArmSetupError(f"name_or_folder must be a name or a path, not {name_or_folder!r}: see `servoloop arms`")
    return str(name_or_folder)


def _paths(controllers: object, record: object) -> tuple[Path | None, Path | None]:
    return (
        None if controllers is None else checked_path("controllers", controllers),
        None if record is None else checked_path("record", record),
    )
