"""Handle keys, a lost leader and limp follower servos during teleoperation."""

from collections.abc import Callable, Iterator
from typing import Any, Final, Protocol

from controller.manager.requests import Request
from controller.manager.switch import SwitchRequest
from controller.manager_errors import ManagerError
from drivers.driver_errors import DriverError
from hal.components.component import Component
from hal.hal_errors import HalError
from hal.lifecycle import LifecycleState
from hal.servos.leader_arm import LEADER
from servoloop.manual.dead_man import Keys
from servoloop.teleop.arms import NAME, Teleop

AGAIN_S: Final = 1.0
"""Time between attempts to reconnect a lost leader, in seconds."""
REACTIVATE: Final = "a"
"""Key that enables the torque of limp follower servos again."""
HINT: Final = f"press {REACTIVATE} to enable their torque again at their current position"
REFUSED: Final = (DriverError, HalError, ManagerError, RuntimeError)
"""Errors of refused requests. After its last cycle, the loop refuses all requests with RuntimeError."""
HANDS_FREE_HINT: Final = "press Ctrl-C and start teleop again to enable their torque"


class TeleopOperator(Keys, Protocol):
    """User interface that reads keys and displays both arms."""

    @property
    def hint(self) -> str:
        """Instruction for enabling the torque of limp follower servos again."""
        ...

    def show(self, both: Teleop, notes: list[str]) -> None:
        """Display both arms and additional notes. The method is called many times per second."""
        ...


class Attendance:
    """Supervisor of both arms, which runs in the user interface thread."""

    def __init__(self, both: Teleop, person: TeleopOperator, end: Callable[[], None]) -> None:
        """``end`` is a function that stops the loop."""
        self._both, self._person, self._end = both, person, end
        self._tried_s = 0.0
        self._leader: Request[None] | None = None
        self._reactivation: Iterator[Request[Any]] | None = None
        self._step: Request[Any] | None = None
        self._problem = ""

    def update(self, now_s: float) -> None:
        """Respond to keys and faults without blocking."""
        both, person = self._both, self._person
        both.controller.allowed = person.allowed(now_s)
        if person.ended() or both.lost:
            self._end()
        if both.leader.error is not None and now_s - self._tried_s > AGAIN_S:
            self._tried_s = now_s
            self._leader = both.loop.component_transitions.ask(LEADER, LifecycleState.INACTIVE)
        if REACTIVATE in person.commands() and self._reactivation is None and self._limp():
            self._reactivation, self._step, self._problem = self._reactivate(self._limp()), None, ""
        self._continue_reactivation()
        person.show(both, list(self._notes()))

    def _limp(self) -> list[Component]:
        """Return the follower components that have limp servos, or that are inactive after a failed reactivation."""
        state = self._both.latency.state
        limp = {joint for joint, fault in state.faults.items() if fault.kind == "no_torque"} if state else set()
        return [
            one
            for one in self._both.loop.hardware.components
            if one is not self._both.leader and (limp.intersection(one.hardware.joints) or not one.active)
        ]

    def _reactivate(self, components: list[Component]) -> Iterator[Request[Any]]:
        """Yield the requests of a reactivation one by one. Servos whose torque is already enabled keep it enabled."""
        loop = self._both.loop
        for one in components:
            yield loop.component_transitions.ask(one.name, LifecycleState.INACTIVE)
            yield loop.component_transitions.ask(one.name, LifecycleState.ACTIVE)
        yield loop.requests.ask(lambda: loop.manager.switch(SwitchRequest(activate=(NAME,)), loop.command))

    def _continue_reactivation(self) -> None:
        """Start the next step of a reactivation when the previous step is complete."""
        if self._reactivation is None or (self._step is not None and not self._step.done):
            return
        try:
            if self._step is not None:
                self._step.result()
            self._step = next(self._reactivation, None)
        except REFUSED as error:
            self._step, self._problem = None, str(error)
        if self._step is None:
            self._reactivation = None

    def _notes(self) -> Iterator[str]:
        if self._both.leader.error is not None and (problem := _problem(self._leader)):
            yield problem
        if self._reactivation is not None:
            yield "enabling torque"
        elif self._limp():
            yield from filter(None, (self._problem, self._person.hint))


def _problem(request: Request[None] | None) -> str:
    """Return the error of a failed request, or an empty string."""
    if request is None or not request.done:
        return ""
    try:
        request.result()
    except REFUSED as error:
        return str(error)
    return ""
