"""What becomes of hardware components while the loop runs: some are lost, and some are switched by a user."""

import logging
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from controller.requests import ENDED, Request
from drivers.errors import DriverError
from hal.errors import HalError, LifecycleError
from hal.lifecycle import LifecycleState
from hal.member import CONFIGURED, Member
from hal.types import JointState

if TYPE_CHECKING:
    from controller.loop import ControlLoop

LOG = logging.getLogger("servoloop.controller")

UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = LifecycleState

Aside = Callable[[Callable[[], None]], None]
"""Has something done that takes longer than a cycle; outside of tests, by another thread."""


def at_once(work: Callable[[], None]) -> None:
    """There is no other thread."""
    work()


class Change(Request[None]):
    """One component's way to another state. Made by ``Changes.ask``; ``result`` raises why it did not get there."""

    def __init__(self, name: str, target: LifecycleState, relax: bool) -> None:
        super().__init__(lambda: None)
        self.name = name
        self.target = target
        self.relax = relax
        self.trouble: Exception | None = None
        """Of the work aside."""

    def __str__(self) -> str:
        return f"{self.name} is being set {self.target.name.lower()}"


@dataclass(frozen=True, slots=True)
class _Leaving:
    """A component whose joints come to rest before something is done with it."""

    member: Member
    change: Change | None


class Changes:
    """The part of the loop that looks after the components. A component's changes come one after the other."""

    def __init__(self, loop: "ControlLoop", stay: bool, aside: Aside) -> None:
        self._loop = loop
        self.stay = stay
        self._aside = aside
        self._asked: deque[Change] = deque()
        self._leaving: list[_Leaving] = []
        self._returned: deque[tuple[Member, Change]] = deque()
        """From the threads aside: they append, the loop takes."""
        self._arrived: list[tuple[Member, Change]] = []
        self._ended = False

    def ask(self, name: str, target: LifecycleState, relax: bool = False) -> Change:
        """Bring a component to a state. From any thread; never waits. ``relax``: a deactivation lets go."""
        change = Change(name, target, relax)
        self._asked.append(change)
        if self._ended:
            change.refuse(RuntimeError(ENDED))
        return change

    def begin_cycle(self) -> None:
        """Take back what was done aside, and begin what is next."""
        while self._returned:
            self._take_back(*self._returned.popleft())
        for _ in range(len(self._asked)):
            self._begin(self._asked.popleft())

    def after_read(self, state: JointState) -> None:
        """Those that have been activated take part from here on; those that failed do not.

        Raises why the last component is lost.
        """
        for member, change in self._arrived:
            self._take_in(member, change, state)
        self._arrived.clear()
        self._give_up_the_lost()

    def end_cycle(self) -> None:
        """What failed while it was written to, and what has come to rest. Raises as ``after_read`` does."""
        self._give_up_the_lost()
        for leaving in [one for one in self._leaving if not self._coasts(one.member)]:
            self._leaving.remove(leaving)
            self._left(leaving.member, leaving.change)

    def end(self) -> None:
        """After the last cycle, when nothing is done aside any more: whoever still waits is told."""
        self._ended = True
        for change in (*self._asked, *(leaving.change for leaving in self._leaving)):
            if change is not None:
                change.refuse(RuntimeError(ENDED))
        while self._returned:
            self._take_back(*self._returned.popleft())
        if self._arrived:
            state = self._loop.hardware.read()
            for member, change in self._arrived:
                self._take_in(member, change, state)

    def _begin(self, change: Change) -> None:
        member = self._loop.hardware.member(change.name)
        if member is None:
            change.refuse(LifecycleError(f"hardware component '{change.name}' does not exist"))
        elif member.away or any(leaving.member is member for leaving in self._leaving):
            self._asked.append(change)
        elif member.state is change.target:
            change.serve()
        elif member.state is FINALIZED:
            change.refuse(LifecycleError(f"{member.name} is finalized, which is its end: start the stack anew"))
        elif member.state is ACTIVE:
            self._leave(member, change, str(change))
        else:
            self._go_aside(member, change)

    def _leave(self, member: Member, change: Change | None, reason: str) -> None:
        """Its controllers end in this very cycle; then its joints come to rest."""
        self._loop.manager.release(member.hardware.command_interfaces, reason)
        self._leaving.append(_Leaving(member, change))

    def _coasts(self, member: Member) -> bool:
        own = range(len(self._loop.kinds))[member.commands]
        return self._loop.manager.coasting.holds(own)

    def _left(self, member: Member, change: Change | None) -> None:
        if member.error is not None:
            self._loop.hardware.drop(member)
        if change is not None and member.error is not None:
            change.refuse(member.error)
        elif change is not None:
            self._go_aside(member, change)

    def _go_aside(self, member: Member, change: Change) -> None:
        """The component is out of the cycle until it comes back: this may take seconds."""
        member.away = True

        def work() -> None:
            try:
                _bring(member, change)
            except (DriverError, HalError) as error:
                change.trouble = error
            except Exception as error:  # a defect of one component: the others go on
                LOG.exception("a defect while %s", change)
                change.trouble = error
            self._returned.append((member, change))

        self._aside(work)

    def _take_back(self, member: Member, change: Change) -> None:
        self._loop.hardware.welcome(member)
        if change.trouble is not None:
            change.refuse(change.trouble)
        elif change.target is ACTIVE:
            self._arrived.append((member, change))
        else:
            change.serve()

    def _take_in(self, member: Member, change: Change, state: JointState) -> None:
        try:
            if member.error is not None:
                raise member.error
            self._loop.take_over(member, state)
        except Exception as error:
            if member.error is None:
                self._let_go(member)
            change.refuse(error)
        else:
            change.serve()

    def _let_go(self, member: Member) -> None:
        try:
            problems = member.hardware.deactivate(relax=True)
        except Exception as error:  # a defect of one component loses this one
            problems = [f"could not switch {member.name} off: {error}"]
            self._loop.hardware.lose(member, error)
        for problem in problems:
            LOG.error("torque may still be on: %s", problem)

    def _give_up_the_lost(self) -> None:
        hardware = self._loop.hardware
        if not hardware.failures:
            return
        lost, hardware.failures = hardware.failures, []
        others = [m for m in hardware.members if m.error is None and (m.away or m.state in CONFIGURED)]
        if not others and not self.stay and lost[0].error is not None:
            raise lost[0].error  # the loop's end stops the joints, as far as they can be reached
        for member in lost:
            if not any(leaving.member is member for leaving in self._leaving):
                self._leave(member, None, f"{member.name} is lost: {member.error}")


def _bring(member: Member, change: Change) -> None:
    """Step by step. Raises what a step raises; the steps before it stay done."""
    hardware, target = member.hardware, change.target
    if hardware.state is UNCONFIGURED and target in CONFIGURED:
        hardware.configure()
    if hardware.state is INACTIVE and target is ACTIVE:
        hardware.activate()
    elif hardware.state is ACTIVE:
        for problem in hardware.deactivate(change.relax):
            LOG.error("torque may still be on: %s", problem)
    if target in (UNCONFIGURED, FINALIZED):
        hardware.cleanup()
        member.finalized = target is FINALIZED
