"""The commands and files of docs/camera.md."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from perception.camera_view import read_pose
from perception.detector.classes import read_classes
from perception.grading.settings import read_settings
from perception.intrinsics import intrinsics_text, read_intrinsics
from perception.sources import choice
from perception.sources.recorded import RecordedSource
from tests.pages import code
from tests.perception import test_calibration as boards
from tests.perception.test_camera_commands import run

LIST, SHOW = "servoloop camera list", "servoloop camera show 0"
BOARD, CALIBRATE = "servoloop camera board board.pdf", "servoloop camera calibrate 0 --square 30"
PLANE = "servoloop camera plane 0 --x 0.15 --y 0.13"


@pytest.mark.runs(LIST, SHOW, BOARD, CALIBRATE, PLANE)
def test_the_commands_work_with_pictures_in_the_place_of_the_camera(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shots = tmp_path / "shots"
    shots.mkdir()
    for number, picture in enumerate(boards.pictures(12, 0.45)):
        cv2.imwrite(str(shots / f"{number:02}.png"), picture[..., ::-1])
    monkeypatch.setattr(choice, "VideoDevice", lambda source, clock, *_: RecordedSource(shots, clock))
    for command in (LIST, SHOW, BOARD, CALIBRATE):
        assert run(monkeypatch, *command.split()[2:]) == 0, command
    assert (tmp_path / "camera.png").exists() and (tmp_path / "board.pdf").exists()
    assert read_intrinsics(tmp_path / "camera.yaml").matrix[0, 0] == pytest.approx(612.0, rel=0.01)
    (tmp_path / "camera.yaml").write_text(intrinsics_text(boards.LENS))
    flat = boards.seen(np.array([0.6, 0.0, 0.0]), np.array([-0.13, -0.08, 0.42]), 0)
    cv2.imwrite(str(shots / "00.png"), flat)
    assert run(monkeypatch, *PLANE.split()[2:]) == 0
    assert read_pose(tmp_path / "camera_pose.yaml", "camera").position_m[2] > 0.2


@pytest.mark.runs("camera.md yaml 1")
def test_the_grades_are_those_of_the_page(tmp_path: Path) -> None:
    (tmp_path / "grades.yaml").write_text(code("camera.md", "yaml"))
    settings = read_settings(tmp_path / "grades.yaml")
    assert settings.grade_of(70.0, 0.9, 0.0) == "A" and settings.grade_of(50.0, 0.9, 0.0) == ""


@pytest.mark.runs("camera.md yaml 2")
def test_the_classes_are_those_of_the_page(tmp_path: Path) -> None:
    (tmp_path / "classes.yaml").write_text(code("camera.md", "yaml", 2))
    assert read_classes(tmp_path / "classes.yaml").grades == ("", "A", "B", "C")
