"""One pick-and-place job, step by step. No ROS: the caller hands in an arm and a receiver of states."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Protocol

from nodes.pick_place.settings import Pose, Settings, normal_grade


class Phase(StrEnum):
    """The names of a job's parts in states and feedback."""

    START = "start"
    READY = "ready"
    OPEN_GRIPPER = "open_gripper"
    GRASP = "grasp"
    CLOSE_GRIPPER = "close_gripper"
    PLACE = "place"
    RELEASE = "release"
    DONE = "done"
    ERROR = "error"


class Ending(Enum):
    """The ways in which a job ends."""

    SUCCEEDED = "succeeded"
    ABORTED = "aborted"
    CANCELED = "canceled"


@dataclass(frozen=True, slots=True)
class State:
    """A published state of a job. ``feedback``: the client of the action gets it as well."""

    request_id: int
    grade: str
    phase: Phase
    message: str
    feedback: bool = False

    @property
    def ok(self) -> bool:
        """False in the one state that ends a job without success."""
        return self.phase is not Phase.ERROR


@dataclass(frozen=True, slots=True)
class Result:
    """The end of a job, and its reason."""

    ending: Ending
    request_id: int
    message: str


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of one motion. ``text``: why the arm did not reach the pose, as far as known."""

    reached: bool
    text: str = ""


class Arm(Protocol):
    """The arm as a job uses it."""

    async def move(self, positions_rad: Sequence[float]) -> Outcome:
        """Go to a pose; return once the arm is there, or why it is not. Always returns."""
        ...

    def hand(self, position_m: float) -> None:
        """Tell the fingers where to go, and do not wait for them."""
        ...

    def stop(self) -> None:
        """Let the running ``move`` end soon, wherever the arm is then."""
        ...


@dataclass(frozen=True, slots=True)
class Move:
    """A motion of the arm."""

    phase: Phase
    where: str
    pose_rad: Pose


@dataclass(frozen=True, slots=True)
class Hand:
    """A command to the fingers."""

    phase: Phase
    what: str
    position_m: float


def steps(settings: Settings, grade: str) -> tuple[Move | Hand, ...]:
    """The whole job for a known grade."""
    return (
        Move(Phase.READY, "the ready pose", settings.ready_rad),
        Hand(Phase.OPEN_GRIPPER, "opening the gripper", settings.hand_open_m),
        Move(Phase.GRASP, "the pick pose", settings.pick_rad),
        Hand(Phase.CLOSE_GRIPPER, "closing the gripper", settings.hand_closed_m),
        Move(Phase.PLACE, f"bin {grade}", settings.bins_rad[grade]),
        Hand(Phase.RELEASE, "opening the gripper", settings.hand_open_m),
        Move(Phase.DONE, "the ready pose", settings.ready_rad),
    )


class _EndedError(Exception):
    """Ends a job before its last step."""

    def __init__(self, ending: Ending, message: str) -> None:
        super().__init__(message)
        self.ending = ending


class PickPlaceJob:
    """Runs once. ``cancel`` may be called at any time, also before ``run`` and after it."""

    def __init__(
        self,
        request_id: int,
        grade: str,
        settings: Settings,
        arm: Arm,
        tell: Callable[[State], None],
    ) -> None:
        self.request_id = request_id
        self.grade = normal_grade(grade)
        self._settings = settings
        self._arm = arm
        self._tell = tell
        self._why_canceled: str | None = None

    def cancel(self, why: str = "canceled") -> None:
        """End soon; arm and fingers stay where they are then. The first reason stands."""
        if self._why_canceled is None:
            self._why_canceled = why
            self._arm.stop()

    async def run(self) -> Result:
        """Do the job; every failure is told as a state and returned, none is raised."""
        try:
            await self._run()
        except _EndedError as end:
            return self._failed(end.ending, str(end))
        except Exception as error:  # a job that cannot go on must still say so
            return self._failed(Ending.ABORTED, f"internal error: {error!r}")
        message = f"let go over bin {self.grade}; the arm is back at ready"  # nothing here sees the apple
        self._say(Phase.DONE, message)
        return Result(Ending.SUCCEEDED, self.request_id, message)

    async def _run(self) -> None:
        self._say(Phase.START, f"job {self.request_id}, grade {self.grade}", feedback=True)
        if self.grade not in self._settings.bins_rad:
            known = ", ".join(self._settings.bins_rad)
            raise _EndedError(Ending.ABORTED, f"there is no bin for grade {self.grade!r}; known: {known}")
        for step in steps(self._settings, self.grade):
            self._check_cancel()
            if isinstance(step, Move):
                await self._move(step)
            else:
                self._arm.hand(step.position_m)
                self._say(step.phase, step.what)

    async def _move(self, step: Move) -> None:
        # "done" is said only when it is true; the way back is part of "release"
        if step.phase is not Phase.DONE:
            self._say(step.phase, f"moving to {step.where}", feedback=True)
        outcome = await self._arm.move(step.pose_rad)
        self._check_cancel(outcome.text)
        if not outcome.reached:
            raise _EndedError(Ending.ABORTED, f"on the way to {step.where}: {outcome.text}")
        self._say(step.phase, f"at {step.where}")

    def _check_cancel(self, text: str = "") -> None:
        if self._why_canceled is not None:
            parts = [self._why_canceled, text] if text else [self._why_canceled]
            raise _EndedError(Ending.CANCELED, "; ".join(parts))

    def _failed(self, ending: Ending, message: str) -> Result:
        self._say(Phase.ERROR, message, feedback=True)
        return Result(ending, self.request_id, message)

    def _say(self, phase: Phase, message: str, *, feedback: bool = False) -> None:
        self._tell(State(self.request_id, self.grade, phase, message, feedback))
