"""Minimize a schedule that violates an invariant: the few faults and acts that matter, on the simplest arm."""

from collections.abc import Callable, Iterator

from servoloop.simulation.schedule import Schedule, after_the_end
from servoloop.stack.arm_folders import OWN
from sim_backend.faults.event import Event

Breaks = Callable[[Schedule], bool]
"""Whether a schedule breaks the same invariant."""
ROUND_S = (1.0, 0.1, 0.01)
"""Times are tried on these grids, the coarsest first."""

SECONDS = (1.0, 3.0, 5.0)
"""Times that are tried for which the arm stays up."""


def shrink(schedule: Schedule, breaks: Breaks, stop: Callable[[], bool] = lambda: False) -> Schedule:
    """The smallest schedule found that still breaks it: without faults, acts, jobs and seconds that it does not need.

    Deterministic; ``breaks(schedule)`` must hold at the beginning. Greedy: what a step makes smaller stays so, until
    no step does, or until ``stop`` says so.
    """
    smaller = schedule
    while True:
        smaller_ones = (one for one in _smaller(smaller) if one != smaller and not after_the_end(one))
        found = next((one for one in smaller_ones if not stop() and breaks(one)), None)
        if found is None:
            return smaller
        smaller = found


def _smaller(schedule: Schedule) -> Iterator[Schedule]:
    """Schedules that are a little smaller, what saves most first."""
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
    if schedule.on_exit is not None:
        yield schedule.model_copy(update={"on_exit": None})
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
        for easier in _easier(event):
            yield schedule.model_copy(update={"faults": (*faults[:i], easier, *faults[i + 1 :])})


def _easier(event: Event) -> Iterator[Event]:
    """The same event while the arm is up, shorter, or at a rounder time."""
    if event.since != "up":
        yield event.model_copy(update={"since": "up"})
    if event.for_s is not None and event.for_s > 0.1:
        yield event.model_copy(update={"for_s": round(event.for_s / 2.0, 3)})
    for grid_s in ROUND_S:
        at_s = round(round(event.at_s / grid_s) * grid_s, 3)
        if abs(at_s - event.at_s) > 1e-9:
            yield event.model_copy(update={"at_s": at_s})
            break
