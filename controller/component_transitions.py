"""Change the state of hardware components while the loop runs, at a client's request or after a component is lost."""

import logging
from collections import deque
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Final

from controller.manager.manager import ControllerManager
from controller.manager.requests import ENDED, Request
from drivers.bus.retry import ATTEMPTS
from drivers.driver_errors import DriverError
from hal.components.component import CONFIGURED, Component
from hal.components.component_set import ComponentSet
from hal.hal_errors import ActivationError, HalError, LifecycleError
from hal.hardware import Reactivating, outputs_of, undo_activation
from hal.lifecycle import LifecycleState
from hal.types import JointState

LOG = logging.getLogger("servoloop.controller")

UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = LifecycleState

BackgroundWorker = Callable[[Callable[[], None]], None]
"""Function that runs a task that takes longer than a cycle. Except in tests, the task runs in another thread."""


def run_at_once(work: Callable[[], None]) -> None:
    """Run a task in the calling thread. Use this function as the background worker if no other thread is available."""
    work()


@dataclass(frozen=True, slots=True)
class TransitionRules:
    """Rules for the transitions of components while the loop runs."""

    keep_alive: bool = False
    """Whether the loop continues after the last component is lost, so that a client can reactivate the component.
    """
    background_worker: BackgroundWorker = run_at_once
    """Function that runs a task that takes longer than a cycle."""


NO_BACKGROUND: Final = TransitionRules()
"""Default rules: the loop ends when its last component is lost, and all work runs in the loop thread."""


class ComponentTransition(Request[None]):
    """A request to bring one component to another state, created by ``ComponentTransitions.ask``.

    ``result`` raises an error if the component did not reach the state.
    """

    def __init__(self, name: str, target: LifecycleState, relax: bool) -> None:
        super().__init__(lambda: None)
        self.name = name
        self.target = target
        self.relax = relax
        self.error_in_background: Exception | None = None
        """Error raised by the background work."""
        self.reactivated: frozenset[str] | None = None
        """Joints of an active component that are being reactivated. The set is empty if the reactivation failed."""
        self.controllers: list[str] = []
        """Controllers that are deactivated for this transition and reactivated after it."""
        self.torque_queries = 0
        """Number of times that the servos of an active component were asked whether their torque is enabled."""

    def __str__(self) -> str:
        if self.reactivated is not None:
            return f"joints of {self.name} are being activated again"
        return f"{self.name} is being set to {self.target.name.lower()}"


@dataclass(frozen=True, slots=True)
class _Leaving:
    """A component whose joints must come to rest before the component changes its state or is dropped."""

    component: Component
    transition: ComponentTransition | None


class ComponentTransitions:
    """The transitions of all components. The transitions of one component run one after another.

    In an ordinary cycle, ``asked``, ``returned``, ``arrived`` and ``leaving`` are empty, so the loop does not call any
    method.
    """

    def __init__(
        self,
        hardware: ComponentSet,
        manager: ControllerManager,
        take_over: Callable[[Component, JointState, Collection[str] | None], None],
        resume: Callable[[Sequence[str], JointState], None],
        rules: TransitionRules,
    ) -> None:
        """Connect the transitions to the loop.

        Args:
            hardware: All components.
            manager: The controller manager.
            take_over: Function that starts commanding an activated component, or only the given joints of the
                component. The function raises an error on failure.
            resume: Function that reactivates controllers.
            rules: Rules for the transitions.
        """
        self.asked: deque[ComponentTransition] = deque()
        """Requested transitions, including those that wait for another transition of the same component.

        Any thread may append.
        """
        self.returned: deque[tuple[Component, ComponentTransition]] = deque()
        """Components that have finished their background work. Background threads append components, and the loop
        removes them.
        """
        self.arrived: list[tuple[Component, ComponentTransition]] = []
        """Activated components that the loop will take over at their next measured positions."""
        self.leaving: list[_Leaving] = []
        self._hardware = hardware
        self._manager = manager
        self._take_over, self._resume = take_over, resume
        self._rules = rules
        self._ended = False

    def ask(self, name: str, target: LifecycleState, relax: bool = False) -> ComponentTransition:
        """Request that a component change its state. Any thread may call this method. The call never blocks.

        Args:
            name: Name of the component.
            target: State to reach.
            relax: Whether a deactivation disables torque.

        Returns:
            The requested transition.
        """
        transition = ComponentTransition(name, target, relax)
        self.asked.append(transition)
        if self._ended:
            transition.refuse(RuntimeError(ENDED))
        return transition

    def begin_cycle(self) -> None:
        """Take back components whose background work has finished, and start the next transitions."""
        while self.returned:
            self._take_back(*self.returned.popleft())
        for _ in range(len(self.asked)):
            self._begin(self.asked.popleft())

    def after_read(self, state: JointState) -> None:
        """Include activated components in the cycle and drop failed components.

        If the last component is lost and the loop is not kept alive, raise that component's error.
        """
        for component, transition in self.arrived:
            self._take_in(component, transition, state)
        self.arrived.clear()
        self._give_up_the_lost()

    def end_cycle(self) -> None:
        """Drop components whose write failed, and continue the transitions of components that have come to rest.

        Raises the same errors as ``after_read``.
        """
        self._give_up_the_lost()
        for leaving in [entry for entry in self.leaving if not self._moves(entry.component)]:
            self.leaving.remove(leaving)
            self._left(leaving.component, leaving.transition)

    def end(self) -> None:
        """Reject every open transition. Call this method after the last cycle, when no background work remains."""
        self._ended = True
        for transition in (*self.asked, *(leaving.transition for leaving in self.leaving)):
            if transition is not None:
                transition.refuse(RuntimeError(ENDED))
        while self.returned:
            self._take_back(*self.returned.popleft())
        if self.arrived:
            state = self._hardware.read()
            for component, transition in self.arrived:
                self._take_in(component, transition, state)

    def _begin(self, transition: ComponentTransition) -> None:
        component = self._hardware.component(transition.name)
        if component is None:
            transition.refuse(LifecycleError(f"hardware component '{transition.name}' does not exist"))
        elif component.switching or self._in_transition(component):
            self.asked.append(transition)
        elif transition.target is ACTIVE and component.active:
            self._complete(component, transition)
        elif component.state is transition.target:
            transition.serve()
        elif component.state is FINALIZED:
            transition.refuse(LifecycleError(f"{component.name} is permanently finalized: restart the stack to use it"))
        elif component.state is ACTIVE:
            self._leave(component, transition, str(transition))
        else:
            self._switch_in_background(component, transition)

    def _in_transition(self, component: Component) -> bool:
        """Return whether a component is about to change its state, or its controllers are about to be resumed."""
        changing = (*(leaving.component for leaving in self.leaving), *(arrived for arrived, _ in self.arrived))
        return any(one is component for one in changing)

    def _complete(self, component: Component, transition: ComponentTransition) -> None:
        """Reactivate the limp joints of an active component, including those that the loop has not detected yet."""
        try:
            unanswered = self._hardware.ask_for_torque(component)
        except Exception as error:
            transition.refuse(error)
            return
        transition.torque_queries += 1
        if component.incomplete:
            transition.reactivated = frozenset()
            self._leave(component, transition, str(transition))
        elif not unanswered:
            transition.serve()
        elif transition.torque_queries < ATTEMPTS:
            self.asked.append(transition)  # The next cycle reports by name any servo that does not respond.
        else:
            names = ", ".join(sorted(unanswered))
            transition.refuse(
                LifecycleError(
                    f"{component.name}: {names} did not report whether torque is enabled: check the cable and try again"
                )
            )

    def _leave(self, component: Component, transition: ComponentTransition | None, reason: str) -> None:
        """Deactivate the controllers of a component in this cycle. The component's joints then come to rest."""
        ended = self._manager.release((*component.hardware.command_interfaces, *outputs_of(component.hardware)), reason)
        component.leaving = True
        self.leaving.append(_Leaving(component, transition))
        if transition is not None and transition.reactivated is not None:
            transition.controllers = ended

    def _moves(self, component: Component) -> bool:
        own = self._own(component)
        if component.error is not None:  # Unreachable joints cannot be relieved either.
            return self._manager.stops.holds(own)
        return not self._manager.cycle.at_rest(own)

    def _own(self, component: Component) -> range:
        """Return the indices of a component's command interfaces."""
        return range(len(self._hardware.command_interfaces))[component.commands]

    def _left(self, component: Component, transition: ComponentTransition | None) -> None:
        component.leaving = False
        if component.error is not None:
            self._hardware.drop(component)
        if transition is not None and component.error is not None:
            transition.refuse(component.error)
        elif transition is not None:
            self._switch_in_background(component, transition)

    def _switch_in_background(self, component: Component, transition: ComponentTransition) -> None:
        """Run a transition in the background, possibly for several seconds. The loop skips the component until the
        transition ends."""
        component.switching = True

        def work() -> None:
            try:
                _bring(component, transition)
            except (DriverError, HalError) as error:
                transition.error_in_background = error
            except Exception as error:  # A defect in one component must not stop the others.
                LOG.exception("internal error while %s", transition)
                transition.error_in_background = error
            self.returned.append((component, transition))

        self._rules.background_worker(work)

    def _take_back(self, component: Component, transition: ComponentTransition) -> None:
        self._hardware.rejoin(component)
        if transition.target is ACTIVE and (transition.error_in_background is None or component.active):
            self.arrived.append((component, transition))
        elif transition.error_in_background is not None:
            transition.refuse(transition.error_in_background)
        else:
            transition.serve()

    def _take_in(self, component: Component, transition: ComponentTransition, state: JointState) -> None:
        try:
            if component.error is not None:
                raise component.error
            if transition.error_in_background is None:
                self._take_over(component, state, transition.reactivated)
                self._manager.cycle.leaving.restart(self._own(component))
        except Exception as error:
            if component.error is None:
                self._switch_off(component, undo=transition.reactivated is None)
            transition.refuse(error)
            return
        self._resume(self._to_resume(transition), state)
        if transition.error_in_background is not None:
            transition.refuse(transition.error_in_background)
        else:
            transition.serve()

    def _to_resume(self, transition: ComponentTransition) -> list[str]:
        """Return the controllers to activate after a transition.

        If a stream or freedrive of a program has ended during the transition, its joints return to the controllers that
        it had replaced.
        """
        loaded, manager = self._manager.registry.loaded, self._manager
        freed = {name for ended in transition.controllers if ended in loaded for name in loaded[ended].commands}
        return [name for name in manager.suspended.resumable() if not freed.isdisjoint(loaded[name].commands)]

    def _switch_off(self, component: Component, undo: bool) -> None:
        """Deactivate a component that cannot be commanded.

        ``undo`` specifies whether to disable only the torque that the activation has enabled.
        """
        try:
            problems = undo_activation(component.hardware) if undo else component.hardware.deactivate(relax=False)
        except Exception as error:  # A defect in one component affects only that component.
            problems = [f"could not switch {component.name} off: {error}"]
            self._hardware.lose(component, error)
        for problem in problems:
            LOG.error("torque may still be on: %s", problem)

    def _give_up_the_lost(self) -> None:
        hardware = self._hardware
        if not hardware.failures:
            return
        lost, hardware.failures = hardware.failures, []
        others = [
            other
            for other in hardware.components
            if other.error is None and (other.switching or other.state in CONFIGURED)
        ]
        if not others and not self._rules.keep_alive and lost[0].error is not None:
            raise lost[0].error  # When the loop ends, all joints that can be reached are stopped.
        for component in lost:
            if not any(leaving.component is component for leaving in self.leaving):
                self._leave(component, None, f"{component.name} is lost: {component.error}")


def _bring(component: Component, transition: ComponentTransition) -> None:
    """Bring a component to its target state step by step.

    If a step fails, its error is raised, and earlier steps are not undone.
    """
    hardware, target = component.hardware, transition.target
    problems: Sequence[str] = ()
    if hardware.state is UNCONFIGURED and target in CONFIGURED:
        hardware.configure()
    if hardware.state is INACTIVE and target is ACTIVE:
        hardware.activate()
    elif hardware.state is ACTIVE and isinstance(hardware, Reactivating) and target is ACTIVE:
        transition.reactivated = hardware.reactivate()
    elif hardware.state is ACTIVE:
        problems = hardware.deactivate(transition.relax)
    if target in (UNCONFIGURED, FINALIZED):
        hardware.cleanup()
        component.finalized = target is FINALIZED
    if problems:
        raise ActivationError(f"torque may still be on: {'; '.join(problems)}")
