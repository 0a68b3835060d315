"""Runs of smaller and smaller schedules, in this process or in another one."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from servoloop.campaign.campaign import files_of, run_schedule_of
from servoloop.campaign.contradictions import in_schedule
from servoloop.campaign.quiet import quiet
from servoloop.campaign.run import NO_HANG, NOT_KILLED
from servoloop.campaign.shrink import shrink
from servoloop.campaign.supervised import Loss, Supervisor
from servoloop.campaign.workers import Stop
from servoloop.simulation.schedule import Schedule
from sim_backend.faults.errors import FaultError

Violated = Callable[[Schedule], set[str]]
"""The invariants that a run of a schedule violates."""
LAST: Final = {NO_HANG, NOT_KILLED}
"""Violations after which no smaller schedule is looked for: the next runs would hang or be killed, too."""


def smallest(schedule: Schedule, invariant: str, violated: Violated, stop: Stop) -> Schedule:
    """The smallest schedule found that breaks the invariant as this one does; after ``stop`` none is looked for."""
    seen: set[str] = set()

    def breaks(one: Schedule) -> bool:
        names = violated(one)
        seen.update(names)
        return invariant in names

    with quiet():
        return shrink(schedule, breaks, lambda: bool(LAST & seen) or stop())


def violated(schedule: Schedule) -> set[str]:
    """The invariants that a run of the schedule violates; none if its arm cannot have its faults, or do its acts."""
    if any(in_schedule(schedule, files_of(schedule.arm))):
        return set()
    try:
        return {violation.invariant for violation in run_schedule_of(schedule).violations}
    except FaultError:
        return set()


@contextmanager
def violated_apart() -> Iterator[Violated]:
    """``violated`` in a process of its own: a run that is killed ends only this process."""
    supervisor = Supervisor()

    def names(schedule: Schedule) -> set[str]:
        found = supervisor.run(violated, schedule)
        if isinstance(found, Loss):
            return {NO_HANG if found.hung else NOT_KILLED}
        return found

    try:
        yield names
    finally:
        supervisor.close()
