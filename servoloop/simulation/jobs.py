"""Run the jobs of a simulated stack. All arms work at the same time, and each arm runs its jobs one after the other."""

from collections.abc import Callable, Mapping, Sequence
from math import inf

from pick_place.settings import JobSettings
from servoloop.simulation.job import FALLS_S, LONGEST_S, JobRecord, RunningJob, run_job
from servoloop.simulation.stack import SimulatedStack


def run_jobs(
    stack: SimulatedStack,
    settings: Mapping[str, JobSettings],
    grades: Sequence[str],
    on_record: Callable[[JobRecord], None],
) -> None:
    """Let each arm pick cubes of these grades, and run until the last cube has come to rest.

    Args:
        stack: The active stack.
        settings: Settings of each arm's pick-and-place node, keyed by arm name.
        grades: Grades of the cubes, in order.
        on_record: Function called with the record of each job after its cube has come to rest.

    Raises the errors of the stack, such as PortLost.
    """
    if not grades:
        return
    if len(settings) > 1:
        _SeveralArms(stack, settings, grades, on_record).run()
        return
    (only,) = settings.values()
    for number, grade in enumerate(grades, 1):
        on_record(run_job(stack, only, grade, number))


class _ArmJobs:
    """The jobs of one arm."""

    def __init__(
        self,
        stack: SimulatedStack,
        name: str,
        settings: JobSettings,
        grades: Sequence[str],
        on_record: Callable[[JobRecord], None],
    ) -> None:
        self._stack, self._name, self._settings, self._on_record = stack, name, settings, on_record
        self._waiting = list(enumerate(grades, 1))
        self._end_s, self._rest_s = inf, inf
        """Deadlines on the stack's clock: one for the end of the job, and one for its cube to come to rest."""
        self._ended_s = inf
        self.job: RunningJob | None = None

    def proceed(self) -> bool:
        """Start the next job if the previous job has finished and its cube is at rest. Return whether a job started."""
        now_s = self._stack.clock.now() + 1e-9
        if self.job is not None and self._rest_s == inf and (self.job.done or now_s >= self._end_s):
            self._ended_s, self._rest_s = self._stack.clock.now(), now_s + FALLS_S
        if self.job is not None and now_s < self._rest_s:
            return False
        if self.job is not None:
            self.job.close()
            self._on_record(self.job.record(self._ended_s))
            self.job = None
        if not self._waiting:
            return False
        number, grade = self._waiting.pop(0)
        self.job = RunningJob(self._stack, self._settings, grade, number, self._name)
        self._end_s, self._rest_s = now_s + LONGEST_S, inf
        return True


class _SeveralArms:
    """Jobs that run on several arms. When a client dies, its running jobs end. The client reconnects for the next
    job."""

    def __init__(
        self,
        stack: SimulatedStack,
        settings: Mapping[str, JobSettings],
        grades: Sequence[str],
        on_record: Callable[[JobRecord], None],
    ) -> None:
        self._stack = stack
        self._arms = [_ArmJobs(stack, name, one, grades, on_record) for name, one in settings.items()]
        self._longest_s = len(grades) * (LONGEST_S + FALLS_S)
        self._connected: list[RunningJob] = []
        """Jobs whose client has not died."""

    def run(self) -> None:
        """Run all jobs."""
        try:
            self._stack.run(self._longest_s + 1.0, self._done)
        finally:
            self._stack.after_cycle = lambda: None
            for arm in self._arms:
                if arm.job is not None:
                    arm.job.close()

    def _done(self) -> bool:
        for arm in self._arms:
            if arm.proceed() and arm.job is not None:
                if self._stack.after_cycle != self._after_cycle:  # The client has died.
                    self._connected.clear()
                    self._stack.after_cycle = self._after_cycle
                self._connected.append(arm.job)
        return all(arm.job is None for arm in self._arms)

    def _after_cycle(self) -> None:
        for job in self._connected:
            job.after_cycle()
