"""Minimize a schedule that violates an invariant: keep only the faults, actions and jobs that the violation needs."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from servoloop.campaign.campaign import files_of, run_schedule_of
from servoloop.campaign.contradictions import in_schedule
from servoloop.campaign.run import NO_HANG, NOT_KILLED
from servoloop.campaign.supervised import Loss, Supervisor
from servoloop.campaign.workers import Stop, quiet
from servoloop.simulation.schedule import Schedule, after_the_end
from servoloop.stack.shipped_files import OWN
from sim_backend.faults.event import Event
from sim_backend.faults.fault_error import FaultError

Breaks = Callable[[Schedule], bool]
"""Function that returns whether a run of the schedule violates the invariant."""
Violated = Callable[[Schedule], set[str]]
"""Function that runs a schedule and returns the invariants that it violates."""
ROUND_S = (1.0, 0.1, 0.01)
"""Steps to which the times of faults are rounded, in seconds, coarsest first."""
SECONDS = (1.0, 3.0, 5.0)
"""Shorter durations to try for the time that the stack keeps running, in seconds."""
LAST: Final = {NO_HANG, NOT_KILLED}
"""Violations that end the search, because further runs would probably also hang or be killed."""


def smallest(schedule: Schedule, invariant: str, violated: Violated, stop: Stop) -> Schedule:
    """Return the smallest schedule found that violates the invariant. The search ends when ``stop`` returns True."""
    seen: set[str] = set()

    def breaks(candidate: Schedule) -> bool:
        names = violated(candidate)
        seen.update(names)
        return invariant in names

    with quiet():
        return shrink(schedule, breaks, lambda: bool(LAST & seen) or stop())


def violated(schedule: Schedule) -> set[str]:
    """Run a schedule and return the invariants that it violates. An impossible schedule violates no invariant."""
    if any(in_schedule(schedule, files_of(schedule.arm))):
        return set()
    try:
        return {violation.invariant for violation in run_schedule_of(schedule).violations}
    except FaultError:
        return set()


@contextmanager
def violated_apart() -> Iterator[Violated]:
    """Yield a function like ``violated`` that runs schedules in a separate process, so that killing a run ends only
    that process."""
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


def shrink(schedule: Schedule, breaks: Breaks, stop: Callable[[], bool] = lambda: False) -> Schedule:
    """Minimize a schedule with a greedy, deterministic search.

    Args:
        schedule: A schedule for which ``breaks`` returns True.
        breaks: Function that returns whether a schedule still violates the invariant.
        stop: Function that returns whether to end the search early.

    Returns:
        The smallest schedule found for which ``breaks`` returns True.
    """
    smaller = schedule
    while True:
        candidates = (one for one in _smaller(smaller) if one != smaller and not after_the_end(one))
        found = next((one for one in candidates if not stop() and breaks(one)), None)
        if found is None:
            return smaller
        smaller = found


def _smaller(schedule: Schedule) -> Iterator[Schedule]:
    """Yield schedules that are one step smaller, starting with the largest steps."""
    faults = schedule.faults
    half = len(faults) // 2
    if half > 1:
        yield schedule.model_copy(update={"faults": faults[:half]})
        yield schedule.model_copy(update={"faults": faults[half:]})
    for i in range(len(faults)):
        yield schedule.model_copy(update={"faults": (*faults[:i], *faults[i + 1 :])})
    acts = schedule.clients
    if len(acts) > 1:
        yield schedule.model_copy(update={"clients": acts[: len(acts) // 2]})
        yield schedule.model_copy(update={"clients": acts[len(acts) // 2 :]})
    for i in range(len(acts)):
        yield schedule.model_copy(update={"clients": (*acts[:i], *acts[i + 1 :])})
    if schedule.arm != OWN:
        yield schedule.model_copy(update={"arm": OWN})
    if schedule.limits:
        yield schedule.model_copy(update={"limits": {}})
    for key in ("firmware", "hurry_s", "on_exit"):
        if getattr(schedule, key) is not None:
            yield schedule.model_copy(update={key: None})
    for seconds in SECONDS:
        if seconds < schedule.seconds:
            yield schedule.model_copy(update={"seconds": seconds})
    for i in range(len(schedule.job)):
        yield schedule.model_copy(update={"job": (*schedule.job[:i], *schedule.job[i + 1 :])})
    if schedule.seed is not None:
        yield schedule.model_copy(update={"seed": None})
    if schedule.backlash_deg:
        yield schedule.model_copy(update={"backlash_deg": 0.0})
    for i, event in enumerate(faults):
        for simpler in _simpler(event):
            yield schedule.model_copy(update={"faults": (*faults[:i], simpler, *faults[i + 1 :])})


def _simpler(event: Event) -> Iterator[Event]:
    """Yield simpler versions of an event: one that occurs while the stack is up, one of half the duration, and one at a
    rounder time."""
    if event.since != "up":
        yield event.model_copy(update={"since": "up"})
    if event.for_s is not None and event.for_s > 0.1:
        yield event.model_copy(update={"for_s": round(event.for_s / 2.0, 3)})
    for grid_s in ROUND_S:
        at_s = round(round(event.at_s / grid_s) * grid_s, 3)
        if abs(at_s - event.at_s) > 1e-9:
            yield event.model_copy(update={"at_s": at_s})
            break
