"""Pictures: the rays are compared with MuJoCo's own, and the saved files are checked."""

from typing import Any

import mujoco
import numpy as np
import pytest
from PIL import Image

from hal.robot_description.link_meshes import link_meshes
from servoloop.stack.arm_folders import find_arm
from sim_backend.scene.drawn_model import drawn_model
from sim_backend.scene.picture import FilmRecorder, View
from sim_backend.scene.rays import VISIBLE_GROUPS, cast, visible
from sim_backend.scene.world import World


def boxes_and_cylinders() -> tuple[Any, Any]:
    world = World(initial_position=[0.4, -0.2, -0.8, -0.6, -1.1, 1.55, 0.02])
    return world.model, world.data


def meshes() -> tuple[Any, Any]:
    model = World(find_arm("so101").scene, backlash={"shoulder_pan": 0.02}).drawn_model()
    data = mujoco.MjData(model)
    data.qpos[:6] = [0.4, -0.2, 0.8, 0.6, -1.1, 1.2]
    mujoco.mj_kinematics(model, data)
    return model, data


def spheres_and_ellipsoids() -> tuple[Any, Any]:
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><geom type="plane" size="0 0 1"/><geom type="sphere" size="0.1" pos="0.15 0.05 0.12"/>
        <geom type="ellipsoid" size="0.15 0.04 0.08" pos="0.2 0 0.1" euler="20 50 70"/></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


@pytest.mark.parametrize("shapes", [boxes_and_cylinders, meshes, spheres_and_ellipsoids])
def test_ray_hits_match_mujoco(shapes):
    (model, data), random = shapes(), np.random.default_rng(7)
    round_meshes = model.nmesh > 0
    groups = np.array([i in VISIBLE_GROUPS for i in range(6)], dtype=np.uint8)
    for eye in ([0.9, -0.6, 0.62], [0.0, 0.5, 0.3], [0.3, 0.0, 0.9]):
        origin = np.array(eye)
        rays = random.normal([0.2, 0.0, 0.12], [0.12, 0.12, 0.1], (600, 3)) - origin
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        geom, distance, normal = cast(model, data, origin, rays, visible(model))
        for i, ray in enumerate(rays):
            its_geom, its_normal = np.zeros(1, dtype=np.int32), np.zeros(3)
            its_distance = mujoco.mj_ray(model, data, origin, ray, groups, True, -1, its_geom, its_normal)
            assert geom[i] == its_geom[0]
            if its_distance >= 0.0:
                assert distance[i] == pytest.approx(its_distance, abs=1e-7 if round_meshes else 1e-9)
                smooth = round_meshes and model.geom_type[geom[i]] == mujoco.mjtGeom.mjGEOM_MESH
                np.testing.assert_allclose(normal[i], its_normal, atol=0.4 if smooth else 1e-6)
        assert not round_meshes or (model.geom_type[geom[geom >= 0]] == mujoco.mjtGeom.mjGEOM_MESH).any()


def test_real_shapes_are_drawn_but_not_simulated():
    world = World(find_arm("so101").scene, backlash={"gripper": 0.02})
    drawn, model = world.drawn_model(), world.model
    assert model.nmesh == 0 and drawn.nmesh > 10 and drawn.nq == model.nq
    is_mesh = drawn.geom_type == mujoco.mjtGeom.mjGEOM_MESH
    assert not drawn.geom_contype[is_mesh].any() and not drawn.geom_conaffinity[is_mesh].any()
    np.testing.assert_allclose(drawn.body_mass, model.body_mass)
    seen = visible(drawn)
    arm = drawn.body_rootid[drawn.geom_bodyid] == drawn.body("base_link").id
    assert set(seen[arm[seen]]) == set(np.flatnonzero(is_mesh)), "boxes of the arm must not be visible"
    assert drawn.geom("cube").id in seen and drawn.geom("table").id in seen


def test_an_arm_without_meshes_is_drawn_like_its_scene():
    world = World()
    drawn = world.drawn_model()
    assert drawn.nmesh == 0
    np.testing.assert_array_equal(visible(drawn), visible(world.model))


def test_a_cleared_table_is_not_drawn():
    world = World()
    world.clear_table()
    assert world.model.geom("cube").id not in visible(world.drawn_model())


def test_meshes_of_links_outside_the_scene_are_left_out():
    spec = mujoco.MjSpec.from_string("<mujoco><worldbody><body name='other'/></worldbody></mujoco>")
    assert drawn_model(spec, link_meshes(find_arm("so101").folder)).nmesh == 0


def test_the_picture_shows_the_cube_and_the_bins():
    world = World()
    image = View(world.model, world.data, width=120, height=90).picture(world.data).astype(int)
    assert image.shape == (90, 120, 3)
    red, green, blue = image[..., 0], image[..., 1], image[..., 2]
    for share in (red > 2 * (green + 5), green > red + 25, blue > red + 40, (red > blue + 80) & (green > blue + 50)):
        assert share.mean() > 0.001


def test_a_picture_does_not_depend_on_earlier_pictures():
    """The compared pictures include areas that the arm no longer hides or shades."""
    worlds = [World(initial_position=[turn, 0.3, -0.6, -0.8, -0.9, 0.4, 0.02]) for turn in (-0.6, 0.0, 0.7)]
    view = View(worlds[0].model, worlds[0].data, width=120, height=90)
    pictures = [view.picture(world.data) for world in worlds]
    for world, picture in zip(worlds, pictures, strict=True):
        alone = View(world.model, world.data, width=120, height=90).picture(world.data)
        np.testing.assert_array_equal(picture, alone)
    assert (pictures[0] != pictures[1]).any() and (pictures[1] != pictures[2]).any()


def test_only_known_shapes_are_drawn():
    world = World()
    world.model.geom_type[world.model.geom("cube").id] = int(mujoco.mjtGeom.mjGEOM_CAPSULE)
    with pytest.raises(ValueError, match="spheres, ellipsoids, boxes, cylinders and meshes"):
        View(world.model, world.data, width=60, height=45, smooth=False).picture(world.data)


def test_the_recorder_skips_rests_and_limits_its_memory():
    world = World()
    recorder = FilmRecorder(world, period_s=0.1, frames=5)
    for i in range(30):
        recorder.update(0.1 * i)
    assert len(recorder._taken) == 1
    for i in range(30, 60):
        world.data.qpos[0] += 0.01
        recorder.update(0.1 * i)
    assert len(recorder._taken) == 5


def test_files_are_written_and_the_world_is_left_alone(tmp_path):
    world = World()
    recorder = FilmRecorder(world, period_s=0.1, frames=2)
    recorder.update(0.0)
    world.data.qpos[world.cell.qpos][2] += 0.05
    recorder.update(0.1)
    before = world.data.xpos.copy()
    recorder.save(tmp_path / "pictures", width=240)
    np.testing.assert_array_equal(world.data.xpos, before)
    with Image.open(tmp_path / "pictures" / "arm.png") as still:
        assert still.size == (240, 180)
    with Image.open(tmp_path / "pictures" / "arm.gif") as film:
        assert getattr(film, "n_frames", 1) == 2 and film.info["loop"] == 0
