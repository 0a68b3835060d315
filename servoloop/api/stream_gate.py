"""Stream of targets on a local stack, which uses a forward command controller and ends if targets stop arriving."""

import logging
from collections.abc import Callable, Mapping
from typing import Final

from controller.forward.commands import ForwardParameters
from controller.forward.forward_command_controller import ForwardCommandController
from controller.manager.switch import SwitchRequest
from controller.manager_errors import ManagerError
from servoloop.api.arm_errors import ArmBusyError, StreamEndedError
from servoloop.stack.control_stack import ControlStack

LOG = logging.getLogger("servoloop")
InLoop = Callable[[Callable[[], None]], None]
"""Function that runs an action in the loop's thread between two cycles, and returns when the action is complete."""


class Takeover:
    """Switches some joints to one controller and back. The loop's thread calls all methods between two cycles."""

    def __init__(self, stack: ControlStack, name: str) -> None:
        """``name`` is the name of the controller, which may be loaded later."""
        self._stack, self._name = stack, name
        self._former: tuple[str, ...] = ()

    @property
    def active(self) -> bool:
        """Whether the controller is active. This property may be read from any thread."""
        entry = self._stack.loop.manager.registry.loaded.get(self._name)
        return entry is not None and entry.active

    def take(self) -> None:
        """Activate the controller in place of the controllers that currently drive its joints. Raises ArmBusyError."""
        loop = self._stack.loop
        registry = loop.manager.registry
        claims = set(registry.loaded[self._name].commands)
        former = [e.spec.name for e in registry.running if claims.intersection(e.controller.command_interfaces)]
        try:
            request = SwitchRequest(activate=(self._name,), deactivate=tuple(former))
            loop.manager.switch(request, loop.within_limits)
        except ManagerError as error:
            raise ArmBusyError(f"{self._name} cannot take over its joints: {error}") from error
        self._former = tuple(former)
        self._stack.before_end[self._name] = self._before_end

    def give_back(self) -> None:
        """Reactivate the previous controllers, except those that another program has unloaded.

        The previous controllers start after the joints have slowed down within their limits. Controllers whose joints
        cannot be commanded now are suspended: they become active when the torque is enabled.
        """
        loop = self._stack.loop
        self._stack.before_end.pop(self._name, None)
        loaded, suspended = loop.manager.registry.loaded, loop.manager.suspended
        for name in self._former:
            if name not in loaded:
                text = "%s was unloaded and cannot be activated after %s: load and activate it to move its joints"
                LOG.error(text, name, self._name)
        suspended.discard(self._name)
        suspended.add(name for name in self._former if name in loaded and not loaded[name].active)
        own = (self._name,) * self.active
        ready = tuple(name for name in suspended.resumable(own) if name in self._former)
        try:
            loop.manager.switch(SwitchRequest(activate=ready, deactivate=own), loop.within_limits)
        except ManagerError as error:  # Without a controller, the joints hold their positions.
            LOG.error("the controllers that were active before %s cannot be activated again: %s", self._name, error)
            loop.manager.switch(SwitchRequest(deactivate=own), loop.within_limits)

    def _before_end(self) -> None:
        """Give the joints back to the previous controllers when the program ends. Only those controllers can relieve
        joints that press against an obstacle."""
        if self.active:
            self.give_back()


STREAM: Final = "stream_controller"
"""Name of the controller that follows streamed targets."""
NOT_OPEN: Final = "no stream is open: open a stream with arm.stream()"


class StreamGate:
    """The stream of one stack. Any thread may call ``begin``, ``send`` and ``end``."""

    def __init__(self, stack: ControlStack, joints: tuple[str, ...], in_loop: InLoop) -> None:
        """``joints`` are all joints that can be moved. ``in_loop`` runs an action between two cycles."""
        self._stack, self._joints, self._in_loop = stack, joints, in_loop
        self._takeover = Takeover(stack, STREAM)
        self._controller: ForwardCommandController | None = None
        self._targets: dict[str, float] = {}
        self._max_age_s = 0.0
        self._last_s = 0.0
        """Time of the latest target, in seconds."""
        self._why_ended = NOT_OPEN
        self.open = False

    def begin(self, max_age_s: float) -> None:
        """Switch to the stream controller. Raises ArmBusyError."""
        self._in_loop(lambda: self._begin(max_age_s))

    def send(self, targets: Mapping[str, float]) -> None:
        """Send checked targets. Raises StreamEndedError."""
        controller = self._controller
        if not self.open or controller is None:
            raise StreamEndedError(self._why_ended)
        self._targets.update(targets)
        self._last_s = self._stack.loop.clock.now()
        controller.submit([self._targets[joint] for joint in controller.joints])

    def end(self) -> None:
        """Switch back to the previous controllers."""
        if self.open:
            self._in_loop(lambda: self._end(NOT_OPEN))

    def update(self, now_s: float) -> None:
        """End the stream if it has timed out or its controller was deactivated. The loop calls this method after each
        cycle."""
        if not self.open:
            return
        if not self._takeover.active:
            self._end("the stream has ended because its controller was deactivated")
        elif now_s - self._last_s > self._max_age_s:
            self._end(
                f"the stream has ended: no target arrived for {self._max_age_s:g} s. The arm holds its position; open "
                "a new stream"
            )

    def _begin(self, max_age_s: float) -> None:
        if self.open:
            raise ArmBusyError("a stream is already open: close that stream first")
        loop = self._stack.loop
        if STREAM not in loop.manager.registry.loaded:
            self._load()
        self._takeover.take()
        # The controller starts where joints that are still moving will come to rest.
        assert self._controller is not None, "the controller is loaded before it takes over"
        starts = zip(self._controller.joints, self._controller.command.tolist(), strict=True)
        limits = self._stack.context.limits
        self._targets = {joint: min(max(at, limits[joint].lower), limits[joint].upper) for joint, at in starts}
        self._max_age_s, self._last_s = max_age_s, loop.clock.now()
        self.open = True

    def _load(self) -> None:
        parameters = ForwardParameters(joints=self._joints, interface_name="position")
        made = ForwardCommandController.build(STREAM, parameters, self._stack.context)
        assert isinstance(made, ForwardCommandController)
        self._stack.loop.manager.registry.add(made)
        self._controller = made

    def _end(self, why: str) -> None:
        if self.open:  # The stream may have ended while the request was waiting.
            self.open, self._why_ended = False, why
            self._takeover.give_back()
