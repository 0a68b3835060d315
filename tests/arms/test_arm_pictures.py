"""`servoloop arms show`: a picture of the arm with the positions and directions of its joints."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from hal.robot_description.kinematics import from_rpy
from servoloop import cli
from servoloop.arm_pictures.labels import GAP_PX, _spread
from servoloop.arm_pictures.posed_arm import PosedArm
from servoloop.dashboard.arm_model import DrawnArm
from servoloop.stack.arm_folders import ArmFolder, arms, find_arm, read_arm_servos
from servoloop.stack.shipped_files import ARMS
from sim_backend.scene.still import Solid, take
from tests.hal.test_link_meshes import cube

RUNNER = CliRunner()
TOWARD = np.array([0.5, -1.0, 0.5])
CUBE = cube().reshape(-1, 3), np.arange(36).reshape(-1, 3)


def block(place: tuple[float, float, float], rgb: tuple[float, float, float], size: float = 0.1) -> Solid:
    vertices, faces = CUBE
    return Solid((vertices - 0.5) * size, faces, (place, from_rpy((0.0, 0.0, 0.3))), rgb)


def test_points_are_at_their_computed_pixels() -> None:
    places = np.array([[0.0, 0.0, 0.0], [0.7, 0.1, 0.2], [0.1, 0.4, 0.9]])
    reds = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
    solids = [block(tuple(place.tolist()), rgb) for place, rgb in zip(places, reds, strict=True)]
    still = take(solids, TOWARD, (240, 180), (0.8, 0.8))
    for color, pixel in enumerate(still.pixels(places)):
        others = [part for part in range(3) if part != color]
        seen = still.picture[..., color] > still.picture[..., others].max(axis=2).astype(int) + 40
        rows, columns = np.nonzero(seen)
        assert np.hypot(columns.mean() - pixel[0], rows.mean() - pixel[1]) < 4.0, color
    x, y = (np.abs(still.pixels(places) - (120, 90)) / (120, 90)).max(axis=0)
    assert max(x, y) < 0.8 and max(x, y) > 0.6


@pytest.mark.parametrize("arm", arms(), ids=lambda arm: str(arm.name))
def test_every_arm_has_shapes_and_an_arrow_for_each_servo_toward_greater_positions(arm: ArmFolder) -> None:
    files = read_arm_servos(arm)
    posed = PosedArm(files, {"elbow_flex": 0.4})
    assert list(posed.solids())
    joints = [joint.name for joint in files.robot.joints]
    model = DrawnArm(files.description.joints, joints)
    assert [arrow.name for arrow in posed.arrows()] == joints
    for number, arrow in enumerate(posed.arrows()):
        link = files.description.joints[arrow.name].child
        here = np.array([0.4 if name == "elbow_flex" else 0.0 for name in joints])
        there = here + 1e-4 * (np.arange(len(joints)) == number)
        moved = _carried(model, link, arrow.arrow[0], here, there) - arrow.arrow[0]
        along = arrow.arrow[1] - arrow.arrow[0]
        assert moved @ along > 0.99 * np.linalg.norm(moved) * np.linalg.norm(along)


def _carried(model: DrawnArm, link: str, point: np.ndarray, here: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Return the path of a point fixed to a link."""
    (before, turn), (after, turned) = _matrix(model, link, here), _matrix(model, link, there)
    return after + turned @ turn.T @ (point - before)


def _matrix(model: DrawnArm, link: str, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    place, (x, y, z, w) = model.pose(link, position)
    turn = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(place), np.array(turn)


def test_labels_do_not_cover_each_other_and_stay_in_the_picture() -> None:
    heights = [30.0, 50.0, 30.0, 40.0]
    tops = _spread([10.0, 12.0, 290.0, 295.0], heights, 300.0)
    bottoms = [top + height for top, height in zip(tops, heights, strict=True)]
    assert all(second - first >= GAP_PX for (first, second) in zip(bottoms, tops[1:], strict=False))
    assert tops[0] >= 0.0 and bottoms[-1] <= 300.0 and all(a < b for a, b in pairwise(tops))


@pytest.mark.slow
@pytest.mark.runs("servoloop arms show so101")
def test_picture_is_written_and_the_previous_one_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = Path("out", "arms", "so101.png")
    for _ in range(2):
        result = RUNNER.invoke(cli.app, ["arms", "show", "so101"])
        assert result.exit_code == 0 and result.output == f"{path}\n", result.output
    with Image.open(path) as image:
        colors = np.unique(np.asarray(image).reshape(-1, 3), axis=0)
    assert image.size == (1200, 760) and len(colors) > 1000
    assert path.with_name("so101.png.1").read_bytes() == path.read_bytes()


@pytest.mark.slow
def test_user_arm_is_drawn_from_urdf_and_robot_file_only(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    for name in ("arm.urdf", "robot.yaml", "arm.yaml"):
        (folder / name).write_text((ARMS / "koch" / name).read_text())
    result = RUNNER.invoke(cli.app, ["arms", "show", str(folder), "--out", str(tmp_path / "mine.png")])
    assert result.exit_code == 0, result.output
    with Image.open(tmp_path / "mine.png") as image:
        assert image.size == (1200, 760)


def test_unknown_arm_is_named_in_the_error(tmp_path: Path) -> None:
    result = RUNNER.invoke(cli.app, ["arms", "show", "so102"])
    assert result.exit_code != 0 and "there is no arm so102" in str(result.exception)


def test_links_without_mesh_are_drawn_as_boxes() -> None:
    assert len(list(PosedArm(read_arm_servos(find_arm()), {}).solids())) > 10
