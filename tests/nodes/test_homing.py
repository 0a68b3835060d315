"""A homing motion that is stopped while the hand opens does not begin."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rclpy")

from nodes.pick_place import homing
from nodes.pick_place.homing import Homing
from pick_place.job import JobOutcome
from pick_place.settings import JobSettings


class RecordingArm:
    """Arm that records its commands."""

    def __init__(self, *_: Any) -> None:
        self.commands: list[Any] = []

    def hand(self, position_m: float) -> None:
        self.commands.append(position_m)

    def move(self, positions_rad: Sequence[float]) -> JobOutcome:
        self.commands.append(positions_rad)
        return JobOutcome(True)

    def stop(self) -> None: ...


class Executor:
    """Executor whose tasks are done at once."""

    def create_task(self, outcome: JobOutcome) -> Any:
        return SimpleNamespace(done=lambda: True, result=lambda: outcome)

    def spin_once(self, timeout_sec: float) -> None: ...


@pytest.mark.parametrize("stops", [False, True])
def test_a_stop_while_the_hand_opens_prevents_the_motion(monkeypatch: pytest.MonkeyPatch, stops: bool) -> None:
    arm, settings = RecordingArm(), JobSettings()
    monkeypatch.setattr(homing, "RosArm", lambda *_: arm)
    monkeypatch.setattr(homing, "OPEN_S", 0.0)
    node: Any = SimpleNamespace()
    executor: Any = Executor()
    outcome = Homing(node, executor, settings).home(lambda: stops)
    assert outcome == JobOutcome(not stops)
    assert arm.commands == [settings.hand_open_m, *([] if stops else [settings.ready_rad])]
