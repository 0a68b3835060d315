"""Handle the messages of the command socket.

The handler of each message returns the fields of the reply or raises an error.
"""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar

from controller.gripper.goal import GripperGoal
from controller.manager.client import ManagerClient
from controller.manager.requests import Request
from controller.manager.switch import Loaded, Strictness, SwitchRequest
from controller.manager_errors import ManagerError
from controller.trajectory.goal import GoalPoint
from drivers.driver_errors import DriverError
from drivers.paths import resolved
from hal.hal_errors import HalError
from servoloop.api.arm_errors import ArmError
from servoloop.api.backend import ArmBackend
from servoloop.api.socket_errors import command_error
from servoloop.command_server.arm_requests import ArmRequests
from servoloop.command_server.motions import Motions
from servoloop.command_server.ownership import Owner, Ownership
from servoloop.command_server.server_time import RealTime, ServerTime
from servoloop.command_socket import messages
from servoloop.command_socket.command_errors import CommandError
from servoloop.stack.control_stack import ControlStack

Reply = dict[str, Any]
Result = TypeVar("Result")

STALE_S: Final = 0.5
"""Maximum age of a command that moves joints, in seconds."""
FUTURE_S: Final = 0.1
"""Maximum time by which the timestamp of a command may be in the future, in seconds."""
LOOP_S: Final = 15.0
"""Maximum time to wait until the loop has executed a request, in seconds. A component needs at most 10 s."""


class Recordings(Protocol):
    """Recordings of a stack. servoloop.recording.stack_recording.StackRecording implements this interface."""

    def begin(self, path: Path) -> None:
        """Begin a recording. Raises RecordingError."""
        ...

    def end(self, path: Path) -> Request[None]:
        """Request that a recording ends. Raises RecordingError."""
        ...


class Client(Owner, Protocol):
    """Connected client, as seen by the message handlers."""

    name: str

    def watch(self, rate_hz: float) -> None:
        """Send states after each cycle, at most ``rate_hz`` times a second."""
        ...


class StackRequests:
    """Handlers of the messages sent to one stack. Any thread may call ``answer``."""

    def __init__(
        self, stack: ControlStack, arm: ArmBackend, recordings: Recordings, time: ServerTime | None = None
    ) -> None:
        """Connect to a stack.

        Args:
            stack: The stack.
            arm: Handlers of the messages that move the arm as a whole.
            recordings: Recordings of the stack.
            time: Time of the server. If None, real time is used.
        """
        self.time = time or RealTime()
        self.ownership = Ownership(self._halt)
        self._motions, self._arm = Motions(stack.loop), ArmRequests(arm)
        self._stack, self._loop = stack, stack.loop
        self._recordings = recordings
        self._manager = ManagerClient(stack.loop, stack.factory)
        self._handlers: Mapping[type, Callable[[Client, Any], Reply]] = {
            **self._arm.handlers,
            messages.Hello: self._hello,
            messages.GetState: lambda client, message: self.state(),
            messages.WatchStates: self._watch,
            messages.ListControllers: self._controllers,
            messages.Take: self._take,
            messages.Release: self._release,
            messages.SendGoal: self._goal,
            messages.SendGrip: self._grip,
            messages.SendSetPoint: self._set_point,
            messages.CancelGoal: self._cancel,
            messages.Stop: self._stop,
            messages.SwitchControllers: self._switch,
            messages.OpenStream: self._open_stream,
            messages.Torque: self._torque,
            messages.SetFreedrive: self._freedrive,
            messages.Record: self._record,
            messages.EndRecord: self._record_end,
        }

    def answer(self, client: Client, message: messages.Message) -> Reply:
        """Handle a message and return the fields of its reply. Raises CommandError."""
        handler = self._handlers[type(message)]
        try:
            if isinstance(message, messages.MotionMessage):
                return self.ownership.moving(client, lambda: self._move(client, message))
            return handler(client, message)
        except ArmError as error:
            raise command_error(error) from error

    def _move(self, client: Client, message: messages.MotionMessage) -> Reply:
        _require_fresh(self.time.now() - message.sent_s)
        return self._handlers[type(message)](client, message)

    def ended(self, client: Client) -> Iterator[Reply]:
        """Yield the results of a client's motions and goals since the last call, as events."""
        yield from self._motions.ended(client)
        yield from self._arm.ended(client)

    def state(self) -> Reply:
        """Return the latest state of the arm. Raises ArmError if there is no state."""
        return {**self._arm.state(), "owner": self.ownership.owner}

    def disconnect(self, client: Client) -> None:
        """Stop the motions of a client that has disconnected, and discard its data."""
        self.ownership.release(client)
        self._motions.forget(client)
        self._arm.forget(client)

    def _halt(self, client: Owner) -> None:
        self._motions.halt(client)
        self._arm.halt(client)

    def _hello(self, client: Client, message: messages.Hello) -> Reply:
        client.name = message.client or client.name
        files, loop = self._stack.files, self._loop
        folder = None if files.folder is None else str(resolved(files.folder))
        return {"arm": files.arm, "folder": folder, "rate_hz": 1.0 / loop.period_s}

    def _watch(self, client: Client, message: messages.WatchStates) -> Reply:
        client.watch(message.rate_hz)
        return {}

    def _controllers(self, client: Client, message: messages.ListControllers) -> Reply:
        loaded = self._loop.manager.registry.loaded.values()
        return {"controllers": [self._controller(client, entry) for entry in loaded]}

    def _controller(self, client: Client, entry: Loaded) -> Reply:
        return {
            "name": entry.name,
            "type": entry.spec.kind,
            "state": entry.state.name.lower(),
            "interfaces": list(entry.commands),
            "busy": self._motions.busy(client, entry),
        }

    def _take(self, client: Client, message: messages.Take) -> Reply:
        self.ownership.take(client, message.force)
        return {}

    def _release(self, client: Client, message: messages.Release) -> Reply:
        self.ownership.release(client)
        return {}

    def _goal(self, client: Client, message: messages.SendGoal) -> Reply:
        points = [
            GoalPoint(tuple(point.positions), point.time_s, tuple(point.velocities), tuple(point.accelerations))
            for point in message.points
        ]
        return {"goal": self._motions.goal(client, message.controller, message.joints, points)}

    def _grip(self, client: Client, message: messages.SendGrip) -> Reply:
        goal = GripperGoal(message.position, message.velocity)
        return {"goal": self._motions.grip(client, message.controller, goal)}

    def _set_point(self, client: Client, message: messages.SendSetPoint) -> Reply:
        self._motions.set_point(client, message.controller, message.values, message.time_s)
        return {}

    def _cancel(self, client: Client, message: messages.CancelGoal) -> Reply:
        self._motions.cancel(client, message.goal)
        return {}

    def _stop(self, client: Client, message: messages.Stop) -> Reply:
        self.ownership.end(f"{client.name} has stopped all motions: take control of the arm again")
        self._motions.stop()
        self._arm.stop()
        return {}

    def _switch(self, client: Client, message: messages.SwitchControllers) -> Reply:
        switch = SwitchRequest(tuple(message.activate), tuple(message.deactivate), Strictness.STRICT)
        request = self.ownership.moving(client, lambda: {"asked": self._manager.switch(switch)})["asked"]
        return {"text": self._wait(request)}

    def _open_stream(self, client: Client, message: messages.OpenStream) -> Reply:
        self.ownership.require(client)
        # This call waits for a cycle, so it does not hold the lock of the arm's control.
        self._arm.open_stream(client, message)
        return self._still_owned(client)

    def _torque(self, client: Client, message: messages.Torque) -> Reply:
        self.ownership.require(client)
        # This call waits without holding the lock, so that other clients can stop the arm.
        self._arm.set_torque(message)
        return self._still_owned(client)

    def _freedrive(self, client: Client, message: messages.SetFreedrive) -> Reply:
        self.ownership.require(client)
        self._arm.set_freedrive(client, message.on)  # This call also waits without holding the lock.
        return self._still_owned(client)

    def _still_owned(self, client: Client) -> Reply:
        """Return an empty reply. Raises CommandError if the client has lost control in the meantime."""
        try:
            self.ownership.require(client)
        except CommandError:
            self._halt(client)
            raise
        return {}

    def _record(self, client: Client, message: messages.Record) -> Reply:
        path = Path(message.path)
        if not path.is_absolute():
            raise CommandError("malformed", f"record: the path {path} is not absolute; send an absolute path")
        _attempt(lambda: self._recordings.begin(path))
        return {}

    def _record_end(self, client: Client, message: messages.EndRecord) -> Reply:
        self._wait(_attempt(lambda: self._recordings.end(Path(message.path))))
        return {}

    def _wait(self, request: Request[Result]) -> Result:
        """Wait until the loop has executed a request. Raises CommandError."""
        if not self.time.wait(lambda: request.done, LOOP_S):
            raise CommandError("timeout", f"the control loop did not carry out the request within {LOOP_S:g} s")
        return _attempt(request.result)


def _attempt(work: Callable[[], Result]) -> Result:
    """Return the result of a function. Errors that the client can correct become errors of the type ``failed``."""
    try:
        return work()
    except CommandError:
        raise
    except (DriverError, HalError, ManagerError, RuntimeError) as error:
        raise CommandError("failed", str(error)) from error


def _require_fresh(age_s: float) -> None:
    if age_s > STALE_S:
        text = f"the command is ignored because it is {age_s:.2f} s old; the limit is {STALE_S:g} s"
        raise CommandError("stale", text)
    if age_s < -FUTURE_S:
        text = f"sent_s is {-age_s:.2f} s in the future: use CLOCK_MONOTONIC of this machine, in seconds"
        raise CommandError("malformed", text)
