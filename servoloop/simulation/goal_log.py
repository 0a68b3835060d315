"""The goals of a simulated stack's trajectory controllers, as their clients sent them, and what became of each."""

from collections.abc import Callable
from dataclasses import dataclass, field

from controller.trajectory.goal import GoalHandle, TrajectoryGoal


@dataclass(slots=True)
class LoggedGoal:
    """One goal. Times are in seconds of the stack's clock; None: that has not happened."""

    controller: str
    goal: TrajectoryGoal
    handle: GoalHandle
    sent_s: float
    cancel_s: float | None = None
    """When the client asked to cancel it."""
    ended_s: float | None = None
    """When the first cycle after its end was complete."""


@dataclass(slots=True)
class GoalLog:
    """All goals that were sent, in their order, and the reasons of those that were refused."""

    now: Callable[[], float]
    """The stack's clock, s."""
    goals: list[LoggedGoal] = field(default_factory=list)
    open: list[LoggedGoal] = field(default_factory=list)
    """The goals without an end."""
    refused: list[tuple[TrajectoryGoal, str]] = field(default_factory=list)

    def sent(self, controller: str, goal: TrajectoryGoal, handle: GoalHandle) -> None:
        """Log a goal that a controller has taken."""
        logged = LoggedGoal(controller, goal, handle, self.now())
        self.goals.append(logged)
        self.open.append(logged)

    def canceled(self, handle: GoalHandle) -> None:
        """Log that a client asks to cancel a goal."""
        for logged in self.open:
            if logged.handle is handle and logged.cancel_s is None:
                logged.cancel_s = self.now()

    def end_cycle(self) -> list[LoggedGoal]:
        """Close the goals that have ended; returns them."""
        ended = [logged for logged in self.open if logged.handle.done]
        for logged in ended:
            logged.ended_s = self.now()
            self.open.remove(logged)
        return ended
