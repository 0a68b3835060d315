"""Carry out the messages of the command socket. Each message returns the fields of its reply or raises an error."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar

from controller.gripper.goal import GripperGoal
from controller.manager.client import ManagerClient
from controller.manager.requests import Request
from controller.manager.switch import Loaded, ManagerError, Strictness, SwitchRequest
from controller.trajectory.goal import GoalPoint
from drivers.errors import DriverError
from hal.errors import HalError
from hal.lifecycle import LifecycleState
from hal.types import JointState, joints_of
from servoloop.command_server.motions import Motions
from servoloop.command_server.ownership import Owner, Ownership
from servoloop.command_socket import messages
from servoloop.command_socket.errors import CommandError
from servoloop.stack.control_stack import ControlStack

Reply = dict[str, Any]
Result = TypeVar("Result")

STALE_S: Final = 0.5
"""Maximum age of a command that moves joints, in seconds."""
FUTURE_S: Final = 0.1
"""Maximum time by which a command may seem to be sent in the future, in seconds."""
LOOP_S: Final = 15.0
"""Maximum time to wait until the loop has carried out a request, in seconds. A component needs at most 10 s."""
POLL_S: Final = 0.005
"""Period at which a request to the loop is checked, in seconds."""


class Recordings(Protocol):
    """Recordings of a stack: servoloop.recording.stack_recording.StackRecording."""

    def begin(self, path: Path) -> None:
        """Begin a recording. Raises RecordingError."""
        ...

    def end(self, path: Path) -> Request[None]:
        """Request the end of a recording. Raises RecordingError."""
        ...


class Client(Owner, Protocol):
    """Connected client, as the messages see it."""

    name: str

    def watch(self, rate_hz: float) -> None:
        """Send states after each cycle, at most ``rate_hz`` times a second."""
        ...


class StackRequests:
    """Messages to one stack. Any thread may call ``answer``."""

    def __init__(self, stack: ControlStack, recordings: Recordings) -> None:
        self.motions = Motions(stack.loop)
        self.ownership = Ownership(self.motions.halt)
        self._stack, self._loop = stack, stack.loop
        self._recordings = recordings
        self._manager = ManagerClient(stack.loop, stack.factory)
        self._newest: JointState | None = None
        self._resting: tuple[str, ...] = ()
        """Controllers that were active when the hardware was deactivated."""
        self._handlers: Mapping[type, Callable[[Client, Any], Reply]] = {
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
            messages.Torque: self._torque,
            messages.Record: self._record,
            messages.EndRecord: self._record_end,
        }

    def put(self, state: JointState) -> None:
        """Keep the newest measurement. The loop thread calls this method."""
        self._newest = state

    def answer(self, client: Client, message: messages.Message) -> Reply:
        """Carry out a message and return the fields of its reply. Raises CommandError."""
        if isinstance(message, messages.MotionMessage):
            _require_fresh(message.sent_s)
            return self.ownership.moving(client, lambda: self._handlers[type(message)](client, message))
        return self._handlers[type(message)](client, message)

    def state(self) -> Reply:
        """Return the newest measurement and command, in the order of the hardware's joints."""
        state, loop = self._newest, self._loop
        if state is None:
            return {"time_s": None, "joints": list(loop.hardware.joints)}
        commands = dict(zip(joints_of(loop.hardware.command_interfaces), loop.command.tolist(), strict=True))
        joints = loop.hardware.joints
        return {
            "time_s": state.stamp_s,
            "age_s": loop.clock.now() - state.stamp_s,
            "joints": list(joints),
            "position": state.position.tolist(),
            "velocity": state.velocity.tolist(),
            "effort": state.effort.tolist(),
            "command": [commands.get(joint) for joint in joints],
            "temperature_c": {joint: health.temperature_c for joint, health in state.health.items()},
            "faults": {joint: fault.text for joint, fault in state.faults.items()},
            "owner": self.ownership.owner,
        }

    def _hello(self, client: Client, message: messages.Hello) -> Reply:
        client.name = message.client or client.name
        files, loop = self._stack.files, self._loop
        limits = {
            joint: {"lower": limit.lower, "upper": limit.upper, "velocity": limit.velocity}
            for joint, limit in files.limits.items()
        }
        return {
            "arm": files.arm,
            "folder": None if files.folder is None else str(files.folder.resolve()),
            "joints": list(loop.hardware.joints),
            "limits": limits,
            "rate_hz": 1.0 / loop.period_s,
            "releases": self._stack.releases,
        }

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
            "busy": self.motions.busy(client, entry),
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
        return {"goal": self.motions.goal(client, message.controller, message.joints, points)}

    def _grip(self, client: Client, message: messages.SendGrip) -> Reply:
        goal = GripperGoal(message.position, message.velocity)
        return {"goal": self.motions.grip(client, message.controller, goal)}

    def _set_point(self, client: Client, message: messages.SendSetPoint) -> Reply:
        self.motions.set_point(client, message.controller, message.values, message.time_s)
        return {}

    def _cancel(self, client: Client, message: messages.CancelGoal) -> Reply:
        self.motions.cancel(client, message.goal)
        return {}

    def _stop(self, client: Client, message: messages.Stop) -> Reply:
        self.ownership.end(f"{client.name} has stopped all motions: take the motion again")
        self.motions.stop()
        return {}

    def _switch(self, client: Client, message: messages.SwitchControllers) -> Reply:
        switch = SwitchRequest(tuple(message.activate), tuple(message.deactivate), Strictness.STRICT)
        request = self.ownership.moving(client, lambda: {"asked": self._manager.switch(switch)})["asked"]
        return {"text": self._wait(request)}

    def _torque(self, client: Client, message: messages.Torque) -> Reply:
        return self.ownership.moving(client, lambda: self._activate() if message.on else self._deactivate())

    def _activate(self) -> Reply:
        for component in self._loop.hardware.components:
            self._wait(self._loop.component_transitions.ask(component.name, LifecycleState.ACTIVE))
        resting, self._resting = self._resting, ()
        if resting:
            self._wait(self._manager.switch(SwitchRequest(activate=resting)))
        return {"released": False}

    def _deactivate(self) -> Reply:
        releases = self._stack.releases
        running = self._loop.manager.registry.running
        self._resting = tuple(entry.spec.name for entry in running if entry.index) or self._resting
        for component in self._loop.hardware.components:
            self._wait(self._loop.component_transitions.ask(component.name, LifecycleState.INACTIVE, releases))
        return {"released": releases}

    def _record(self, client: Client, message: messages.Record) -> Reply:
        path = Path(message.path)
        if not path.is_absolute():
            raise CommandError("malformed", f"record: path: {path} is not absolute: send the absolute path")
        _attempt(lambda: self._recordings.begin(path))
        return {}

    def _record_end(self, client: Client, message: messages.EndRecord) -> Reply:
        self._wait(_attempt(lambda: self._recordings.end(Path(message.path))))
        return {}

    def _wait(self, request: Request[Result]) -> Result:
        """Wait until the loop has carried out a request. Raises CommandError."""
        deadline_s = time.monotonic() + LOOP_S
        while not request.done:
            if time.monotonic() > deadline_s:
                raise CommandError("timeout", f"the control loop did not carry out the request within {LOOP_S:g} s")
            time.sleep(POLL_S)
        return _attempt(request.result)


def _attempt(work: Callable[[], Result]) -> Result:
    """Return the result of some work. Errors that the client can correct become errors of the kind ``failed``."""
    try:
        return work()
    except CommandError:
        raise
    except (DriverError, HalError, ManagerError, RuntimeError) as error:
        raise CommandError("failed", str(error)) from error


def _require_fresh(sent_s: float) -> None:
    age_s = time.monotonic() - sent_s
    if age_s > STALE_S:
        raise CommandError("stale", f"the command is {age_s:.2f} s old, more than {STALE_S:g} s: it moves nothing")
    if age_s < -FUTURE_S:
        text = f"sent_s is {-age_s:.2f} s in the future: use CLOCK_MONOTONIC of this machine, in seconds"
        raise CommandError("malformed", text)
