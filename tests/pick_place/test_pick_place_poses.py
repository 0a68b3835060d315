"""Run jobs of ``motion: poses`` with a planner that only records its calls."""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import pytest

from pick_place.job import JobEnding, JobOutcome, PickPlaceJob, Result, State
from pick_place.pose_motions import PoseMotions
from pick_place.pose_settings import PickObject, PoseSettings, ToolPose, above

SETTINGS = PoseSettings()
PICK, BIN_B = SETTINGS.pick, SETTINGS.bins["B"]
BEFORE_PICK, BEFORE_BIN = above(PICK, 0.06), above(BIN_B, 0.06)
CALLS = [
    ("drop", None),
    ("joints", SETTINGS.ready_rad),
    ("hand", 0.0),
    ("lay", None),
    ("free", BEFORE_PICK),
    ("remove", None),
    ("straight", PICK),
    ("hand", 0.05),
    ("attach", None),
    ("straight", BEFORE_PICK),
    ("free", BEFORE_BIN),
    ("straight", BIN_B),
    ("hand", 0.0),
    ("remove", None),
    ("straight", BEFORE_BIN),
    ("joints", SETTINGS.ready_rad),
]
PHASES = [
    "start", "ready", "ready", "open_gripper", "grasp", "grasp", "close_gripper", "place", "place",
    "release", "done", "done",
]  # fmt: skip


@dataclass
class RecordingPlanner:
    """Planner whose motions take no time. The hook runs within the n-th call."""

    calls: list[tuple[str, Any]] = field(default_factory=list)
    on_call: Callable[[int], JobOutcome] = lambda _: JobOutcome(True)
    stops: int = 0

    async def _call(self, name: str, value: Any = None) -> JobOutcome:
        self.calls.append((name, value))
        await asyncio.sleep(0)
        return self.on_call(len(self.calls) - 1)

    async def move(self, positions_rad: Sequence[float]) -> JobOutcome:
        return await self._call("joints", tuple(positions_rad))

    async def move_to(self, pose: ToolPose) -> JobOutcome:
        return await self._call("free", pose)

    async def move_straight(self, pose: ToolPose) -> JobOutcome:
        return await self._call("straight", pose)

    async def hand(self, position_m: float) -> JobOutcome:
        return await self._call("hand", position_m)

    async def lay_object(self) -> JobOutcome:
        return await self._call("lay")

    async def attach_object(self) -> JobOutcome:
        return await self._call("attach")

    async def remove_object(self) -> JobOutcome:
        return await self._call("remove")

    async def drop_object(self) -> JobOutcome:
        return await self._call("drop")

    def stop(self) -> None:
        self.stops += 1


class RecordedJob:
    """A job with its reported states."""

    def __init__(self, planner: RecordingPlanner, grade: str = "B") -> None:
        self.states: list[State] = []
        self.inner = PickPlaceJob(7, grade, PoseMotions(SETTINGS, planner), self.states.append)

    def run(self) -> Result:
        return asyncio.run(self.inner.run())

    def phases(self) -> list[str]:
        return [state.phase.value for state in self.states]


def test_job_plans_all_motions_in_order_with_the_phases_of_joint_motions() -> None:
    planner = RecordingPlanner()
    job = RecordedJob(planner)
    assert job.run().ending is JobEnding.SUCCEEDED
    assert planner.calls == CALLS
    assert job.phases() == PHASES
    assert [state.phase.value for state in job.states if state.feedback] == ["start", "ready", "grasp", "place"]


def test_unknown_grade_moves_nothing() -> None:
    planner = RecordingPlanner()
    result = RecordedJob(planner, "q").run()
    assert result.ending is JobEnding.ABORTED
    assert "known grades: A, B, C" in result.message
    assert planner.calls == []


@pytest.mark.parametrize("failing", range(len(CALLS)))
def test_failed_call_aborts_the_job_with_its_reason(failing: int) -> None:
    planner = RecordingPlanner(on_call=lambda n: JobOutcome(n != failing, "link3 would touch the stand"))
    job = RecordedJob(planner)
    result = job.run()
    assert result.ending is JobEnding.ABORTED
    assert "link3 would touch the stand" in result.message
    assert planner.calls == CALLS[: failing + 1]
    assert job.phases()[-1] == "error"


@pytest.mark.parametrize("arrives", [False, True])
@pytest.mark.parametrize("during", range(len(CALLS)))
def test_cancel_makes_no_further_call(during: int, arrives: bool) -> None:
    def cancel_in(call: int) -> JobOutcome:
        if call == during:
            job.inner.cancel()
        return JobOutcome(arrives or call != during)

    planner = RecordingPlanner(on_call=cancel_in)
    job = RecordedJob(planner)
    assert job.run() == Result(JobEnding.CANCELED, 7, "canceled")
    assert planner.calls == CALLS[: during + 1]
    assert planner.stops == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"pick": (0.0,) * 6}, r"pick.pose has 6 numbers: give x, y, z and the quaternion x, y, z, w"),
        ({"pick": (0.0,) * 7}, r"pick.pose: the quaternion has length 0 and must be"),
        ({"bins": {"A": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0)}}, r"bins.A.pose: the quaternion has length 2"),
        ({"pick": (float("nan"), 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)}, r"pick.pose contains a number that is not finite"),
        ({"bins": {"a": PICK}}, "write 'A'"),
        ({"speed": 1.5}, "planning.speed is 1.5"),
        ({"approach_m": 0.0}, "planning.approach_m is 0.0"),
        ({"hand_time_s": float("inf")}, "hand_time_s is inf"),
        ({"group": ""}, "planning.group is empty"),
        ({"target": PickObject(size_m=(0.0, 0.1, 0.1))}, "object.size must be positive"),
        ({"target": PickObject(position_m=(0.0, 0.1))}, "object.position must be 3 finite numbers"),
    ],
)
def test_invalid_setting_is_named(change: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        replace(SETTINGS, **change)
