"""The grader is tested with painted pictures whose true values are known for each pixel."""

import cv2
import numpy as np
import pytest

from perception.grading.grader import GradedApple, Grader
from perception.grading.settings import GradingSettings
from perception.perception_errors import PictureRefused
from tests.perception import painted

CENTER = np.array([0.25, 0.0, 0.03])


@pytest.fixture(scope="module")
def grader() -> Grader:
    return Grader(painted.view())


def graded(
    grader: Grader, apples: list[painted.PaintedApple], lamp: painted.Lamp, seed: int = 0
) -> list[tuple[GradedApple, painted.PaintedTruth]]:
    """Return each apple of a picture together with its true values; fail if an apple is missed or invented."""
    picture, truth = painted.paint(painted.view(), apples, lamp, seed)
    found = grader.grade(picture)
    assert len(found) == len(truth), [apple.position_m for apple in found]
    by_place = [min(found, key=lambda one: np.linalg.norm(one.position_m - real.position_m)) for real in truth]
    return list(zip(by_place, truth, strict=True))


@pytest.mark.parametrize("seed", range(5))
def test_the_values_of_apples_are_measured_in_any_light(grader: Grader, seed: int) -> None:
    rng = np.random.default_rng(seed)
    apples = painted.random_apples(rng, 5, gap_m=0.0)
    for apple, truth in graded(grader, apples, painted.random_lamp(rng), seed):
        assert abs(apple.diameter_mm - truth.diameter_mm) < 2.0
        assert np.linalg.norm(apple.position_m - truth.position_m) < 0.004
        assert abs(apple.red_ratio - truth.red_ratio) < 0.05
        assert abs(apple.defect_score - truth.defect_score) < 0.04


@pytest.mark.parametrize(
    ("ground", "red_share", "expected_red"),
    [(painted.GREEN, 0.0, 0.0), (painted.YELLOW, 0.0, 0.0), (painted.GREEN, 1.0, 1.0)],
)
def test_an_apple_of_one_color_has_no_defect(
    grader: Grader, ground: np.ndarray, red_share: float, expected_red: float
) -> None:
    apple = painted.PaintedApple(CENTER, 0.03, ground, red_share, np.array([0.0, 0.0, 1.0]))
    [(found, _)] = graded(grader, [apple], painted.Lamp(lamp=0.8, direction=painted.unit(np.array([1.0, 0.5, 0.7]))))
    assert found.defect_score < 0.01 and abs(found.red_ratio - expected_red) < 0.02


@pytest.mark.parametrize("quality", [75, 90])
@pytest.mark.parametrize("seed", [1001, 1018])
def test_a_compressed_picture_adds_no_defects(grader: Grader, seed: int, quality: int) -> None:
    rng = np.random.default_rng(seed)
    apples, lamp = painted.random_apples(rng, 3), painted.random_lamp(rng)
    picture, truth = painted.paint(painted.view(), apples, lamp, seed)
    jpeg = cv2.imencode(".jpg", picture[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, quality))[1]
    found = grader.grade(np.ascontiguousarray(cv2.imdecode(jpeg, cv2.IMREAD_COLOR)[..., ::-1]))
    sound = [real for real in truth if real.defect_score == 0.0]
    assert sound
    for real in sound:
        apple = min(found, key=lambda one: float(np.linalg.norm(one.position_m - real.position_m)))
        assert apple.defect_score < 0.03


@pytest.mark.parametrize("known", [False, True])
def test_a_yellow_apple_on_a_table_of_wood_is_sound(known: bool) -> None:
    wood = np.array([0.45, 0.30, 0.16])
    apple = painted.PaintedApple(CENTER, 0.03, painted.YELLOW, 0.0, np.array([0.0, 0.0, 1.0]))
    picture, _ = painted.paint(painted.view(), [apple], painted.Lamp(lamp=0.8), 0, wood)
    settings = GradingSettings(table_rgb=tuple(wood)) if known else GradingSettings()
    [found] = Grader(painted.view(), settings).grade(picture)
    assert found.defect_score < 0.02 and found.red_ratio < 0.02


@pytest.mark.parametrize("table", [(0.045, 0.045, 0.05), (0.06, 0.10, 0.26)])
@pytest.mark.parametrize("seed", range(2))
def test_the_table_does_not_change_the_size_or_the_defects(table: tuple[float, float, float], seed: int) -> None:
    """In a blurred picture, a bright apple on a dark or blue table is surrounded by a colored rim."""
    apples = painted.random_apples(np.random.default_rng(seed), 3, gap_m=0.02)
    picture, truth = painted.paint(painted.view(), apples, painted.Lamp(lamp=0.8), seed, np.array(table))
    found = Grader(painted.view(), GradingSettings(table_rgb=table)).grade(picture)
    assert len(found) == len(truth)
    for real in truth:
        apple = min(found, key=lambda one: float(np.linalg.norm(one.position_m - real.position_m)))
        assert abs(apple.diameter_mm - real.diameter_mm) < 1.5
        assert abs(apple.defect_score - real.defect_score) < 0.03


def test_the_shadow_of_another_apple_is_not_a_defect(grader: Grader) -> None:
    lamp = painted.Lamp(lamp=0.8, ambient=0.3, direction=painted.unit(np.array([0.0, 1.0, 0.8])))
    apples = [
        painted.PaintedApple(np.array([0.25, y, r]), r, painted.GREEN, share, np.array([0.0, 0.3, 1.0]))
        for y, r, share in ((-0.045, 0.035, 0.5), (0.035, 0.035, 1.0))
    ]
    assert all(found.defect_score < 0.02 for found, _ in graded(grader, apples, lamp))


def test_an_apple_that_another_hides_is_found_but_not_graded(grader: Grader) -> None:
    apples = [
        painted.PaintedApple(np.array([x, y, r]), r, painted.GREEN, 1.0, np.array([0.0, 0.0, 1.0]))
        for x, y, r in ((0.15, 0.0, 0.04), (0.225, 0.01, 0.03))
    ]
    low = painted.view(height_m=0.25, back_m=0.4)
    picture, truth = painted.paint(low, apples, painted.Lamp(lamp=0.7), 0)
    assert truth[1].visible < 0.7
    near, far = Grader(low).grade(picture)
    assert near.grade == "A" and not near.reason
    assert far.grade == "" and "of it is visible" in far.reason


@pytest.mark.parametrize("rgb", [(25, 25, 28), (120, 120, 122), (225, 225, 225)])
def test_an_apple_with_a_finger_in_front_of_it_is_not_graded(grader: Grader, rgb: tuple[int, int, int]) -> None:
    """A dark finger would otherwise count as a defect."""
    apple = painted.PaintedApple(CENTER, 0.03, painted.GREEN, 1.0, np.array([0.0, 0.0, 1.0]))
    picture, _ = painted.paint(painted.view(), [apple], painted.Lamp(lamp=0.8), 0)
    [alone] = grader.grade(picture)
    left, top, _, height = alone.box_px
    picture[: top + height // 2, left : left + 14] = rgb
    [found] = grader.grade(picture)
    assert alone.grade == "A" and found.grade == "" and "something in front of it covers" in found.reason


def test_an_apple_at_the_edge_of_the_picture_has_no_grade(grader: Grader) -> None:
    apple = painted.PaintedApple(np.array([0.25, 0.285, 0.03]), 0.03, painted.GREEN, 1.0, np.array([0.0, 0.0, 1.0]))
    picture, _ = painted.paint(painted.view(), [apple], painted.Lamp(lamp=0.7), 0)
    assert [one.grade for one in grader.grade(picture)] in ([], [""])


def test_things_that_are_no_apples_are_ignored(grader: Grader) -> None:
    picture, _ = painted.paint(painted.view(), [], painted.Lamp(lamp=0.7), 0)
    picture[100:300, 100:140] = (200, 40, 20)  # a red stick
    picture[50:60, 400:410] = (200, 40, 20)  # a red crumb
    picture[250:420, 380:600] = (40, 40, 40)  # a gray box
    assert grader.grade(picture) == []


@pytest.mark.parametrize(
    ("picture", "message"),
    [
        (np.zeros((480, 640, 3), np.uint8), "almost black .* remove the lens cap"),
        (np.full((480, 640, 3), 255, np.uint8), "100 % of the image is overexposed"),
        (np.full((720, 1280, 3), 90, np.uint8), "calibration is for .480, 640, 3. uint8"),
    ],
)
def test_a_picture_that_shows_nothing_is_refused(grader: Grader, picture: np.ndarray, message: str) -> None:
    with pytest.raises(PictureRefused, match=message):
        grader.grade(picture)
