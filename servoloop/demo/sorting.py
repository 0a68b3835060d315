"""Sort apples, graded from the virtual camera's images: wait for each job, and check its grade and bin."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from time import perf_counter
from typing import TYPE_CHECKING, Any, Final

from perception.grading.settings import GradingSettings
from servoloop.demo.cell import Cell
from servoloop.demo.jobs import Live
from servoloop.virtual_camera import grading_settings
from sim_backend.camera.scene_camera import SceneCamera
from sim_backend.camera.truth import AppleTruth

if TYPE_CHECKING:
    from nodes.clients.sorting_monitor import SortingJob, SortingMonitor

APPLES: Final = 12
"""Number of apples in a demo."""
APPLE_S: Final = 60.0
"""Maximum time for an apple to arrive at the stand and for its job to start, in seconds."""
JOB_S: Final = 120.0
"""Maximum duration of a job, in seconds. The node itself limits the duration of each motion."""
STUCK_S: Final = 15.0
"""Maximum time from a failed job to the next apple or the next job, in seconds."""
FALL_S: Final = 3.0
"""Maximum time for a released apple to come to rest, in seconds."""
FRAME_S: Final = 0.4
"""Interval between the frames of the film, in seconds."""
FRAMES: Final = 70
"""Maximum number of frames, which is enough for about two jobs."""
MOVED: Final = 0.01
"""Minimum motion of a joint between two consecutive frames, in rad or m."""


@dataclass(frozen=True, slots=True)
class SortedApple:
    """Apple with its true values, the values that the camera measured, and the bin in which the arm placed it."""

    number: int
    truth: AppleTruth
    true_grade: str
    job: "SortingJob | None"
    """Job that was started for the apple, or None if no job started in time."""
    bin: str | None

    @property
    def success(self) -> bool:
        """Whether the grade is correct and the apple is in the bin for its grade."""
        return self.job is not None and self.job.success and self.true_grade == self.job.grade == self.bin


@dataclass(slots=True)
class SortingFilm:
    """World states to draw later, with the grade from the latest message. Phases without motion are omitted."""

    first: Mapping[str, Any] | None = None
    """State in which the first apple was on the stand."""
    frames: list[tuple[Mapping[str, Any], str]] = field(default_factory=list)
    _next_s: float = 0.0

    def take(self, publication: Mapping[str, Any], grade: str) -> None:
        """Keep a state if the interval has passed, something has moved, and the film is not full."""
        now_s = perf_counter()
        if now_s < self._next_s or len(self.frames) >= FRAMES:
            return
        if not self.frames or _moved(self.frames[-1][0], publication):
            self._next_s = now_s + FRAME_S
            self.frames.append((publication, grade))


def _moved(before: Mapping[str, Any], after: Mapping[str, Any]) -> bool:
    return any(abs(after["joints"][name] - position) > MOVED for name, position in before["joints"].items())


class Sorter:
    """Observer of a cell in which camera images trigger the jobs."""

    def __init__(self, ready: Cell, monitor: "SortingMonitor", camera: SceneCamera, live: Live) -> None:
        self._ready, self._monitor, self._live = ready, monitor, live
        self._camera = camera
        self._settings: GradingSettings = grading_settings(self._camera)
        self._last_seed: int | None = None
        self._failed: SortingJob | None = None
        self._failed_s = 0.0
        self.film = SortingFilm()

    def run(self, count: int = APPLES) -> list[SortedApple]:
        """Watch the jobs of ``count`` apples, or of fewer if no more apples arrive in time.

        Raises:
            DriverError: A process has exited.
            Interrupted: The user interrupted the demo.
        """
        found: list[SortedApple] = []
        for number in range(1, count + 1):
            jobs = len(self._monitor.jobs)
            if not self._comes():
                break
            found.append(self._sorted(number, jobs))
            self._report(found[-1])
        return found

    def _sorted(self, number: int, jobs: int) -> SortedApple:
        publication = self._ready.runner.camera.newest
        assert publication is not None
        self.film.first = self.film.first or publication
        self._last_seed = publication["apple"]["seed"]
        self._camera.see(publication)
        self._camera.picture()
        truth = self._camera.truth()
        assert truth is not None
        grade = self._settings.grade_of(truth.diameter_mm, truth.red_ratio, truth.defect_score)
        if not self._wait(lambda: len(self._monitor.jobs) > jobs, APPLE_S):
            return SortedApple(number, truth, grade, None, None)
        job = self._monitor.jobs[jobs]
        self._wait(lambda: job.ended, JOB_S)
        self._wait(lambda: self._ready.runner.camera.bin is not None, FALL_S)
        return SortedApple(number, truth, grade, job, self._ready.runner.camera.bin)

    def _comes(self) -> bool:
        """Wait for the next apple, and return whether it arrived. If not, print the reason why the demo stops."""
        self._wait(lambda: self._has_new_apple() or self._is_stuck(), APPLE_S)
        if self._has_new_apple():
            return True
        text = "no further apple has come to the stand"
        if self._failed is not None:
            text += (
                f" within {STUCK_S:g} s after a failed job ({self._failed.message}), so the apple is still in the hand:"
                " see pick_place.log for the cause, and start the demo again"
            )
        self._live.say(text)
        return False

    def _is_stuck(self) -> bool:
        """Return whether the latest job has failed and no other job has followed for ``STUCK_S``."""
        newest = self._monitor.jobs[-1] if self._monitor.jobs else None
        if newest is None or not newest.ended or newest.success:
            self._failed = None
            return False
        if newest is not self._failed:
            self._failed, self._failed_s = newest, perf_counter()
        return perf_counter() > self._failed_s + STUCK_S

    def _has_new_apple(self) -> bool:
        newest = self._ready.runner.camera.newest
        return newest is not None and newest["apple"]["seed"] != self._last_seed

    def _wait(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Wait until a condition is true, and return whether it became true in time."""
        until_s = perf_counter() + timeout_s
        while not condition():
            if perf_counter() > until_s:
                return False
            self._ready.runner.idle(0.05)
            newest, seen = self._ready.runner.camera.newest, self._monitor.newest
            if newest is not None:
                self.film.take(newest, seen.grade if seen else "")
        return True

    def _report(self, apple: SortedApple) -> None:
        grade = apple.job.grade if apple.job else "none"
        message = apple.job.message if apple.job else "the camera saw no apple, or the node started no job"
        self._live.sorted(f"apple {apple.number}: grade {grade}, bin {apple.bin or 'none'}", apple.success, message)
