"""Run jobs with an arm that only records its commands."""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import pytest

from pick_place.job import JobEnding, JobOutcome, PickPlaceJob, Result, State
from pick_place.joint_motions import JointMotions
from pick_place.settings import JobSettings

READY = (0.0, -0.3643, -0.6419, -0.8154, -0.9541, -1.6828)
PICK = (0.0, -0.35, -0.70, -0.70, -1.10, 1.55)
BIN = {
    "A": (0.4, -0.2, -0.8, -0.6, -1.1, 1.55),
    "B": (0.0, -0.2, -0.8, -0.6, -1.1, 1.55),
    "C": (-0.4, -0.2, -0.8, -0.6, -1.1, 1.55),
}
PHASES = [
    "start", "ready", "ready", "open_gripper", "grasp", "grasp", "close_gripper", "place", "place",
    "release", "done", "done",
]  # fmt: skip
# Number of states reported before the n-th pose is sent to the arm.
STATES_BEFORE_MOVE = [2, 5, 8, 10]
# Number of states reported before the n-th gripper command.
STATES_BEFORE_HAND = [3, 6, 9]


@dataclass
class RecordingArm:
    """Arm that completes every command immediately. The hooks run within the n-th call."""

    done: list[tuple[float, ...] | float] = field(default_factory=list)
    on_move: Callable[[int], JobOutcome] = lambda _: JobOutcome(True)
    on_hand: Callable[[int], None] = lambda _: None
    moves: int = 0
    hands: int = 0
    stops: int = 0

    async def move(self, positions_rad: Sequence[float]) -> JobOutcome:
        self.done.append(tuple(positions_rad))
        self.moves += 1
        await asyncio.sleep(0)
        return self.on_move(self.moves - 1)

    def hand(self, position_m: float) -> None:
        self.done.append(position_m)
        self.hands += 1
        self.on_hand(self.hands - 1)

    def stop(self) -> None:
        self.stops += 1


class RecordedJob:
    """A job with its reported states."""

    def __init__(self, arm: RecordingArm, grade: str = "B") -> None:
        self.states: list[State] = []
        self.inner = PickPlaceJob(7, grade, JointMotions(JobSettings(), arm), self.states.append)

    def run(self) -> Result:
        return asyncio.run(self.inner.run())

    def phases(self) -> list[str]:
        return [state.phase.value for state in self.states]


@pytest.mark.parametrize("grade", ["A", "B", "C"])
def test_job_sends_all_motions_in_order(grade: str) -> None:
    arm = RecordingArm()
    result = RecordedJob(arm, grade).run()
    assert result.ending is JobEnding.SUCCEEDED
    assert arm.done == [READY, 0.0, PICK, 0.05, BIN[grade], 0.0, READY]


def test_states_and_feedback_follow_the_phases() -> None:
    job = RecordedJob(RecordingArm())
    assert job.run().request_id == 7
    assert job.phases() == PHASES
    feedback = [state.phase.value for state in job.states if state.feedback]
    assert feedback == ["start", "ready", "grasp", "place"]
    assert all(state.ok and state.grade == "B" and state.message for state in job.states)


@pytest.mark.parametrize("grade", ["b", " B", "\tb\n"])
def test_grades_are_stripped_and_upper_cased(grade: str) -> None:
    arm = RecordingArm()
    job = RecordedJob(arm, grade)
    assert job.run().ending is JobEnding.SUCCEEDED
    assert BIN["B"] in arm.done
    assert job.states[0].grade == "B"


def test_unknown_grade_moves_nothing_and_lists_known_grades() -> None:
    arm = RecordingArm()
    job = RecordedJob(arm, "q")
    result = job.run()
    assert result.ending is JobEnding.ABORTED
    assert "'Q'" in result.message
    assert "A, B, C" in result.message
    assert arm.done == []
    assert job.phases() == ["start", "error"]


@pytest.mark.parametrize("failing", range(4))
def test_failed_motion_aborts_the_job_with_its_reason(failing: int) -> None:
    why = "servo 3 (joint3) is silent"
    arm = RecordingArm(on_move=lambda n: JobOutcome(n != failing, why))
    job = RecordedJob(arm)
    result = job.run()
    assert result.ending is JobEnding.ABORTED
    assert why in result.message
    assert arm.moves == failing + 1
    assert job.phases() == [*PHASES[: STATES_BEFORE_MOVE[failing]], "error"]
    assert not job.states[-1].ok
    assert job.states[-1].message == result.message
    assert job.states[-1].feedback


@pytest.mark.parametrize("arrives", [False, True])
@pytest.mark.parametrize("phase", range(4))
def test_cancel_during_a_motion(phase: int, arrives: bool) -> None:
    def cancel_in(call: int) -> JobOutcome:
        if call != phase:
            return JobOutcome(True)
        job.inner.cancel()
        return JobOutcome(arrives)

    arm = RecordingArm(on_move=cancel_in)
    job = RecordedJob(arm)
    assert job.run() == Result(JobEnding.CANCELED, 7, "canceled")
    assert (arm.moves, arm.stops) == (phase + 1, 1)
    assert job.phases() == [*PHASES[: STATES_BEFORE_MOVE[phase]], "error"]


@pytest.mark.parametrize("phase", range(3))
def test_cancel_during_a_gripper_command_sends_no_further_goal(phase: int) -> None:
    arm = RecordingArm(on_hand=lambda n: job.inner.cancel() if n == phase else None)
    job = RecordedJob(arm)
    assert job.run().ending is JobEnding.CANCELED
    assert arm.moves == phase + 1
    assert job.phases() == [*PHASES[: STATES_BEFORE_HAND[phase] + 1], "error"]


def test_cancel_before_the_start() -> None:
    arm = RecordingArm()
    job = RecordedJob(arm)
    job.inner.cancel()
    assert job.run().ending is JobEnding.CANCELED
    assert arm.done == []
    assert job.phases() == ["start", "error"]


def test_first_cancel_reason_is_kept_with_the_outcome_of_the_arm() -> None:
    def cancel_twice(_: int) -> JobOutcome:
        job.inner.cancel("canceled: first")
        job.inner.cancel("canceled: second")
        return JobOutcome(False, "the arm did not confirm")

    arm = RecordingArm(on_move=cancel_twice)
    job = RecordedJob(arm)
    assert job.run().message == "canceled: first; the arm did not confirm"
    assert arm.stops == 1


def test_unexpected_error_is_reported_as_a_state() -> None:
    def broken(_: int) -> JobOutcome:
        raise RuntimeError("the middleware is gone")

    job = RecordedJob(RecordingArm(on_move=broken))
    result = job.run()
    assert result.ending is JobEnding.ABORTED
    assert "the middleware is gone" in result.message
    assert job.phases()[-1] == "error"
