"""Log the goals sent to the trajectory controllers of a simulated stack, and their results."""

from collections.abc import Callable
from dataclasses import dataclass, field

from controller.trajectory.goal import GoalHandle, TrajectoryGoal


@dataclass(slots=True)
class LoggedGoal:
    """Logged goal. Times are in seconds on the stack's clock, or None for events that have not happened."""

    controller: str
    goal: TrajectoryGoal
    handle: GoalHandle
    sent_s: float
    cancel_s: float | None = None
    """Time of the client's cancel request."""
    ended_s: float | None = None
    """Time at the end of the cycle in which the goal finished."""


@dataclass(slots=True)
class GoalLog:
    """All sent goals in order, and all rejected goals with the reason for each rejection."""

    now: Callable[[], float]
    """Function that returns the time of the stack's clock, in seconds."""
    goals: list[LoggedGoal] = field(default_factory=list)
    open: list[LoggedGoal] = field(default_factory=list)
    """Goals that have not finished."""
    refused: list[tuple[TrajectoryGoal, str]] = field(default_factory=list)

    def sent(self, controller: str, goal: TrajectoryGoal, handle: GoalHandle) -> None:
        """Log a goal that a controller has accepted."""
        logged = LoggedGoal(controller, goal, handle, self.now())
        self.goals.append(logged)
        self.open.append(logged)

    def canceled(self, handle: GoalHandle) -> None:
        """Log a client's request to cancel a goal."""
        for logged in self.open:
            if logged.handle is handle and logged.cancel_s is None:
                logged.cancel_s = self.now()

    def end_cycle(self) -> list[LoggedGoal]:
        """Log the end of each goal that has finished, and return these goals."""
        ended = [logged for logged in self.open if logged.handle.done]
        for logged in ended:
            logged.ended_s = self.now()
            self.open.remove(logged)
        return ended
