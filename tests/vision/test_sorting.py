"""The whole job in simulated time: picture, grade, motion and bin; without an apple on the stand, there is no grade."""

from pathlib import Path

import pytest

from drivers.clock import MonotonicClock
from perception.grading.grader import GradedApple, Grader
from servoloop.demo.cell_options import CellOptions
from servoloop.simulation.job import run_job
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.pick_place import load_pick_place
from servoloop.virtual_camera import VirtualCamera
from sim_backend.buses.build import Build
from sim_backend.camera.scene_camera import SceneCamera
from sim_backend.scene.world_feed import snapshot

SEED = 2
"""Seed with apples of different grades."""
PAUSE_S = 4.0
LOOK_S = 0.2


@pytest.mark.parametrize(("seed", "apples"), [(None, 2), (0, 0), (1, 1)])
def test_the_apples_of_the_demo_have_the_seed_of_the_user(seed: int | None, apples: int) -> None:
    assert CellOptions(vision=True, seed=seed).apples == apples
    assert CellOptions(seed=seed).apples is None


@pytest.mark.parametrize("name", ["robot_arm", "so101"])
def test_apples_are_sorted_by_what_the_camera_sees(name: str, tmp_path: Path) -> None:
    arm = find_arm(name)
    stack = SimulatedStack(files=read_arm_files(arm), build=Build(1.0, 1, apples=SEED)).up()
    source = VirtualCamera(tmp_path / "bus", arm.scene, MonotonicClock())
    camera, grader = SceneCamera(arm.scene), Grader(source.view, source.settings)
    settings = load_pick_place(arm.pick_place).settings()
    cell = stack.world.cell
    assert cell is not None

    def graded() -> list[GradedApple]:
        camera.see(snapshot(stack.world, 0.0))
        return [apple for apple in grader.grade(camera.picture()) if apple.grade]

    grades = set()
    for number in range(3):
        stack.run(1.0)
        (apple,), truth = graded(), camera.truth()
        assert truth is not None and cell.fed == number
        assert apple.grade == source.settings.grade_of(truth.diameter_mm, truth.red_ratio, truth.defect_score)
        grades.add(apple.grade)
        assert run_job(stack, settings, apple.grade, number + 1).bin == apple.grade
        for _ in range(round(PAUSE_S / LOOK_S)):
            stack.run(LOOK_S)
            assert cell.cube_on_stand() or not graded(), "the apple in the bin must not start a job"
    assert len(grades) > 1
