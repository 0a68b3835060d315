"""The camera of a scene: its pictures follow the published states of the world."""

import numpy as np
import pytest

from hal.hal_errors import ArmFileError
from servoloop.stack.arm_folders import find_arm
from sim_backend.camera.scene_camera import SceneCamera
from sim_backend.camera.sensor import Sensor
from sim_backend.scene.world import World
from sim_backend.scene.world_feed import snapshot

QUIET = Sensor(noisy=False)
AWAY = [0.9, -0.2, -0.8, -0.6, -1.1, 1.55, 0.0]


@pytest.fixture(scope="module")
def camera():
    return SceneCamera(find_arm("robot_arm").scene, sensor=QUIET, seed=1)


def shown(camera, world):
    camera.see(snapshot(world, 0.0))
    return camera.picture().astype(int)


def test_the_picture_shows_the_apple_of_the_world(camera):
    world = World(apples=4)
    first = shown(camera, world)
    truth = camera.truth()
    assert truth.diameter_mm == world.apple.diameter_mm and not truth.occluded
    np.testing.assert_allclose(truth.position_m, world.cell.home[:3], atol=1e-9)
    world.cell.feed_cube()
    left, top, right, bottom = truth.box_px
    changed = (shown(camera, world) != first).any(axis=2)
    assert camera.truth().diameter_mm == world.apple.diameter_mm
    assert changed[top:bottom, left:right].mean() > 0.5


def test_the_picture_follows_the_arm(camera):
    world = World(apples=4)
    before = shown(camera, world)
    moved = World(initial_position=AWAY, apples=4)
    assert (np.abs(shown(camera, moved) - before).max(axis=2) > 20).mean() > 0.02
    np.testing.assert_array_equal(shown(camera, world), before)


def test_an_apple_in_the_hand_is_seen_there(camera):
    world = World(apples=4)
    shown(camera, world)
    at_stand = camera.truth().box_px
    world.data.qpos[world.cell.qpos][:3] += [0.0, 0.05, 0.04]
    shown(camera, world)
    assert camera.truth().box_px[0] > at_stand[0] + 40 and camera.truth().box_px[1] < at_stand[1] - 20


def test_only_the_noise_changes_while_nothing_moves():
    noisy = SceneCamera(find_arm("robot_arm").scene, seed=1)
    world = World(apples=4)
    first, second = shown(noisy, world), shown(noisy, world)
    assert 0.5 < np.abs(second - first).mean() < 8.0


def test_both_fingers_follow_the_hand(camera):
    opened, closed = (World(initial_position=[*AWAY[:6], hand], apples=4) for hand in (0.0, 0.05))
    camera.see(snapshot(closed, 0.0))
    np.testing.assert_allclose(camera._data.qpos, closed.data.qpos, atol=1e-9)
    camera.see(snapshot(opened, 0.0))
    np.testing.assert_allclose(camera._data.qpos, opened.data.qpos, atol=1e-9)


def test_a_scene_without_a_camera_is_refused(tmp_path):
    path = tmp_path / "scene.xml"
    text = find_arm("robot_arm").scene.read_text()
    path.write_text(text.replace('<camera name="camera"', '<camera name="other"'))
    with pytest.raises(ArmFileError, match="has no camera"):
        SceneCamera(path)
