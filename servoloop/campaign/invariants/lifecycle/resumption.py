"""Invariant on controllers: they are active again after limp joints have been activated."""

from collections.abc import Callable
from typing import Final

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.lifecycle import LifecycleState
from hal.types import JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.simulation.faulty_stack import FaultyStack

RESUME_CYCLES: Final = 3
"""Number of cycles after which controllers must be active again."""


class ControllersResume(Invariant):
    """After the limp joints of active hardware have been activated again, the same controllers are active as before.

    A controller whose joints another controller has claimed in the meantime is not examined. If joints are still limp,
    the activation has failed, and the controllers stay inactive.
    """

    name = "controllers resume"
    promised = False

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._running: set[str] = set()
        """Names of the active controllers with command interfaces, in the last cycle without a transition."""
        self._stayed_active = False
        """Whether the hardware has stayed active since the last cycle without a transition."""
        self._cycles: int | None = None
        """Number of cycles since the end of a transition; None if no transition is examined."""

    def on_state(self, state: JointState) -> None:
        components, registry = self.stack.loop.hardware.components, self.stack.manager.registry
        running = {one.spec.name for one in registry.running if one.controller.command_interfaces}
        stays = all(one.hardware.state is LifecycleState.ACTIVE and one.error is None for one in components)
        if any(one.leaving or one.switching for one in components):
            self._stayed_active = stays and (self._cycles is None or self._stayed_active)
            self._cycles = 0
            return
        self._stayed_active = self._stayed_active and stays
        if self._cycles is not None:
            self._cycles += 1
            failed = any(one.incomplete for one in components) or self.upset or self.stack.ending
            examined = self._stayed_active and not failed and bool(self._running)
            if not examined or not self._missing(running):
                self.examined += examined
                self._cycles = None
            elif self._cycles > RESUME_CYCLES:
                names = ", ".join(sorted(self._missing(running)))
                self.say(f"limp joints were activated again, but not their controllers: {names}")
                self._cycles = None
        if self._cycles is None:
            self._running = running

    def _missing(self, running: set[str]) -> set[str]:
        """Return the former controllers that are not active and whose joints no other controller has claimed."""
        registry = self.stack.manager.registry
        return {
            name
            for name in self._running - running
            if (controller := registry.loaded[name].controller) is not None
            and not any(one in registry.claimed for one in controller.command_interfaces)
        }
