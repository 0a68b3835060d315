"""Connection between an arm and the program that runs its control loop.

``ArmBackend`` defines every call that ``servoloop.Arm`` needs. Two classes implement it:

- ``StackBackend`` (servoloop/api/stack_backend.py) moves the arm of a ``ControlStack`` in the same process. This class
  does not have its own thread. A script runs the loop with ``OwnLoop``. ``servoloop up`` runs its own loop and creates
  a ``StackBackend`` for the clients of its socket. A server translates each message into one call to this class.
- ``SocketBackend`` (servoloop/api/socket_backend.py) is a client of this socket. The client sends each call as a
  message and keeps the latest state that it has received.

All goals and targets are plain data, so that they can be sent in messages. Every implementation raises the errors from
``servoloop.api.arm_errors``. A server sends an error's class name, message and joint, and its client raises the same
error again.

``StackBackend`` checks every goal, because a socket client may be written in another language. ``Arm`` only converts
its arguments into goals.
"""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from hal.types import JointLimits


@dataclass(frozen=True, slots=True)
class ArmState:
    """Measurements of all joints in one cycle. All mappings list the joints in the order of ``Arm.joints``.

    If a joint's servo did not respond in this cycle, the joint keeps its last known values and has an entry in
    ``faults``.
    """

    time_s: float
    """Time of the measurement on the clock of the control loop, in seconds."""
    age_s: float
    """Time from the measurement until this object was created, in seconds."""
    position: Mapping[str, float]
    """Measured position of each joint, in rad or m, or NaN before the first response from its servo."""
    velocity: Mapping[str, float]
    """Measured velocity of each joint, in rad/s or m/s."""
    effort: Mapping[str, float]
    """Torque or force of each joint, in N m or N, or NaN if unknown."""
    temperature: Mapping[str, float]
    """Temperature of each joint's servo, in °C, or NaN if unknown."""
    command: Mapping[str, float]
    """Latest commanded position of each joint, in rad or m, or NaN before the first command."""
    faults: Mapping[str, str] = field(default_factory=dict)
    """Sentence about each fault or alarm, keyed by joint name; empty if there is no fault or alarm."""
    unmeasured: tuple[str, ...] = ()
    """Joints whose position may be outdated because of a fault. Joints that have only an alarm are still measured."""


Observer = Callable[[ArmState], None]
"""Function that receives the state after each cycle. The function must return within a fraction of a cycle."""


@dataclass(frozen=True, slots=True)
class ArmDescription:
    """Properties of an arm that do not change while its control loop runs."""

    name: str
    """Name of the arm, such as ``so101``."""
    joints: tuple[str, ...]
    """Joints that can be moved, in the order of the robot description. Arrays use the same order."""
    limits: Mapping[str, JointLimits]
    """Limits of the joints, keyed by joint name."""
    hand: str
    """Joint of the gripper, or empty if the arm has no gripper."""
    hand_open: float
    """Position of the open gripper, in rad or m, or NaN if the arm has no gripper."""
    hand_closed: float
    """Position of the closed gripper, in rad or m, or NaN if the arm has no gripper."""
    period_s: float
    """Period of the control loop, in seconds."""
    folder: Path | None
    """Folder of the arm, with its named poses, or None if the files are not from an arm folder."""


@dataclass(frozen=True, slots=True)
class MotionGoal:
    """Path of some joints through one or more timed points. The joints come to rest at the last point.

    A goal with one point is a motion from the currently commanded position to this point. Joints without a position do
    not move.
    """

    joints: tuple[str, ...]
    """Names of the n joints that move."""
    times_s: tuple[float, ...]
    """Times of the k points since the start, in seconds, strictly increasing. The joint limits may make the motion take
    longer."""
    positions: tuple[tuple[float, ...], ...]
    """k points with n positions each, in rad or m."""
    velocities: tuple[tuple[float, ...], ...] = ()
    """k points with n velocities each, in rad/s or m/s. If there are none, the controller chooses the velocities."""


class MotionProgress(Protocol):
    """Progress of a goal. The progress may be read from any thread."""

    @property
    def done(self) -> bool:
        """Whether the goal has ended, with or without success."""
        ...

    @property
    def failure(self) -> Exception | None:
        """Error of a goal that failed: MotionFailedError, MotionCanceledError or ArmEndedError.

        None while the goal is running and after success.
        """
        ...


class ArmBackend(Protocol):
    """Interface through which ``Arm`` uses the program that runs the control loop. Every method may be called from any
    thread.

    Only ``begin_stream``, ``set_torque``, ``begin_freedrive``, ``end_freedrive``, ``wait``, ``wait_async`` and
    ``close`` wait for cycles. A call that raises an error does not move the arm.
    """

    @property
    def description(self) -> ArmDescription:
        """Properties of the arm."""
        ...

    def state(self) -> ArmState:
        """Return the latest state. Raises ArmEndedError if there is no measurement because the loop has ended."""
        ...

    def observe(self, observer: Observer) -> Callable[[], None]:
        """Call a function with the state after each cycle, and return a function that ends the calls."""
        ...

    def start(self, goal: MotionGoal) -> MotionProgress:
        """Start a motion. The motion begins in the next cycle and replaces any running motion of the same joints.

        Raises:
            ArmInputError: The goal is invalid.
            ArmBusyError: A stream or another program moves the joints.
            ArmEndedError: The control loop has ended.
        """
        ...

    def cancel(self, progress: MotionProgress) -> None:
        """Cancel a motion. The moving joints slow down within their limits and hold their positions.

        Canceling a finished motion has no effect.
        """
        ...

    def stop(self) -> None:
        """Cancel all motions, and end any stream and freedrive. The joints slow down and hold their positions."""
        ...

    def begin_stream(self, max_age_s: float) -> None:
        """Open a stream that accepts targets until it is closed or times out.

        If no target arrives for ``max_age_s`` seconds, the stream ends. The joints then slow down within their limits
        and hold their positions, and the next ``send`` raises StreamEndedError. The time limit for the first target
        starts with this call.

        Args:
            max_age_s: Maximum time between two targets, in seconds.

        Raises:
            ArmBusyError: Another stream is open, or a joint cannot be moved now.
        """
        ...

    def send(self, targets: Mapping[str, float]) -> None:
        """Send targets in rad or m, keyed by joint name. The joints move toward their targets, starting in the next
        cycle.

        Joints without a target hold their positions at their last targets.

        Raises:
            ArmInputError: A joint is unknown, or a target is not finite or outside the limits. The previous target
                stays in effect.
            StreamEndedError: No stream is open, or the last target was sent too long ago.
        """
        ...

    def end_stream(self) -> None:
        """End the stream. The joints slow down within their limits and hold their positions.

        This call has no effect if no stream is open.
        """
        ...

    def set_torque(self, on: bool, park: bool = True) -> None:
        """Enable or disable the torque of all servos, and return when the change is complete.

        Args:
            on: Whether to enable the torque. Each servo's goal position is first set to its measured position.
            park: Whether to move to the park pose of the robot file, if any, before the torque is disabled.

        Raises:
            MotionFailedError: The park pose was not reached. The torque stays enabled.
            ArmError: A servo does not respond or cannot be activated safely.
        """
        ...

    def begin_freedrive(self) -> None:
        """Let a person move the joints by hand, and return once the joints can be moved.

        Raises:
            ArmBusyError: A motion is running, a stream is open, the torque is off, or the arm is already in freedrive.
            ArmError: The servos cannot support the arm's weight, or a servo does not respond.
        """
        ...

    def end_freedrive(self) -> None:
        """Make the joints hold their positions with full torque, and return once they hold.

        This call has no effect if the arm is not in freedrive.

        Raises:
            ArmError: A servo does not respond, so its torque limit is still reduced.
        """
        ...

    def record(self, path: Path) -> AbstractContextManager[None]:
        """Record all cycles in a new file for the duration of the context."""
        ...

    def wait(self, until: Callable[[], bool], timeout_s: float) -> bool:
        """Wait until a condition is true, for at most ``timeout_s`` seconds on the loop's clock.

        In simulated time, this call runs the cycles. In real time, the calling thread sleeps and the condition is
        checked after each cycle.

        Returns:
            Whether the condition is true.

        Raises:
            ArmEndedError: The control loop has ended and the condition is not true.
        """
        ...

    async def wait_async(self, until: Callable[[], bool], timeout_s: float) -> bool:
        """Wait like ``wait``, but without blocking the event loop."""
        ...

    def close(self) -> None:
        """End the connection. A backend that owns its loop shuts the arm down as its robot file specifies.

        Raises ArmError if a step of the shutdown failed. A second call has no effect.
        """
        ...
