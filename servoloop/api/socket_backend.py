"""Backend that controls the arm of another process over its command socket."""

import math
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from time import monotonic
from typing import Any, Final, Self

from controller.trajectory.goal import LONGEST_GOAL_S
from drivers.clock import MonotonicClock
from drivers.driver_errors import DriverError
from hal.types import JointLimits
from nodes.namespace import parse_namespace
from servoloop.api.arm_errors import (
    ArmBusyError,
    ArmEndedError,
    ArmError,
    ArmInputError,
    ArmSetupError,
    StreamEndedError,
)
from servoloop.api.backend import ArmDescription, ArmState, MotionGoal, MotionProgress, Observer
from servoloop.api.checks import checked_goal, checked_targets
from servoloop.api.pace import ThreadPace
from servoloop.api.socket_errors import arm_error
from servoloop.command_socket.client import CommandClient
from servoloop.command_socket.command_errors import CommandError
from servoloop.recording.stream import RunningStack, find_stack

FIRST_S: Final = 5.0
"""Maximum time to wait for the first state, in seconds."""
EVENTS_S: Final = 0.2
"""Maximum duration of a single wait for states, in seconds. After ``close``, the waiting thread ends within this
time."""
TORQUE_S: Final = 90.0
"""Maximum time to enable or disable the torque, in seconds, in addition to the motion to the park pose."""
FASTEST_HZ: Final = 1000.0


class SocketMotion:
    """Progress of a goal that the stack executes."""

    def __init__(self, backend: "SocketBackend", number: int) -> None:
        self.number = number
        self._backend = backend

    @property
    def done(self) -> bool:
        """Whether the goal or the stack has ended."""
        return self._backend.result_of(self.number)[0]

    @property
    def failure(self) -> Exception | None:
        """Error of a goal that failed. None while the goal runs and after success."""
        return self._backend.result_of(self.number)[1]


class SocketBackend:
    """Backend that controls the arm of a running stack over its command socket.

    From its first motion until ``close``, only this program moves the arm. Timeouts are in real time, even if the stack
    runs in simulated time.
    """

    def __init__(self, stack: RunningStack) -> None:
        """Connect to a stack. Raises ArmSetupError."""
        try:
            self._commands = CommandClient(stack, "servoloop.Arm")
            self._watching = CommandClient(stack, "servoloop.Arm, states")
            self.description = _description(self._commands.request("arm"))
            self._watching.request("watch", rate_hz=FASTEST_HZ)
        except CommandError as error:
            raise ArmSetupError(f"the arm of {stack.label} cannot be used: {error}") from error
        self._why_ended = ""
        self._newest: tuple[ArmState, float] | None = None
        """Latest state and the time of its arrival, in seconds."""
        self._first = threading.Event()
        self._results: dict[int, ArmError | None] = {}
        """Results of the motions that have ended, keyed by motion number."""
        self._pace = ThreadPace(MonotonicClock(), self._ended)
        self._thread = threading.Thread(target=self._watch, name="states of the arm", daemon=True)
        self._thread.start()

    @classmethod
    def find(cls, arm: str | None, namespace: str | None) -> Self:
        """Connect to the only running stack, or to the stack with the given arm or namespace. Raises ArmSetupError."""
        try:
            return cls(find_stack(arm, None if namespace is None else parse_namespace(namespace)))
        except DriverError as error:
            raise ArmSetupError(str(error)) from error

    def state(self) -> ArmState:
        """Return the latest state."""
        self._first.wait(FIRST_S)
        if self._newest is None:
            raise self._ended() or ArmError("the arm has not sent any measurements: check its power and its cables")
        state, arrived_s = self._newest
        if (error := self._ended()) is not None:
            raise error
        return _aged(state, monotonic() - arrived_s)

    def observe(self, observer: Observer) -> Callable[[], None]:
        """Call a function with the latest state after each cycle, and return a function that ends the calls."""

        def observe() -> None:
            try:
                state = self.state()
            except ArmEndedError:  # At the end, the observers are called once more, without a new state.
                return
            observer(state)

        return self._pace.watch(observe)

    def start(self, goal: MotionGoal) -> MotionProgress:
        """Start a motion, as ``ArmBackend.start`` describes."""
        goal = checked_goal(goal, self.description)
        self._ask("take")
        reply = self._ask(
            "move",
            joints=goal.joints,
            times_s=goal.times_s,
            positions=goal.positions,
            velocities=goal.velocities,
        )
        return SocketMotion(self, int(reply["motion"]))

    def cancel(self, progress: MotionProgress) -> None:
        """Cancel a motion that this backend has started."""
        if isinstance(progress, SocketMotion) and not progress.done:
            self._ask("cancel_move", motion=progress.number)

    def stop(self) -> None:
        """Cancel all motions, including those of other clients, and end any stream.

        The message is sent over a separate connection, because a torque change may block the main connection.
        """
        try:
            self._watching.request("stop")
        except CommandError as error:
            raise arm_error(error) from None

    def begin_stream(self, max_age_s: float) -> None:
        """Open a stream, as ``ArmBackend.begin_stream`` describes."""
        if not (math.isfinite(max_age_s) and max_age_s > 0.0):
            raise ArmInputError(f"the maximum age of a target must be above 0 s, not {max_age_s}")
        self._ask("take")
        self._ask("stream", max_age_s=max_age_s)

    def send(self, targets: Mapping[str, float]) -> None:
        """Send targets in rad or m, keyed by joint name."""
        positions = checked_targets(targets, self.description)
        try:
            self._commands.request("targets", positions=positions)
        except CommandError as error:
            if error.kind == "not_owner":
                raise StreamEndedError(f"the stream has ended: {error}") from None
            raise arm_error(error) from None

    def end_stream(self) -> None:
        """End the stream, if one is open."""
        self._ask("stream_end")

    def set_torque(self, on: bool, park: bool = True) -> None:
        """Enable or disable the torque, as ``ArmBackend.set_torque`` describes."""
        self._ask("take")
        park_s = LONGEST_GOAL_S if park and not on else 0.0  # The stack limits the time of the motion.
        self._ask("torque", TORQUE_S + park_s, on=on, park=park)

    def begin_freedrive(self) -> None:
        """Let a person move the joints, as ``ArmBackend.begin_freedrive`` describes."""
        self._ask("take")
        try:
            self._ask("freedrive", on=True)
        except ArmBusyError:  # Another caller has opened the freedrive.
            raise
        except BaseException:  # The stack may have begun the freedrive, or may still begin it.
            with suppress(ArmError):
                self._ask("freedrive", on=False)
            raise

    def end_freedrive(self) -> None:
        """Make the joints hold their positions, as ``ArmBackend.end_freedrive`` describes."""
        if self._ended() is None:
            self._ask("freedrive", on=False)

    @contextmanager
    def record(self, path: Path) -> Iterator[None]:
        """Make the stack record all cycles in a new file for the duration of the context."""
        where = str(path.absolute())
        try:
            self._commands.request("record", path=where)
        except CommandError as error:
            raise ArmInputError(str(error)) from None
        try:
            yield
        finally:
            if self._ended() is None:
                self._ask("record_end", path=where)

    def wait(self, until: Callable[[], bool], timeout_s: float) -> bool:
        """Wait for a condition."""
        return self._pace.wait(until, timeout_s)

    async def wait_async(self, until: Callable[[], bool], timeout_s: float) -> bool:
        """Wait for a condition without blocking the event loop."""
        return await self._pace.wait_async(until, timeout_s)

    def close(self) -> None:
        """Disconnect. This program's motions stop within their limits, and the arm holds its position."""
        self._why_ended = self._why_ended or "the connection to the arm has been closed: connect again"
        self._commands.close()
        self._thread.join(2 * EVENTS_S)
        self._watching.close()
        self._pace.close()

    def result_of(self, motion: int) -> tuple[bool, ArmError | None]:
        """Return whether a motion has ended, and its error if it has failed."""
        if motion not in self._results and not self._why_ended:
            try:
                self._keep(self._commands.events())
            except CommandError as error:
                self._why_ended = self._why_ended or str(error)
        if motion in self._results:
            return True, self._results[motion]
        return bool(self._why_ended), self._ended()

    def _ended(self) -> ArmEndedError | None:
        return ArmEndedError(self._why_ended) if self._why_ended else None

    def _ask(self, op: str, timeout_s: float = FIRST_S, **fields: Any) -> dict[str, Any]:
        if (ended := self._ended()) is not None:
            raise ended
        try:
            return self._commands.request(op, timeout_s, **fields)
        except CommandError as error:
            raise arm_error(error) from None

    def _keep(self, events: list[dict[str, Any]]) -> None:
        """Store the motion results from a list of events."""
        for event in events:
            if event["event"] == "moved":
                error = event["error"]
                self._results[event["motion"]] = None if error is None else arm_error(CommandError.of(error))

    def _watch(self) -> None:
        """Receive the states until the connection ends."""
        try:
            while not self._why_ended:
                for event in self._watching.events(EVENTS_S):
                    if event["event"] == "state":
                        self._newest = _state(event), monotonic()
                if self._newest is not None:
                    self._first.set()
                self._pace.cycle_done()
        except CommandError as error:
            self._why_ended = self._why_ended or str(error)
        finally:
            self._first.set()
            self._pace.cycle_done()


def _description(fields: Mapping[str, Any]) -> ArmDescription:
    """Return the arm properties contained in a reply."""
    folder, hand = fields["folder"], (fields["hand_open"], fields["hand_closed"])
    opened, closed = (math.nan if at is None else at for at in hand)
    limits = {joint: _limits(values) for joint, values in fields["limits"].items()}
    return ArmDescription(
        fields["name"],
        tuple(fields["joints"]),
        limits,
        fields["hand"],
        opened,
        closed,
        fields["period_s"],
        None if folder is None else Path(folder),
    )


def _limits(values: Mapping[str, Any]) -> JointLimits:
    """Return the joint limits contained in a reply. In the reply, null represents infinity."""
    lower = -math.inf if values["lower"] is None else values["lower"]
    names = ("upper", "velocity", "acceleration", "jerk", "effort")
    upper, velocity, acceleration, jerk, effort = (math.inf if values[n] is None else values[n] for n in names)
    ranges = (None if values[n] is None else tuple(values[n]) for n in ("velocity_range", "effort_range"))
    return JointLimits(lower, upper, velocity, acceleration, jerk, effort, *ranges)


def _state(fields: Mapping[str, Any]) -> ArmState:
    """Return the state contained in an event. In the event, null represents NaN."""

    def numbers(name: str) -> dict[str, float]:
        return {joint: math.nan if at is None else float(at) for joint, at in fields[name].items()}

    return ArmState(
        fields["time_s"],
        fields["age_s"],
        numbers("position"),
        numbers("velocity"),
        numbers("effort"),
        numbers("temperature"),
        numbers("command"),
        fields["faults"],
        tuple(fields["unmeasured"]),
    )


def _aged(state: ArmState, passed_s: float) -> ArmState:
    """Return a copy of a state with an increased age."""
    return replace(state, age_s=state.age_s + passed_s)
