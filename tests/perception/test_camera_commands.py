"""``servoloop camera`` with pictures in a folder instead of a camera."""

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from perception.calibration.board import Board, BoardDetector
from perception.calibration.collect import distance_px
from perception.camera_view import read_pose
from perception.intrinsics import intrinsics_text, read_intrinsics
from servoloop.cli import main
from tests.perception import test_calibration as boards


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    """Run a command line, and return its exit status."""
    monkeypatch.setattr("sys.argv", ["servoloop", "camera", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def pictures(folder: Path, count: int) -> None:
    """Write views of a board to files, each of them twice."""
    folder.mkdir()
    for number, view in enumerate(boards.pictures(count, 0.45)):
        for again in range(2):
            cv2.imwrite(str(folder / f"{number:02}{again}.png"), view[..., ::-1])


def test_the_lens_and_then_the_plane_are_calibrated(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pictures(folder / "views", 10)
    assert run(monkeypatch, "calibrate", "views", "--views", "10", "--name", "left") == 0
    lens = read_intrinsics(folder / "camera.yaml")
    assert lens.matrix[0, 0] == pytest.approx(612.0, rel=0.01) and lens.name == "left"
    assert "10 views: focal lengths" in capsys.readouterr().out
    (folder / "camera.yaml").write_text(intrinsics_text(boards.LENS))
    shift = np.array([-0.13, -0.08, 0.42])
    cv2.imwrite("plane.png", boards.seen(np.array([0.6, 0.0, 0.0]), shift, 0))
    assert run(monkeypatch, "plane", "plane.png", "--x", "0.2", "--y", "0.13", "--z", "0.02") == 0
    pose = read_pose(folder / "camera_pose.yaml", "camera")
    assert pose.plane_height_m == 0.02 and 0.2 < pose.position_m[2] < 0.5
    assert "reprojection error" in capsys.readouterr().out


@pytest.mark.parametrize(("columns", "rows"), [(4, 4), (10, 10), (11, 10), (14, 10)])
def test_a_board_of_any_size_is_written_and_found(
    folder: Path, monkeypatch: pytest.MonkeyPatch, columns: int, rows: int
) -> None:
    size = ("--columns", str(columns), "--rows", str(rows), "--square", "14")
    assert run(monkeypatch, "board", "board.pdf", *size) == run(monkeypatch, "board", "board.png", *size) == 0
    picture = cv2.copyMakeBorder(cv2.imread("board.png"), 100, 100, 100, 100, cv2.BORDER_CONSTANT, value=(255,) * 3)
    view = BoardDetector(Board(columns, rows, 0.014)).view(picture)
    assert len(view.corners_m) == (columns - 1) * (rows - 1)


def test_one_view_of_a_pose_counts_once(folder: Path) -> None:
    one, other = (boards.DETECTOR.view(picture) for picture in boards.pictures(2, 0.45))
    assert distance_px(one, one) == 0.0 and distance_px(one, other) > 0.05 * 640


def test_a_picture_is_saved_with_the_true_rate(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "shots").mkdir()
    for number in range(3):
        cv2.imwrite(str(folder / f"shots/{number}.png"), np.full((48, 64, 3), 40 * number, np.uint8))
    assert run(monkeypatch, "show", "shots", "--out", "now.png") == 0
    assert cv2.imread("now.png")[0, 0, 0] == 80
    assert "shots: 64 × 48 pixels," in capsys.readouterr().out


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("show 77", "there is no camera /dev/video77: "),
        ("board board.gif", "board.gif ends neither with .pdf nor with .png"),
        ("board no/board.pdf", "cannot write no/board.pdf: No such file or directory: choose another file"),
        (
            "plane 77 --x 0 --y 0",
            "camera.yaml does not exist: measure the intrinsics with 'servoloop camera calibrate'",
        ),
        ("plane 77 --x 0 --y 0 --camera lens.yaml --out no/pose.yaml", "cannot write into no: No such file"),
        ("calibrate 77 --out no/camera.yaml", "cannot write into no: No such file or directory"),
        ("show 77 --out no/camera.png", "cannot write into no: No such file or directory"),
        ("calibrate nothing", "there is no file or folder nothing"),
    ],
)
def test_bad_input_is_one_sentence(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], line: str, message: str
) -> None:
    (folder / "lens.yaml").write_text(intrinsics_text(boards.LENS))
    assert run(monkeypatch, *line.split()) == 1
    printed = capsys.readouterr().err
    assert message in printed and "Traceback" not in printed and printed.count("\n") == 1


def test_the_board_is_a_page_or_a_picture(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(monkeypatch, "board", "board.pdf") == 0 and run(monkeypatch, "board", "board.png", "--rows", "5") == 0
    assert (folder / "board.pdf").read_bytes().startswith(b"%PDF")
    assert cv2.imread("board.png").shape == (600, 1080, 3)


def test_opencv_adds_nothing_to_the_sentence(folder: Path) -> None:
    """FFmpeg reads its log level once in a process, so each command runs in its own."""
    for name, content in (("torn.png", b"\x89PNG\r\n\x1a\nxx"), ("torn.mp4", b"\x00" * 100)):
        (folder / name).write_bytes(content)
        command = [sys.executable, "-m", "servoloop", "camera", "show", name]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        assert done.returncode == 1 and done.stderr.count("\n") == 1, done.stderr
