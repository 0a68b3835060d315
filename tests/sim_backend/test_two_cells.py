"""A world with two arms: each has a cell of its own with a cube, and each cube is replaced on its own."""

import numpy as np
import pytest

from servoloop.stack.arm_folders import find_arm
from sim_backend.scene.cube_cell import CubeCell
from sim_backend.scene.feeder import Feeder
from sim_backend.scene.world import World


@pytest.fixture
def world() -> World:
    scene = find_arm("bimanual_so101").scene
    return World(scene, World(scene).ready.tolist())


def put(cell: CubeCell, world: World, bin_: str) -> None:
    """Put the cube of a cell into one of its bins, at rest."""
    x, y, z = world.poses()[f"{cell.prefix}bin_{bin_}"].position_m
    world.data.qpos[cell.qpos][:3] = (x, y, z + 0.0125)
    world.data.qvel[cell.qvel] = 0.0


def test_each_cube_is_in_a_bin_of_its_own_cell(world: World) -> None:
    left, right = world.cells
    assert set(world.poses()) >= {"left_cube", "right_cube", "left_bin_A", "right_bin_C"}
    put(left, world, "A")
    assert world.cube_bins() == {"left_cube": "A", "right_cube": None} and right.cube_on_stand()
    assert (world.cube_bin(), world.cube_bin("left_gripper"), world.cube_bin("right_gripper")) == ("A", "A", None)


def test_a_cube_comes_when_the_arm_of_its_cell_leaves(world: World) -> None:
    feeder, (left, right) = Feeder(), world.cells
    assert [world.joints[i] for i in world.joints_of(right)][-1] == "right_gripper"
    put(left, world, "B")
    put(right, world, "B")
    for step in range(100):
        feeder.update(world, 0.01 * step)
    assert feeder.due and (left.fed, right.fed) == (0, 0)
    world.data.joint("right_shoulder_lift").qpos += 0.3
    for step in range(100, 110):
        feeder.update(world, 0.01 * step)
    assert (left.fed, right.fed) == (0, 1) and right.cube_on_stand() and world.cube_bin("left_gripper") == "B"


def test_a_cleared_table_is_restored(world: World) -> None:
    before = world.model.geom_contype.copy(), world.model.geom_conaffinity.copy(), world.model.geom_rgba.copy()
    world.clear_table()
    things = [world.model.geom(name).id for name in ("left_stand", "right_stand", "left_cube", "right_cube")]
    assert not world.laid and not world.model.geom_conaffinity[things].any()
    assert world.model.geom_conaffinity[world.model.geom("table").id]
    world.lay_table()
    assert world.laid
    after = world.model.geom_contype, world.model.geom_conaffinity
    for now, then in zip(after, before, strict=False):
        np.testing.assert_array_equal(now, then)
