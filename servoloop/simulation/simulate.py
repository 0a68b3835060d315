"""One run of the whole stack on simulated time: jobs or so many seconds, figures, and a digest of all that happened."""

import hashlib
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time

import numpy as np

from drivers.port import Port
from hal.types import JointState
from nodes.pick_place.settings import Settings
from servoloop.recording.bus_tap import BusTaps
from servoloop.recording.sampler import Sampler
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.job import JobRecord, require_cell, run_job
from servoloop.simulation.recording import FollowingError, RecordingPort
from servoloop.simulation.schedule import Schedule
from servoloop.simulation.stack import SimulatedStack
from servoloop.simulation.stack_faults import inventory_of
from servoloop.stack.robot_files import Files, servo_ids
from sim_backend.buses.build import Build
from sim_backend.faults.player import require_possible
from sim_backend.faults.targets import Inventory


class Digest:
    """SHA-256 of every byte on every wire, and of every joint state, in their order."""

    def __init__(self) -> None:
        self._states = hashlib.sha256()

    def add_state(self, state: JointState) -> None:
        """Take one cycle's measurement in: all its numbers as doubles, the lowest byte first."""
        for values in (state.position, state.velocity, state.effort):
            self._states.update(np.asarray(values, dtype="<f8").tobytes())
        self._states.update(repr(sorted(state.faults)).encode())

    def of(self, ports: Iterable[RecordingPort]) -> str:
        """The digest with all that went over these ports, in hexadecimal digits."""
        whole = self._states.copy()
        for port in ports:
            for traffic in (port.sent, port.received):
                whole.update(f"{port.name} {len(traffic)}\n".encode())
                for _, data in traffic:
                    whole.update(data)
        return whole.hexdigest()


@contextmanager
def recorded(stack: SimulatedStack, path: Path) -> Iterator[None]:
    """Record all cycles of the block into a new file, from before the stack is up. Raises RecordingError."""
    from servoloop.recording.messages import Messages  # takes a tenth of a second, which most runs save
    from servoloop.recording.recorder import RecordingFile
    from servoloop.recording.sampler import scene_poses

    files, loop, taps = stack.files, stack.loop, BusTaps()
    sampler = Sampler(loop, files.component.name, servo_ids(files), taps)
    hardware = loop.hardware
    file = RecordingFile(path, Messages(files.description, hardware.joints, hardware.command_interfaces, 0.0))
    look_on = stack.on_state

    def tap(port: Port) -> Port:
        return taps.tap(port, stack.clock)

    def on_state(state: JointState) -> None:
        look_on(state)
        file.write(replace(sampler.sample(state), scene=scene_poses(stack.scene)))

    stack.tap, stack.on_state = tap, on_state
    try:
        yield
    finally:
        stack.on_state = look_on
        file.close(taps.take())


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
