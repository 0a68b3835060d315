"""One job of the demo: sent, watched through the topics and the emulator's feed, and judged."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from time import perf_counter, time
from typing import TYPE_CHECKING

import numpy as np

from drivers.clock import MonotonicClock, wall_offset_s
from servoloop.following import UNKNOWN, FollowingError, between_cycles, following_error
from servoloop.live import Live
from servoloop.processes import Processes
from servoloop.signals import Signals
from sim_backend.world_feed import WorldFeedClient

if TYPE_CHECKING:
    from nodes.pick_client import PickClient
    from nodes.watcher import Sample, Watcher

REST_S = 3.0


@dataclass(frozen=True, slots=True)
class Run:
    """One job: what was asked, where the cube ended, how well the arm followed."""

    grade: str
    success: bool
    bin: str | None
    duration_s: float
    message: str
    at_cycles: FollowingError
    between_cycles: FollowingError


@dataclass(slots=True)
class Trace:
    """The joints between the cycles, as the simulated world saw them, on the monotonic clock."""

    times_s: list[float] = field(default_factory=list)
    positions: list[list[float]] = field(default_factory=list)


class Interrupted(Exception):
    """The user has ended the demo."""


class Show:
    """Jobs, one after the other, on a stack that is up."""

    def __init__(
        self,
        watcher: "Watcher",
        picker: "PickClient",
        live: Live,
        camera: "Camera",
        signals: Signals,
        processes: Processes,
    ) -> None:
        self._watcher = watcher
        self._picker = picker
        self._live = live
        self._camera = camera
        self._signals = signals
        self._processes = processes

    def run(self, grade: str) -> Run:
        """One job, watched. Raises Interrupted if the user ends it."""
        samples = self._watcher.seen.samples
        self._camera.poll()
        self._camera.trace = Trace()
        samples.clear()
        self._live.job(grade)
        started_s = perf_counter()
        outcome = self._picker.pick(grade, self._live.phase, self._tick)
        duration_s = perf_counter() - started_s
        at, between = _errors(samples, self._camera.trace)
        where = self._rest()
        success = outcome.success and where == grade.strip().upper()
        self._live.done(grade, where, success, outcome.message)
        return Run(grade, success, where, duration_s, outcome.message, at, between)

    def idle(self, seconds: float) -> None:
        """Let the stack be, and look on. Raises Interrupted if the user ends it."""
        until_s = perf_counter() + seconds
        while perf_counter() < until_s:
            self._watcher.spin(0.1)
            self._look()

    def _tick(self) -> bool:
        """Look on; whether the job shall be cancelled."""
        self._camera.poll()
        self._live.show(self._watcher.seen)
        self._processes.check()
        return self._signals.count > 0

    def _look(self) -> None:
        if self._tick():
            raise Interrupted

    def _rest(self) -> str | None:
        """The bin in which the cube comes to rest."""
        until_s = perf_counter() + REST_S
        while self._camera.bin is None and perf_counter() < until_s:
            self._watcher.spin(0.05)
            self._look()
        return self._camera.bin


class Camera:
    """What the emulator's feed shows: the cube's bin, and the joints between the cycles."""

    def __init__(self, client: WorldFeedClient, joints: Sequence[str]) -> None:
        self.bin: str | None = None
        self.trace = Trace()
        self._client = client
        self._joints = list(joints)

    def poll(self) -> None:
        """Take in all that was published since the last call."""
        for publication in self._client.all():
            self.bin = publication["cube_bin"]
            for time_s, positions in publication["trace"]:
                self.trace.times_s.append(time_s)
                self.trace.positions.append(positions[: len(self._joints)])


def _errors(samples: "Sequence[Sample]", trace: Trace) -> tuple[FollowingError, FollowingError]:
    """At the cycles and between them; the samples' ROS time is brought to the trace's clock."""
    if not samples:
        return UNKNOWN, UNKNOWN
    offset_s = wall_offset_s(MonotonicClock(), time)
    stamps = np.array([sample.stamp_s for sample in samples]) - offset_s
    reference = np.array([sample.reference for sample in samples])
    velocity = np.array([sample.reference_velocity for sample in samples])
    feedback = np.array([sample.feedback for sample in samples])
    at = following_error(reference - feedback, velocity)
    return at, between_cycles(trace.times_s, trace.positions, stamps, reference, velocity)
