"""Connection between an arm and the program that runs its control loop.

``ArmBackend`` defines every call that ``servoloop.Arm`` needs. Two classes implement it:

- ``StackBackend`` (servoloop/api/stack_backend.py) moves a ``ControlStack`` of the same process. This class has no
  thread: a script runs the loop with ``OwnLoop``, and ``servoloop up`` runs its own loop and creates a ``StackBackend``
  for the clients of its socket. A server translates each message into one call of this class.
- A client of the socket sends each call as a message and keeps the latest state that it has received.

All goals and targets are plain data, so that a message can contain them. Every implementation raises the errors of
``servoloop.api.errors``. A server sends the class name, the text and the joint of an error, and its client raises the
same error again.

``StackBackend`` checks every goal, because a client of the socket may be written in another language. ``Arm`` only
converts its arguments into goals.
"""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from hal.types import JointLimits


@dataclass(frozen=True, slots=True)
class ArmState:
    """Measurement of all joints in one cycle. All mappings list the joints in the order of ``Arm.joints``.

    A joint that did not answer in this cycle keeps its last values and has an entry in ``faults``.
    """

    time_s: float
    """Time of the measurement on the clock of the control loop, in seconds."""
    age_s: float
    """Time from the measurement until this object was created, in seconds."""
    position: Mapping[str, float]
    """Measured position of each joint, in rad or m; NaN before the first answer of its servo."""
    velocity: Mapping[str, float]
    """Measured velocity of each joint, in rad/s or m/s."""
    effort: Mapping[str, float]
    """Torque or force of each joint, in N m or N; NaN if unknown."""
    temperature: Mapping[str, float]
    """Temperature of each joint's servo, in °C; NaN if unknown."""
    command: Mapping[str, float]
    """Latest commanded position of each joint, in rad or m; NaN before the first command."""
    faults: Mapping[str, str] = field(default_factory=dict)
    """One sentence for each joint with a fault or an alarm; empty if no joint has one."""
    unmeasured: tuple[str, ...] = ()
    """Joints whose position may be outdated because of a fault. A joint with only an alarm is measured."""


Observer = Callable[[ArmState], None]
"""Function that receives the state of each cycle. It must return within a fraction of a cycle."""


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
    """Joint of the gripper; empty if the arm has none."""
    hand_open: float
    """Position of the open gripper, in rad or m; NaN if the arm has no gripper."""
    hand_closed: float
    """Position of the closed gripper, in rad or m; NaN if the arm has no gripper."""
    period_s: float
    """Period of the control loop, in seconds."""
    folder: Path | None
    """Folder of the arm, with its named poses; None if the files are not from an arm folder."""


@dataclass(frozen=True, slots=True)
class MotionGoal:
    """Path of some joints through one or more timed points. The last point is reached at rest.

    A goal with one point is a motion from the current command to this point. Joints without a position do not move.
    """

    joints: tuple[str, ...]
    """Names of the n joints that move."""
    times_s: tuple[float, ...]
    """Times of the k points since the start, in seconds, strictly increasing. Limits may make the motion longer."""
    positions: tuple[tuple[float, ...], ...]
    """k points with n positions each, in rad or m."""
    velocities: tuple[tuple[float, ...], ...] = ()
    """k points with n velocities each, in rad/s or m/s. If empty, the controller chooses the velocities."""


class MotionProgress(Protocol):
    """Progress of a goal. Any thread may read it."""

    @property
    def done(self) -> bool:
        """Whether the goal has ended, with or without success."""
        ...

    @property
    def failure(self) -> Exception | None:
        """MotionFailedError, MotionCanceledError or ArmEndedError of a goal that failed.

        None while the goal runs and after success.
        """
        ...


class ArmBackend(Protocol):
    """Interface through which ``Arm`` uses the program that runs the control loop. Any thread may call each method.

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
        """Call a function with the state of each cycle, and return a function that ends the calls."""
        ...

    def start(self, goal: MotionGoal) -> MotionProgress:
        """Start a motion. The motion begins in the next cycle and replaces a running motion of the same joints.

        Raises:
            ArmInputError: The goal is invalid.
            ArmBusyError: A stream or another program moves the joints.
            ArmEndedError: The control loop has ended.
        """
        ...

    def cancel(self, progress: MotionProgress) -> None:
        """Cancel a motion. The moving joints slow down within their limits and hold.

        A finished motion is not affected.
        """
        ...

    def stop(self) -> None:
        """Cancel all motions, and end the stream and the freedrive. The joints slow down and hold."""
        ...

    def begin_stream(self, max_age_s: float) -> None:
        """Open a stream, which accepts targets until it ends.

        If no target arrives for ``max_age_s`` seconds, the stream ends: the joints slow down within their limits and
        hold, and the next ``send`` raises StreamEndedError. The age of the first target counts from this call.

        Args:
            max_age_s: Maximum time between two targets, in seconds.

        Raises:
            ArmBusyError: Another stream is open, or a joint cannot be moved now.
        """
        ...

    def send(self, targets: Mapping[str, float]) -> None:
        """Send targets by joint, in rad or m. The next cycle moves toward them. Other joints hold their last target.

        Raises:
            ArmInputError: A joint is unknown, or a target is not finite or outside the limits. The previous target
                stays in effect.
            StreamEndedError: No stream is open, or its last target was too old.
        """
        ...

    def end_stream(self) -> None:
        """End the stream. The joints slow down within their limits and hold.

        This call has no effect if no stream is open.
        """
        ...

    def set_torque(self, on: bool, park: bool = True) -> None:
        """Enable or disable the torque of all servos, and return when this is done.

        Args:
            on: Whether to enable the torque, with each goal at the measured position.
            park: Whether to move to the park pose of the robot file, if there is one, before the torque is disabled.

        Raises:
            MotionFailedError: The park pose was not reached. The torque stays enabled.
            ArmError: A servo does not answer or cannot be activated safely.
        """
        ...

    def begin_freedrive(self) -> None:
        """Let a person move the joints by hand, and return once the joints yield.

        Raises:
            ArmBusyError: A motion is running, a stream is open, the torque is off, or the arm is in freedrive already.
            ArmError: The servos cannot carry the weight of the arm, or a servo does not answer.
        """
        ...

    def end_freedrive(self) -> None:
        """Make the joints hold their positions with full torque, and return once they do.

        This call has no effect if the arm is not in freedrive.

        Raises:
            ArmError: A servo does not answer, and still has a reduced torque limit.
        """
        ...

    def record(self, path: Path) -> AbstractContextManager[None]:
        """Record all cycles in a new file for the duration of the context."""
        ...

    def wait(self, until: Callable[[], bool], timeout_s: float) -> bool:
        """Wait until a condition holds, for at most ``timeout_s`` seconds of the loop's clock.

        In simulated time, this call runs the cycles. In real time, the calling thread sleeps and the condition is
        checked after each cycle.

        Returns:
            Whether the condition holds.

        Raises:
            ArmEndedError: The control loop has ended and the condition does not hold.
        """
        ...

    async def wait_async(self, until: Callable[[], bool], timeout_s: float) -> bool:
        """Wait as ``wait`` does, without blocking the event loop."""
        ...

    def close(self) -> None:
        """End the connection. A backend that owns its loop shuts the arm down as its robot file specifies.

        Raises ArmError if a step of the shutdown failed. A second call has no effect.
        """
        ...
