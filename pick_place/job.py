"""Run one pick-and-place job step by step.

The module does not import ROS packages: the caller provides the motions and a state callback.
"""

from collections.abc import Awaitable, Callable, Collection, Sequence
from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Protocol

from pick_place.settings import normal_grade


class JobPhase(StrEnum):
    """Phases of a job, as named in states and feedback."""

    START = "start"
    READY = "ready"
    OPEN_GRIPPER = "open_gripper"
    GRASP = "grasp"
    CLOSE_GRIPPER = "close_gripper"
    PLACE = "place"
    RELEASE = "release"
    DONE = "done"
    ERROR = "error"


class JobEnding(Enum):
    """Possible outcomes of a job."""

    SUCCEEDED = "succeeded"
    ABORTED = "aborted"
    CANCELED = "canceled"


@dataclass(frozen=True, slots=True)
class State:
    """A published state of a job. If ``feedback`` is True, the state is also sent to the action client."""

    request_id: int
    grade: str
    phase: JobPhase
    message: str
    feedback: bool = False

    @property
    def ok(self) -> bool:
        """False for the final state of an unsuccessful job, and True for all other states."""
        return self.phase is not JobPhase.ERROR


@dataclass(frozen=True, slots=True)
class Result:
    """Result of a job: how the job ended, and why."""

    ending: JobEnding
    request_id: int
    message: str


@dataclass(frozen=True, slots=True)
class JobOutcome:
    """Outcome of one motion. ``text`` explains why the arm did not reach the pose, if the reason is known."""

    reached: bool
    text: str = ""


class JobArm(Protocol):
    """Interface through which a job moves the arm to joint positions."""

    async def move(self, positions_rad: Sequence[float]) -> JobOutcome:
        """Move to a pose and return the outcome. Failures are returned, never raised."""
        ...

    def hand(self, position_m: float) -> None:
        """Send a position to the fingers without waiting for them."""
        ...

    def stop(self) -> None:
        """Stop the running ``move`` soon, leaving the arm at its current position."""
        ...


Run = Callable[[], Awaitable[JobOutcome]]
"""Function that carries out a step and returns its outcome. The function returns failures and never raises them."""


@dataclass(frozen=True, slots=True)
class JobMove:
    """A motion of the arm."""

    phase: JobPhase
    where: str
    run: Run


@dataclass(frozen=True, slots=True)
class JobHand:
    """A command for the fingers."""

    phase: JobPhase
    what: str
    run: Run


class JobMotions(Protocol):
    """Motions of a job, either to joint positions or planned to tool poses."""

    @property
    def grades(self) -> Collection[str]:
        """Grades for which there is a bin."""
        ...

    def steps(self, grade: str) -> Sequence[JobMove | JobHand]:
        """Return all steps of a job for a known grade."""
        ...

    def stop(self) -> None:
        """Stop the running step soon, leaving the arm at its current position."""
        ...


class _EndedError(Exception):
    """Exception that ends a job before its last step."""

    def __init__(self, ending: JobEnding, message: str) -> None:
        super().__init__(message)
        self.ending = ending


class PickPlaceJob:
    """A job that runs once. ``cancel`` may be called at any time, even before or after ``run``."""

    def __init__(
        self,
        request_id: int,
        grade: str,
        motions: JobMotions,
        tell: Callable[[State], None],
    ) -> None:
        self.request_id = request_id
        self.grade = normal_grade(grade)
        self._motions = motions
        self._tell = tell
        self._cancel_reason: str | None = None

    def cancel(self, reason: str = "canceled") -> None:
        """Stop the job soon, leaving the arm and the fingers at their current positions.

        Only the reason passed in the first call is kept.
        """
        if self._cancel_reason is None:
            self._cancel_reason = reason
            self._motions.stop()

    async def run(self) -> Result:
        """Run the job. Every failure is reported as a state and returned, never raised."""
        try:
            await self._run()
        except _EndedError as end:
            return self._failed(end.ending, str(end))
        except Exception as error:  # Unexpected errors must also be reported as a state.
            return self._failed(JobEnding.ABORTED, f"internal error: {error!r}")
        # There is no sensor to confirm that the apple has dropped.
        message = f"gripper opened over bin {self.grade}; the arm is back at the ready pose"
        self._report(JobPhase.DONE, message)
        return Result(JobEnding.SUCCEEDED, self.request_id, message)

    async def _run(self) -> None:
        self._report(JobPhase.START, f"job {self.request_id}, grade {self.grade}", feedback=True)
        if self.grade not in self._motions.grades:
            known = ", ".join(self._motions.grades)
            raise _EndedError(JobEnding.ABORTED, f"there is no bin for grade {self.grade!r}; known grades: {known}")
        for step in self._motions.steps(self.grade):
            self._check_cancel()
            if isinstance(step, JobMove):
                await self._move(step)
            else:
                await self._command_hand(step)

    async def _move(self, step: JobMove) -> None:
        # The "done" phase is reported only at the ready pose. The return motion belongs to the "release" phase.
        if step.phase is not JobPhase.DONE:
            self._report(step.phase, f"moving to {step.where}", feedback=True)
        outcome = await step.run()
        self._check_cancel(outcome.text)
        if not outcome.reached:
            raise _EndedError(JobEnding.ABORTED, f"on the way to {step.where}: {outcome.text}")
        self._report(step.phase, f"at {step.where}")

    async def _command_hand(self, step: JobHand) -> None:
        outcome = await step.run()
        if not outcome.reached:
            self._check_cancel(outcome.text)
            raise _EndedError(JobEnding.ABORTED, f"while {step.what}: {outcome.text}")
        self._report(step.phase, step.what)

    def _check_cancel(self, text: str = "") -> None:
        if self._cancel_reason is not None:
            parts = [self._cancel_reason, text] if text else [self._cancel_reason]
            raise _EndedError(JobEnding.CANCELED, "; ".join(parts))

    def _failed(self, ending: JobEnding, message: str) -> Result:
        self._report(JobPhase.ERROR, message, feedback=True)
        return Result(ending, self.request_id, message)

    def _report(self, phase: JobPhase, message: str, *, feedback: bool = False) -> None:
        self._tell(State(self.request_id, self.grade, phase, message, feedback))
