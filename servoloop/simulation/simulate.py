"""One run of the whole stack on simulated time: jobs or so many seconds, figures, and a digest of all that happened."""

from collections import Counter
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time

from hal.types import JointState
from nodes.pick_place.settings import Settings
from servoloop.demo.following_error import FollowingError
from servoloop.files import Files
from servoloop.simulation.digest import Digest
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.file_recording import recorded
from servoloop.simulation.job import JobRecord, require_cell, run_job
from servoloop.simulation.schedule import Schedule
from servoloop.simulation.stack_faults import inventory_of
from sim_backend.faults.player import require_possible
from sim_backend.faults.targets import Inventory
from sim_backend.mechanics.build import Build

SETTLED_S = 2.5
"""Until then a limp arm that was switched on has sunk, and has been lifted again."""


@dataclass(frozen=True, slots=True)
class SimulationResult:
    """One run. Times in seconds of the simulation, but ``cpu_s``."""

    joints: tuple[str, ...]
    """The joints of the arm's controller, in the order of all figures."""
    jobs: tuple[JobRecord, ...]
    simulated_s: float
    cycles: int
    missed_cycles: int
    unmeasured_cycles: int
    faulty_cycles: dict[str, int]
    """Cycles in which a joint was not measured or not driven, by joint and kind of fault."""
    following: FollowingError
    digest: str
    cpu_s: float
    """Of the processor, which the digest does not depend on."""

    @property
    def success(self) -> bool:
        """Whether every job succeeded, and all cubes are in their bins."""
        return all(job.success for job in self.jobs)


def simulated(files: Files) -> Inventory:
    """What faults of such a run may concern: the arm with all its parts; the program is not ended in it."""
    return replace(inventory_of(files), end_s=None)


def simulate(files: Files, settings: Settings, schedule: Schedule, record: Path | None = None) -> SimulationResult:
    """Bring the arm up on its virtual servos, run the jobs one after the other, then stay up for so many seconds.

    ``files`` and ``settings``: of the schedule's arm. The same arguments give the same digest, also where all is
    recorded into a file. Raises DriverError and HalError as bringing up a real arm does, FaultError where a fault
    cannot happen to this arm, RecordingError.
    """
    begun_s = process_time()
    require_cell(files, schedule.job)
    stack = FaultyStack(files=files, build=Build(schedule.backlash_deg, schedule.seed), keep_alive=True)
    digest, faulty = Digest(), Counter[str]()

    def on_state(state: JointState) -> None:
        digest.add_state(state)
        faulty.update(f"{joint}: {fault.kind}" for joint, fault in state.faults.items())

    stack.on_state = on_state
    require_possible(schedule.faults, simulated(files))
    stack.player.plan(schedule.faults)
    with recorded(stack, record) if record else nullcontext():
        jobs = _run(stack, settings, schedule)
    figures = stack.loop.figures
    return SimulationResult(
        tuple(stack.arm.joints),
        jobs,
        stack.clock.now(),
        figures.cycles,
        figures.missed,
        figures.unmeasured,
        dict(faulty),
        stack.trace.following(since_s=SETTLED_S),
        digest.of(stack.ports.values()),
        process_time() - begun_s,
    )


def _run(stack: FaultyStack, settings: Settings, schedule: Schedule) -> tuple[JobRecord, ...]:
    stack.up()
    stack.run(SETTLED_S)
    jobs = tuple(run_job(stack, settings, grade, number) for number, grade in enumerate(schedule.job, 1))
    stack.run(schedule.seconds)
    return jobs
