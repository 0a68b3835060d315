"""Simulated client that switches controllers, changes their parameters, and activates the hardware again."""

import logging
from collections.abc import Callable, Collection
from functools import partial
from typing import Any, Final

from controller.manager.client import ManagerClient
from controller.manager.switch import Strictness, SwitchRequest
from controller.manager_errors import ManagerError
from controller.trajectory.parameters import TrajectoryParameters
from hal.hardware import Reactivating
from hal.lifecycle import LifecycleState
from servoloop.simulation.acts import Configure, Reactivate, Switch
from servoloop.simulation.stack import SimulatedStack

LOG = logging.getLogger("servoloop")

PULL_SHARE: Final = 0.5
"""Maximum pull by hand, as a fraction of the servo's full effort."""
LOOKS_S: Final = 0.25
"""Time after which a client checks again whether a joint is limp, in seconds."""
PUSHED_S: Final = 0.3
"""Duration for which a hand pushes limp joints, in seconds."""


class LifecycleClient:
    """Client of the controller manager.

    Args:
        stack: The stack.
        arm: Trajectory controller of the arm.
        later: Function that calls a function after a time in seconds.
    """

    def __init__(self, stack: SimulatedStack, arm: Any, later: Callable[[float, Callable[[], None]], None]) -> None:
        self._stack, self._arm, self._later = stack, arm, later
        self.half_switched = False
        """Whether an impossible switch was carried out in part."""

    def switch(self, act: Switch) -> None:
        """Deactivate a controller, and activate it again later."""
        name, loop = self._stack.hand.name if act.hand else self._arm.name, self._stack.loop
        if act.impossible:
            self._switch_impossible(name)
            return
        loop.manager.switch(SwitchRequest(deactivate=(name,)), loop.within_limits)
        self._later(act.for_s, lambda: self._activate(name))

    def _switch_impossible(self, name: str) -> None:
        """Request a strict switch that must be rejected."""
        loop = self._stack.loop
        loop.manager.switch(SwitchRequest(("unknown_controller",), (name,), Strictness.STRICT), loop.within_limits)
        self.half_switched = True

    def configure(self, act: Configure) -> None:
        """Change the parameters of the arm controller, unless a goal is running."""
        stack, name = self._stack, self._arm.name
        if self._arm.newest is not None and not self._arm.newest.done:
            return
        values = self._arm.parameters.model_dump()
        constraints, values["allow_partial_joints_goal"] = values["constraints"], act.partial
        constraints["goal_time"] = act.goal_time_s or constraints["goal_time"]
        for joint in self._arm.joints:
            constraints[joint]["trajectory"] = act.path_tolerance or constraints[joint]["trajectory"]
            constraints[joint]["goal"] = act.goal_tolerance or constraints[joint]["goal"]
        client = ManagerClient(stack.loop, stack.control_stack.factory)
        client.change(name, TrajectoryParameters.model_validate(values))

    def reactivate(self, act: Reactivate) -> None:
        """Deactivate the hardware and activate it again later, or activate it again when joints are limp."""
        loop = self._stack.loop
        running = [one.spec.name for one in loop.manager.registry.running if one.controller.command_interfaces]
        transitions, components = loop.component_transitions, [one.name for one in loop.hardware.components]

        def activate() -> None:
            for name in components:
                self._stack.activations.append(transitions.ask(name, LifecycleState.ACTIVE))

        def activate_all() -> None:
            activate()
            self._later(2.0 * loop.period_s, lambda: self._activate(*running))

        def push(limp: Collection[str]) -> None:
            self._push(limp, act.push, PUSHED_S)
            self._later(PUSHED_S, activate)

        if act.for_s == 0.0:
            self._when_limp(push)
            return
        for name in components:
            transitions.ask(name, LifecycleState.INACTIVE, act.relax)
        if act.relax:
            self._push(loop.hardware.joints, act.push, act.for_s / 2.0)
        self._later(act.for_s, activate_all)

    def _activate(self, *names: str) -> None:
        loop = self._stack.loop
        for name in names:
            try:
                loop.manager.switch(SwitchRequest(activate=(name,)), loop.within_limits)
            except ManagerError as error:
                LOG.info("a simulated client's request was rejected: %s", error)

    def _when_limp(self, action: Callable[[Collection[str]], None]) -> None:
        """Call ``action`` with the names of the limp joints of the active hardware, as soon as there are any."""
        parts = [one.hardware for one in self._stack.loop.hardware.components if one.active]
        limp = {name for part in parts if isinstance(part, Reactivating) for name in part.without_torque}
        if limp:
            action(limp)
        else:
            self._later(LOOKS_S, lambda: self._when_limp(action))

    def _push(self, limp: Collection[str], share: float, for_s: float) -> None:
        """Push limp joints, as a person may do before an activation."""
        stack = self._stack
        for joint in stack.files.robot.joints:
            if joint.name in limp and share:
                pull = share * PULL_SHARE * joint.full_effort
                stack.world.load(joint.name, pull)
                self._later(for_s, partial(stack.world.load, joint.name, -pull))
