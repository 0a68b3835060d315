"""Component transitions while the loop runs: a component is lost, or a user switches its state."""

import logging
from collections import deque
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

from controller.manager.manager import ControllerManager
from controller.manager.requests import ENDED, Request
from drivers.bus.retry import ATTEMPTS
from drivers.errors import DriverError
from hal.components.component import CONFIGURED, Component
from hal.components.component_set import ComponentSet
from hal.errors import HalError, LifecycleError
from hal.hardware import Reactivating, undo_activation
from hal.lifecycle import LifecycleState
from hal.types import JointState

LOG = logging.getLogger("servoloop.controller")

UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = LifecycleState

BackgroundWorker = Callable[[Callable[[], None]], None]
"""Runs work that takes longer than a cycle; outside of tests, in another thread."""


def run_at_once(work: Callable[[], None]) -> None:
    """The background worker where there is no other thread."""
    work()


class ComponentTransition(Request[None]):
    """One component's way to another state, as ``ComponentTransitions.ask`` makes it.

    ``result`` raises why the component did not get there.
    """

    def __init__(self, name: str, target: LifecycleState, relax: bool) -> None:
        super().__init__(lambda: None)
        self.name = name
        self.target = target
        self.relax = relax
        self.error_in_background: Exception | None = None
        """Raised by the work in the background."""
        self.reactivated: frozenset[str] | None = None
        """Of a component that was active already: the joints that are activated again, none where that failed."""
        self.controllers: list[str] = []
        """Those that end meanwhile, and begin again after it."""
        self.questions = 0
        """Of a component that was active already: how often its joints were asked whether they have torque."""

    def __str__(self) -> str:
        if self.reactivated is not None:
            return f"joints of {self.name} are being activated again"
        return f"{self.name} is being set {self.target.name.lower()}"


@dataclass(frozen=True, slots=True)
class _Leaving:
    """A component whose joints come to rest before it is switched or given up."""

    component: Component
    transition: ComponentTransition | None


class ComponentTransitions:
    """The loop's part that looks after the components. A component's transitions come one after the other.

    In an ordinary cycle ``asked``, ``returned``, ``arrived`` and ``leaving`` are empty, and nothing here is called.
    """

    def __init__(
        self,
        hardware: ComponentSet,
        manager: ControllerManager,
        take_over: Callable[[Component, JointState, Collection[str] | None], None],
        resume: Callable[[Sequence[str], JointState], None],
        keep_alive: bool,
        background_worker: BackgroundWorker,
    ) -> None:
        """``take_over`` begins to command a component that has been activated, or these joints of it; raises where it
        cannot. ``resume`` activates controllers again.
        """
        self.asked: deque[ComponentTransition] = deque()
        """By any thread; also those that wait for another transition of their component."""
        self.returned: deque[tuple[Component, ComponentTransition]] = deque()
        """From the background threads: they append, the loop takes."""
        self.arrived: list[tuple[Component, ComponentTransition]] = []
        """Activated components, to be taken over where the coming measurement finds them."""
        self.leaving: list[_Leaving] = []
        self._hardware = hardware
        self._manager = manager
        self._take_over, self._resume = take_over, resume
        self._keep_alive = keep_alive
        self._background_worker = background_worker
        self._ended = False

    def ask(self, name: str, target: LifecycleState, relax: bool = False) -> ComponentTransition:
        """Bring a component to a state. From any thread; never waits. ``relax``: a deactivation lets go."""
        transition = ComponentTransition(name, target, relax)
        self.asked.append(transition)
        if self._ended:
            transition.refuse(RuntimeError(ENDED))
        return transition

    def begin_cycle(self) -> None:
        """Take components back from the background, and begin the next transitions."""
        while self.returned:
            self._take_back(*self.returned.popleft())
        for _ in range(len(self.asked)):
            self._begin(self.asked.popleft())

    def after_read(self, state: JointState) -> None:
        """Activated components take part from here on; failed ones do not. Raises why the last component is lost."""
        for component, transition in self.arrived:
            self._take_in(component, transition, state)
        self.arrived.clear()
        self._give_up_the_lost()

    def end_cycle(self) -> None:
        """Give up components that failed in the write, and go on with those that have come to rest.

        Raises as ``after_read`` does.
        """
        self._give_up_the_lost()
        for leaving in [one for one in self.leaving if not self._moves(one.component)]:
            self.leaving.remove(leaving)
            self._left(leaving.component, leaving.transition)

    def end(self) -> None:
        """After the last cycle, when no work is left in the background: every open transition is refused."""
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
        elif component.switching or any(leaving.component is component for leaving in self.leaving):
            self.asked.append(transition)
        elif transition.target is ACTIVE and component.active:
            self._complete(component, transition)
        elif component.state is transition.target:
            transition.serve()
        elif component.state is FINALIZED:
            transition.refuse(LifecycleError(f"{component.name} is finalized, which is its end: start the stack anew"))
        elif component.state is ACTIVE:
            self._leave(component, transition, str(transition))
        else:
            self._switch_in_background(component, transition)

    def _complete(self, component: Component, transition: ComponentTransition) -> None:
        """Activate the joints of an active component that have no torque, even if no cycle has noticed it yet."""
        try:
            unanswered = self._hardware.ask_for_torque(component)
        except Exception as error:
            transition.refuse(error)
            return
        transition.questions += 1
        if component.incomplete:
            transition.reactivated = frozenset()
            self._leave(component, transition, str(transition))
        elif not unanswered:
            transition.serve()
        elif transition.questions < ATTEMPTS:
            self.asked.append(transition)  # a servo that is silent is named by the coming cycle
        else:
            names = ", ".join(sorted(unanswered))
            transition.refuse(
                LifecycleError(
                    f"{component.name}: {names} does not say whether it has torque: check the cable, and try once more"
                )
            )

    def _leave(self, component: Component, transition: ComponentTransition | None, reason: str) -> None:
        """Take a component's controllers out in this very cycle; then its joints come to rest."""
        ended = self._manager.release(component.hardware.command_interfaces, reason)
        self.leaving.append(_Leaving(component, transition))
        if transition is not None and transition.reactivated is not None:
            transition.controllers = ended

    def _moves(self, component: Component) -> bool:
        own = range(len(self._hardware.command_interfaces))[component.commands]
        if component.error is not None:  # joints that are not reached cannot be relieved
            return self._manager.stops.holds(own)
        return not self._manager.cycle.at_rest(own)

    def _left(self, component: Component, transition: ComponentTransition | None) -> None:
        if component.error is not None:
            self._hardware.drop(component)
        if transition is not None and component.error is not None:
            transition.refuse(component.error)
        elif transition is not None:
            self._switch_in_background(component, transition)

    def _switch_in_background(self, component: Component, transition: ComponentTransition) -> None:
        """The component is out of the cycle until it comes back: this may take seconds."""
        component.switching = True

        def work() -> None:
            try:
                _bring(component, transition)
            except (DriverError, HalError) as error:
                transition.error_in_background = error
            except Exception as error:  # a defect of one component: the others go on
                LOG.exception("a defect while %s", transition)
                transition.error_in_background = error
            self.returned.append((component, transition))

        self._background_worker(work)

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
        except Exception as error:
            if component.error is None:
                self._switch_off(component, undo=transition.reactivated is None)
            transition.refuse(error)
            return
        self._resume(transition.controllers, state)
        if transition.error_in_background is not None:
            transition.refuse(transition.error_in_background)
        else:
            transition.serve()

    def _switch_off(self, component: Component, undo: bool) -> None:
        """Deactivate a component that cannot be commanded; ``undo``: servos without torque before have none again."""
        try:
            problems = undo_activation(component.hardware) if undo else component.hardware.deactivate(relax=False)
        except Exception as error:  # a defect of one component loses this one
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
            one for one in hardware.components if one.error is None and (one.switching or one.state in CONFIGURED)
        ]
        if not others and not self._keep_alive and lost[0].error is not None:
            raise lost[0].error  # the loop's end stops the joints, as far as they can be reached
        for component in lost:
            if not any(leaving.component is component for leaving in self.leaving):
                self._leave(component, None, f"{component.name} is lost: {component.error}")


def _bring(component: Component, transition: ComponentTransition) -> None:
    """Bring a component to its target step by step. Raises a step's error; the steps before it stay done."""
    hardware, target = component.hardware, transition.target
    if hardware.state is UNCONFIGURED and target in CONFIGURED:
        hardware.configure()
    if hardware.state is INACTIVE and target is ACTIVE:
        hardware.activate()
    elif hardware.state is ACTIVE and isinstance(hardware, Reactivating) and target is ACTIVE:
        transition.reactivated = hardware.reactivate()
    elif hardware.state is ACTIVE:
        for problem in hardware.deactivate(transition.relax):
            LOG.error("torque may still be on: %s", problem)
    if target in (UNCONFIGURED, FINALIZED):
        hardware.cleanup()
        component.finalized = target is FINALIZED
