"""Pictures of apples on a table, and the true values of the apples."""

from dataclasses import replace

import numpy as np
import pytest

from sim_backend.apples.apple import Apple, Spot, draw_apple
from sim_backend.camera.light import Light, draw_light, rgb_of_temperature
from sim_backend.camera.sensor import Sensor
from sim_backend.camera.table import AppleTable, LyingApple, draw_tray, render, table_camera

CAMERA = table_camera()
GREEN = Apple(diameter_mm=80.0, height=1.0, red_share=0.0, spots=(), seed=1)
RED = replace(GREEN, red_share=1.0)
ROTTEN = replace(GREEN, spots=(Spot((0.0, 0.0, 1.0), radius_rad=0.5, dark=True),))
FAST = Sensor()


def one(apple: Apple, light: Light | None = None, sensor: Sensor = FAST, x_m: float = 0.0):
    table = AppleTable([LyingApple(apple, x_m, 0.0)], sensor=sensor, smooth=False)
    picture, (truth,) = render(table, CAMERA, light or Light(), seed=3)
    return picture, truth


def middle_of(picture, truth):
    left, top, right, bottom = truth.box_px
    return picture[(top + bottom) // 2, (left + right) // 2].astype(int)


def test_a_picture_repeats_by_its_seeds():
    table = AppleTable(draw_tray(5, 3), smooth=False)
    first, again = render(table, CAMERA, draw_light(5), 5), render(table, CAMERA, draw_light(5), 5)
    np.testing.assert_array_equal(first[0], again[0])
    assert first[1] == again[1]
    assert (render(table, CAMERA, draw_light(5), 6)[0] != first[0]).mean() > 0.3
    assert first[0].shape == (480, 640, 3) and first[0].dtype == np.uint8


def test_the_outline_has_the_apples_size():
    """The outline of a sphere is given by the tangent cone from the eye."""
    _, truth = one(GREEN)
    away_m = float(np.linalg.norm(np.array(truth.position_m) - CAMERA.position_m))
    radius_px = CAMERA.focal_px * np.tan(np.arcsin(0.04 / away_m))
    left, top, right, bottom = truth.box_px
    assert right - left + 1 == pytest.approx(2.0 * radius_px, abs=1.5)
    assert 0.5 * (left + right) == pytest.approx(CAMERA.pixels(np.array([truth.position_m]))[0, 0], abs=1.0)
    assert truth.position_m[2] == pytest.approx(0.04) and bottom > top


@pytest.mark.parametrize(
    ("apple", "red", "defect"),
    [(GREEN, (0.0, 0.001), (0.0, 0.0)), (RED, (0.999, 1.0), (0.0, 0.0)), (ROTTEN, (0.0, 0.001), (0.1, 0.5))],
)
def test_truth_of_the_skin(apple, red, defect):
    _, truth = one(apple)
    assert red[0] <= truth.red_ratio <= red[1]
    assert defect[0] <= truth.defect_score <= defect[1]
    assert truth.visible_share == 1.0 and not truth.occluded


def test_the_share_of_red_is_that_of_the_whole_skin():
    """The mean over many views approaches this value."""
    shares = []
    for x, y, z in np.random.default_rng(2).normal(size=(12, 3)):
        turn = np.array([0.3, x, y, z]) / np.linalg.norm([0.3, x, y, z])
        table = AppleTable([LyingApple(replace(GREEN, red_share=0.4), 0.0, 0.0, tuple(turn))], smooth=False)
        shares.append(render(table, CAMERA, Light(), 1)[1][0].red_ratio)
    assert np.mean(shares) == pytest.approx(0.4, abs=0.12)


def test_colors_in_daylight():
    assert np.argmax(middle_of(*one(RED))) == 0
    assert np.argmax(middle_of(*one(GREEN))) == 1
    picture, truth = one(ROTTEN)
    assert middle_of(picture, truth).max() < 60
    table = picture[400, 100].astype(int)
    assert np.ptp(table) < 12, "a gray table must be gray in light of the sensor's white balance"


def test_warm_light_is_orange():
    red, _, blue = one(GREEN, Light(temperature_k=2700.0))[0][400, 100].astype(int)
    assert red > blue + 40
    assert rgb_of_temperature(6500.0) == pytest.approx([1.0, 1.0, 1.0], abs=0.1)


def test_exposure():
    dark = one(GREEN, Light(illuminance_lux=0.0))[0]
    assert dark.mean() < 10.0
    assert one(GREEN, Light(illuminance_lux=2000.0), Sensor(exposure_s=1 / 30))[0][400].min() > 250
    bright, dim = (one(GREEN, Light(illuminance_lux=lux))[0][300:440, 40:200].astype(float) for lux in (1000.0, 30.0))
    assert bright.mean() == pytest.approx(dim.mean(), abs=8.0), "automatic exposure compensates for the brightness"
    assert dim.std() > 1.5 * bright.std(), "dim pictures have more noise"


def test_an_apple_behind_another_is_occluded():
    camera = CAMERA
    table = AppleTable([LyingApple(GREEN, 0.0, 0.0), LyingApple(RED, 0.085, 0.0)], smooth=False)
    _, (near, far) = render(table, camera, Light(), 1)
    assert not near.occluded
    assert far.occluded and 0.5 < far.visible_share < 0.98


def test_an_apple_at_the_edge_of_the_picture_is_cut():
    _, truth = one(GREEN, x_m=-0.24)
    assert truth.cut and truth.occluded
    gone = one(GREEN, x_m=-1.0)[1]
    assert gone.visible_share == 0.0 and gone.box_px == (0, 0, 0, 0) and not gone.cut


def test_shadows_are_on_the_side_away_from_the_lamp():
    brightness = one(RED, Light(toward=(0.0, 1.0, 1.0)))[0].astype(int).sum(axis=2)
    row = int(CAMERA.pixels(np.array([[0.0, 0.0, 0.0]]))[0, 1])
    assert brightness[row, 320 + 65] < 0.8 * brightness[row, 320 - 65], "the lamp is to the left of the picture"


def test_draws_are_varied():
    apples = [draw_apple(seed) for seed in range(60)]
    assert 0.2 < np.mean([not apple.spots for apple in apples]) < 0.7
    assert np.ptp([apple.diameter_mm for apple in apples]) > 20.0
    assert np.ptp([apple.red_share for apple in apples]) > 0.8


def test_too_many_apples_are_refused():
    with pytest.raises(ValueError, match="40 apples"):
        draw_tray(1, 40)
