"""Log of the messages that programs on the command socket of a simulated stack have sent and received."""

from dataclasses import dataclass, field
from typing import Any

from controller.trajectory.goal import GoalHandle

MotionKey = tuple[str, str, int]
"""Name of a program, kind of its motion (``motion`` or ``goal``), and the number in the stack's reply."""


@dataclass(slots=True)
class ProgramLog:
    """Events that programs have received, and the messages and motions without a reply or a result."""

    events: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    """Events since an invariant last cleared this list, each with the name of its program."""
    motions: dict[MotionKey, tuple[GoalHandle, ...]] = field(default_factory=dict)
    """The goals of each motion that a connected program has started."""
    unanswered: dict[tuple[str, str], float] = field(default_factory=dict)
    """Time at which each unanswered message was sent, in seconds, keyed by its program and its ID."""
    streamed: set[str] = field(default_factory=set)
    """Joints that the targets of the latest stream have named."""
    watching: set[str] = field(default_factory=set)
    """Programs that receive states."""
    released: set[str] = field(default_factory=set)
    """Programs that have released control of the arm, or disconnected, since an invariant last cleared this set."""

    def hang_up(self, program: str) -> None:
        """Log that a program has disconnected."""
        self.released.add(program)
        self.watching.discard(program)
        self.motions = {key: goals for key, goals in self.motions.items() if key[0] != program}
        self.unanswered = {key: sent_s for key, sent_s in self.unanswered.items() if key[0] != program}
