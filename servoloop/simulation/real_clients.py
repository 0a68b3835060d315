"""Simulated time for real clients: what ``servoloop up --rtf`` and ``--step`` have instead of the machine's clock."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from controller.loop import ControlLoop
from hal.types import JointState
from servoloop.background_worker import BackgroundWorker
from servoloop.simulation.pace import LOOK_S, Pace
from servoloop.simulation.virtual_lines import VirtualLines
from sim_backend.clock import SimulatedClock

if TYPE_CHECKING:
    from nodes.surface import Surface


class SimulatedTime:
    """One thread advances it, the loop's: each cycle as fast as it can, then it waits for its clients and its pace."""

    def __init__(self, pace: Pace) -> None:
        self.clock = SimulatedClock()
        self.pace = pace
        self.lines: VirtualLines | None = None
        """Where there are servos."""
        self._loop: ControlLoop
        self._surface: Surface

    def connect(self, loop: ControlLoop, surface: "Surface") -> None:
        """Set who is paced, and who shows it."""
        self._loop, self._surface = loop, surface
        self.pace.on_done = surface.wake
        loop.on_cycle = self._on_cycle

    def before_cycle(self, ended: Callable[[], bool]) -> None:
        """Return when the next cycle may run, or soon after ``ended``. In the loop's thread."""
        while not (self._surface.wait_until_published(LOOK_S) or ended()):
            pass
        self.pace.wait(self.clock.now(), lambda: self._serve() or ended())

    def _on_cycle(self, state: JointState) -> None:
        if self.lines is not None:
            self.lines.advance(self.clock.now())
        self._surface.post(state)

    def _serve(self) -> bool:
        """Controllers can be loaded and switched while the simulation is paused, as before its first step."""
        if self.pace.paused and self._loop.requests.inbox:
            self._loop.requests.serve()
            self._surface.wake()
        return False


class InLoopsThread(BackgroundWorker):
    """Work that takes longer than a cycle: simulated time passes in the loop's thread only."""

    def __call__(self, work: Callable[[], None]) -> None:
        work()
