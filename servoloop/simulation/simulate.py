"""Run the whole stack in simulated time, with jobs or for a given time, and return statistics and a digest."""

import hashlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time

import numpy as np

from drivers.port import Port
from hal.types import JointState
from pick_place.settings import JobSettings
from servoloop.recording.bus_tap import BusTap, BusTaps
from servoloop.recording.following_error import FollowingError
from servoloop.recording.sampler import Sampler
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.job import JobRecord, require_cell
from servoloop.simulation.jobs import run_jobs
from servoloop.simulation.schedule import Schedule
from servoloop.simulation.stack import SimulatedStack
from servoloop.simulation.stack_faults import inventory_of
from servoloop.stack.robot_files import Files, servo_ids
from sim_backend.buses.build import Build
from sim_backend.buses.port import VirtualPort
from sim_backend.faults.player import require_possible
from sim_backend.faults.targets import Inventory


class Digest:
    """SHA-256 digest of all joint states and all bytes on the buses, in order."""

    def __init__(self) -> None:
        self._states = hashlib.sha256()

    def add_state(self, state: JointState) -> None:
        """Add the joint state of one cycle, as little-endian doubles."""
        for values in (state.position, state.velocity, state.effort):
            self._states.update(np.asarray(values, dtype="<f8").tobytes())
        self._states.update(repr(sorted(state.faults)).encode())

    def of(self, ports: Iterable[BusTap[VirtualPort]]) -> str:
        """Return the hexadecimal digest, including all bytes of these ports."""
        whole = self._states.copy()
        for port in ports:
            for traffic in (port.sent, port.received):
                whole.update(f"{port.name} {len(traffic)}\n".encode())
                for _, data in traffic:
                    whole.update(data)
        return whole.hexdigest()


@contextmanager
def recorded(stack: SimulatedStack, path: Path) -> Iterator[None]:
    """Record all cycles in a new file. Enter this context before activating the stack. Raises RecordingError."""
    from servoloop.recording.messages import Messages  # this import takes 0.1 s, and most runs are not recorded
    from servoloop.recording.recorder import RecordingFile
    from servoloop.recording.sampler import scene_poses

    files, loop, taps = stack.files, stack.loop, BusTaps()
    sampler = Sampler(loop, files.component.name, servo_ids(files), taps)
    hardware = loop.hardware
    file = RecordingFile(path, Messages(files.description, hardware.joints, hardware.command_interfaces, 0.0))
    previous = stack.on_state

    def tap(port: Port) -> Port:
        return taps.tap(port, stack.clock)

    def on_state(state: JointState) -> None:
        previous(state)
        file.write(replace(sampler.sample(state), scene=scene_poses(stack.scene)))

    stack.tap, stack.on_state = tap, on_state
    try:
        yield
    finally:
        stack.on_state = previous
        file.close(taps.take())


SETTLED_S = 2.5
"""Time for a limp arm to sink, and to rise again after it is activated, in seconds."""


@dataclass(frozen=True, slots=True)
class SimulationResult:
    """Result of one run. All times except for ``cpu_s`` are in simulated seconds."""

    joints: dict[str, tuple[str, ...]]
    """Joints of each arm controller. All per-joint values are in this order."""
    jobs: tuple[JobRecord, ...]
    simulated_s: float
    cycles: int
    missed_cycles: int
    unmeasured_cycles: int
    faulty_cycles: dict[str, int]
    """Number of cycles with a fault, keyed by joint and fault type."""
    following: dict[str, FollowingError]
    """Following error of each arm controller."""
    digest: str
    cpu_s: float
    """CPU time, in seconds. The digest does not depend on this time."""

    @property
    def success(self) -> bool:
        """Whether all jobs succeeded and all cubes are in their bins."""
        return all(job.success for job in self.jobs)


def simulated(files: Files) -> Inventory:
    """Return the components that faults in ``simulate`` can target. Faults cannot occur during the shutdown."""
    return replace(inventory_of(files), end_s=None)


def simulate(
    files: Files, settings: Mapping[str, JobSettings], schedule: Schedule, record: Path | None = None
) -> SimulationResult:
    """Activate the arm on virtual servos, run the jobs in order, then stay active for the schedule's ``seconds``.

    If a robot has several arms, all arms do the jobs at the same time.

    Equal arguments produce equal digests, with or without a recording.

    Args:
        files: Files of the schedule's arm.
        settings: Settings of each arm's pick-and-place node, keyed by arm name.
        schedule: Schedule of the run.
        record: Path of a new recording, if any.

    Raises:
        DriverError: The arm cannot be activated, as in ``servoloop up``.
        HalError: A component cannot be activated.
        FaultError: A fault is not possible on this arm.
        RecordingError: The recording cannot be written.
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
        {arm.name: tuple(arm.joints) for arm in stack.arms},
        jobs,
        stack.clock.now(),
        figures.cycles,
        figures.missed,
        figures.unmeasured,
        dict(faulty),
        {arm.name: stack.trace_of(arm.joints).following(since_s=SETTLED_S) for arm in stack.arms},
        digest.of(stack.ports.values()),
        process_time() - begun_s,
    )


def _run(stack: FaultyStack, settings: Mapping[str, JobSettings], schedule: Schedule) -> tuple[JobRecord, ...]:
    stack.up()
    stack.run(SETTLED_S)
    jobs: list[JobRecord] = []
    run_jobs(stack, settings, schedule.job, jobs.append)
    stack.run(schedule.seconds)
    return tuple(sorted(jobs, key=lambda job: job.arm))
