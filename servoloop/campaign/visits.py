"""Count the visits of a run: the cycles in which each fault was active, by phase, servo make and client."""

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
"""Servo make given for a fault that affects the machine or a program instead of a servo."""

JOB: Final = "job"
"""Client name for visits that occur before any other client performs its first action."""


class Visit(NamedTuple):
    """Cell in the table of visits."""

    phase: str
    fault: str
    make: str
    client: str


def makes_of(event: Event, joints: Sequence[Joint]) -> set[str]:
    """Return the makes of the servos that a fault affects."""
    touched = touched_joints(event, joints)
    return {series_of(joint.model).make for joint in joints if joint.name in touched} or {NO_SERVO}


class Visits:
    """Counter of the cycles of one run that fall into each cell. The watch calls ``update`` and ``end``."""

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
        """Count the faults that were active after the last cycle, while the program was ending."""
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
