"""The demo that sorts apples ends soon if an apple stays in the hand after a failed job."""

from time import perf_counter
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("cv2")

from nodes.clients.sorting_monitor import SortingJob, SortingMonitor
from pick_place.job import JobPhase
from servoloop.demo import sorting
from servoloop.demo.sorting import Sorter
from servoloop.stack.arm_folders import find_arm
from sim_backend.camera.scene_camera import SceneCamera


class Cell:
    """A cell in which the first apple of the tray never leaves the hand."""

    def __init__(self, monitor: SortingMonitor) -> None:
        self._monitor, self.runner, self.said = monitor, self, []
        self.camera = SimpleNamespace(newest={"apple": {"seed": 1}, "joints": {}}, bin=None)

    def idle(self, seconds: float) -> None:
        """Let the job of the apple fail."""
        if not self._monitor.jobs:
            job = SortingJob(1, "A", 0.0, phase=JobPhase.ERROR, message="the arm aborted")
            self._monitor.jobs.append(job)

    def say(self, text: str) -> None:
        self.said.append(text)


def test_an_apple_in_the_hand_ends_the_demo_with_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sorting, "STUCK_S", 0.05)
    monitor = SortingMonitor()
    cell = Cell(monitor)
    sorter = Sorter(cell, monitor, SceneCamera(find_arm("robot_arm").scene), cell)
    sorter._last_seed = 1  # the apple has come, and its job has failed
    began_s = perf_counter()
    assert sorter.run(2) == []
    assert perf_counter() - began_s < 5.0
    assert "after a failed job (the arm aborted), so the apple is still in the hand" in cell.said[0]
