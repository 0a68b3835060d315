"""The job's logic against an arm that only takes notes."""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import pytest

from nodes.pick_place.job import Ending, Outcome, PickPlaceJob, Result, State
from nodes.pick_place.settings import Settings

READY = (0.0, -0.3643, -0.6419, -0.8154, -0.9541, -1.6828)
PICK = (0.0, -0.35, -0.70, -0.70, -1.10, 1.55)
BIN = {
    "A": (0.4, -0.2, -0.8, -0.6, -1.1, 1.55),
    "B": (0.0, -0.2, -0.8, -0.6, -1.1, 1.55),
    "C": (-0.4, -0.2, -0.8, -0.6, -1.1, 1.55),
}
STORY = [
    "start", "ready", "ready", "open_gripper", "grasp", "grasp", "close_gripper", "place", "place",
    "release", "done", "done",
]  # fmt: skip
# How much of the story has been told when the arm gets its n-th pose.
TOLD_BEFORE_MOVE = [2, 5, 8, 10]
# ... and its n-th gripper value.
TOLD_BEFORE_HAND = [3, 6, 9]


@dataclass
class NotingArm:
    """Does everything at once. The hooks run inside the n-th call."""

    done: list[tuple[float, ...] | float] = field(default_factory=list)
    on_move: Callable[[int], Outcome] = lambda _: Outcome(True)
    on_hand: Callable[[int], None] = lambda _: None
    moves: int = 0
    hands: int = 0
    stops: int = 0

    async def move(self, positions_rad: Sequence[float]) -> Outcome:
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


class Told:
    """A job and what it told."""

    def __init__(self, arm: NotingArm, grade: str = "B") -> None:
        self.states: list[State] = []
        self.job = PickPlaceJob(7, grade, Settings(), arm, self.states.append)

    def run(self) -> Result:
        return asyncio.run(self.job.run())

    def phases(self) -> list[str]:
        return [state.phase.value for state in self.states]


@pytest.mark.parametrize("grade", ["A", "B", "C"])
def test_a_job_is_these_motions_in_this_order(grade: str) -> None:
    arm = NotingArm()
    result = Told(arm, grade).run()
    assert result.ending is Ending.SUCCEEDED
    assert arm.done == [READY, 0.0, PICK, 0.05, BIN[grade], 0.0, READY]


def test_states_and_feedback_tell_the_story() -> None:
    told = Told(NotingArm())
    assert told.run().request_id == 7
    assert told.phases() == STORY
    feedback = [state.phase.value for state in told.states if state.feedback]
    assert feedback == ["start", "ready", "grasp", "place"]
    assert all(state.ok and state.grade == "B" and state.message for state in told.states)


@pytest.mark.parametrize("grade", ["b", " B", "\tb\n"])
def test_grades_are_stripped_and_upper_cased(grade: str) -> None:
    arm = NotingArm()
    told = Told(arm, grade)
    assert told.run().ending is Ending.SUCCEEDED
    assert BIN["B"] in arm.done
    assert told.states[0].grade == "B"


def test_unknown_grade_moves_nothing_and_names_the_known() -> None:
    arm = NotingArm()
    told = Told(arm, "q")
    result = told.run()
    assert result.ending is Ending.ABORTED
    assert "'Q'" in result.message
    assert "A, B, C" in result.message
    assert arm.done == []
    assert told.phases() == ["start", "error"]


@pytest.mark.parametrize("failing", range(4))
def test_a_failed_motion_ends_the_job_with_its_reason(failing: int) -> None:
    why = "servo 3 (joint3) is silent"
    arm = NotingArm(on_move=lambda n: Outcome(n != failing, why))
    told = Told(arm)
    result = told.run()
    assert result.ending is Ending.ABORTED
    assert why in result.message
    assert arm.moves == failing + 1
    assert told.phases() == [*STORY[: TOLD_BEFORE_MOVE[failing]], "error"]
    assert not told.states[-1].ok
    assert told.states[-1].message == result.message
    assert told.states[-1].feedback


@pytest.mark.parametrize("arrives", [False, True])
@pytest.mark.parametrize("phase", range(4))
def test_cancel_during_a_motion(phase: int, arrives: bool) -> None:
    def cancel_in(call: int) -> Outcome:
        if call != phase:
            return Outcome(True)
        told.job.cancel()
        return Outcome(arrives)

    arm = NotingArm(on_move=cancel_in)
    told = Told(arm)
    assert told.run() == Result(Ending.CANCELED, 7, "canceled")
    assert (arm.moves, arm.stops) == (phase + 1, 1)
    assert told.phases() == [*STORY[: TOLD_BEFORE_MOVE[phase]], "error"]


@pytest.mark.parametrize("phase", range(3))
def test_cancel_during_a_gripper_command_sends_no_further_goal(phase: int) -> None:
    arm = NotingArm(on_hand=lambda n: told.job.cancel() if n == phase else None)
    told = Told(arm)
    assert told.run().ending is Ending.CANCELED
    assert arm.moves == phase + 1
    assert told.phases() == [*STORY[: TOLD_BEFORE_HAND[phase] + 1], "error"]


def test_cancel_before_the_start() -> None:
    arm = NotingArm()
    told = Told(arm)
    told.job.cancel()
    assert told.run().ending is Ending.CANCELED
    assert arm.done == []
    assert told.phases() == ["start", "error"]


def test_the_first_reason_to_cancel_stands_and_the_arms_word_is_added() -> None:
    def cancel_twice(_: int) -> Outcome:
        told.job.cancel("canceled: first")
        told.job.cancel("canceled: second")
        return Outcome(False, "the arm did not confirm")

    arm = NotingArm(on_move=cancel_twice)
    told = Told(arm)
    assert told.run().message == "canceled: first; the arm did not confirm"
    assert arm.stops == 1


def test_an_error_below_is_told_as_well() -> None:
    def broken(_: int) -> Outcome:
        raise RuntimeError("the middleware is gone")

    told = Told(NotingArm(on_move=broken))
    result = told.run()
    assert result.ending is Ending.ABORTED
    assert "the middleware is gone" in result.message
    assert told.phases()[-1] == "error"
