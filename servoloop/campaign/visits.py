"""The visits of a run: which faults it met in which phase, on which make of servo, at which act of a client."""

from collections import Counter
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple

from drivers.servos.catalog import series_of
from hal.joint import Joint
from hal.lifecycle import LifecycleState
from hal.types import JointState
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.touches import touched_joints
from sim_backend.faults.event import Event

Phase = Literal["starting", "idle", "goal", "canceling", "after a goal", "inactive", "ending"]
PHASES: Final[tuple[Phase, ...]] = ("starting", "idle", "goal", "canceling", "after a goal", "inactive", "ending")
NO_SERVO: Final = "none"
"""The make where a fault touches no servo, but the machine or a program."""


JOB: Final = "job"
"""The client before the first act of another one."""


class Visit(NamedTuple):
    """One cell of the table of visits."""

    phase: str
    fault: str
    make: str
    client: str


def makes_of(event: Event, joints: Sequence[Joint]) -> set[str]:
    """The makes of the servos that a fault touches."""
    touched = touched_joints(event, joints)
    return {series_of(joint.model).make for joint in joints if joint.name in touched} or {NO_SERVO}


class Visits:
    """Counts the cycles of one run in which each cell was visited; ``update`` and ``end`` are called by the watch."""

    def __init__(self, stack: FaultyStack) -> None:
        self.cycles = Counter[Visit]()
        self._stack = stack
        self._seen = 0
        self._begun = False

    def update(self, state: JointState) -> None:
        """Count one cycle."""
        self._count(self._phase() if self._begun else "starting")
        self._begun = True

    def end(self) -> None:
        """Count what happened after the last cycle, while the program ended."""
        self._count("ending")

    def _count(self, phase: Phase) -> None:
        player = self._stack.player
        recent = player.happened[self._seen :]
        self._seen = len(player.happened)
        for event in {id(event): event for event in (*player.active.values(), *recent)}.values():
            for make in makes_of(event, self._stack.files.robot.joints):
                self.cycles[Visit(phase, event.kind, make, self._client())] += 1

    def _client(self) -> str:
        clients = self._stack.clients
        return clients.newest or JOB if clients is not None else JOB

    def _phase(self) -> Phase:
        stack = self._stack
        if stack.loop.hardware.state is not LifecycleState.ACTIVE:
            return "inactive"
        if any(goal.cancel_s is not None for goal in stack.goals.open):
            return "canceling"
        if stack.goals.open:
            return "goal"
        return "after a goal" if stack.goals.goals else "idle"
