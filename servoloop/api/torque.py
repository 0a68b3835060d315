"""Disable and enable the torque of a running stack while no motion is running."""

from collections.abc import Callable
from typing import Final

from controller.manager.switch import SwitchRequest
from drivers.driver_errors import DriverError
from hal.hal_errors import HalError
from hal.lifecycle import LifecycleState
from servoloop.api.arm_errors import ArmError, ArmTimeoutError
from servoloop.stack.control_stack import ControlStack

TORQUE_S: Final = 15.0
"""Maximum time to enable or disable the torque, in seconds. Each servo that does not respond delays the change."""


class TorqueSwitch:
    """Torque of all servos in one stack."""

    def __init__(
        self,
        stack: ControlStack,
        wait: Callable[[Callable[[], bool], float], bool],
        in_loop: Callable[[Callable[[], None]], None],
    ) -> None:
        """``wait`` waits for a condition, and ``in_loop`` runs an action between two cycles."""
        self._stack, self._wait, self._in_loop = stack, wait, in_loop

    @property
    def on(self) -> bool:
        """Whether all components are active."""
        return all(one.state is LifecycleState.ACTIVE for one in self._stack.loop.hardware.components)

    def release(self) -> None:
        """Bring the joints to rest, then disable their torque. Raises ArmError."""
        loop = self._stack.loop

        def deactivate() -> None:
            running = loop.manager.registry.running
            active = tuple(entry.spec.name for entry in running if entry.controller.command_interfaces)
            loop.manager.switch(SwitchRequest(deactivate=active), loop.within_limits)
            loop.manager.suspended.add(active)

        self._in_loop(deactivate)
        self._bring(LifecycleState.INACTIVE)

    def enable(self) -> None:
        """Enable the torque at the measured positions, and activate the controllers that were active before the torque
        was disabled or a component was lost.

        If the torque of one component cannot be enabled, the controllers of the others are still activated. Raises
        ArmError.
        """
        try:
            self._bring(LifecycleState.ACTIVE)
        except ArmError:
            self._in_loop(self._resume)
            raise
        self._in_loop(self._resume)

    def _resume(self) -> None:
        loop = self._stack.loop
        if names := loop.manager.suspended.resumable():
            loop.manager.switch(SwitchRequest(activate=names), loop.within_limits)

    def _bring(self, target: LifecycleState) -> None:
        loop = self._stack.loop
        asked = [
            loop.component_transitions.ask(one.name, target, relax=target is LifecycleState.INACTIVE)
            for one in loop.hardware.components
        ]
        if not self._wait(lambda: all(one.done for one in asked), TORQUE_S):
            raise ArmTimeoutError(f"the servos did not switch their torque within {TORQUE_S:.0f} s: check the cables")
        for one in asked:
            try:
                one.result()
            except (DriverError, HalError, RuntimeError) as error:
                raise ArmError(f"the torque cannot be changed: {error}") from error
