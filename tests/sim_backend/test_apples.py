"""Apples that replace the cube: they lie on the stand, the hand carries them, and the next one appears by itself."""

import mujoco
import numpy as np
import pytest

from hal.hal_errors import ArmFileError
from servoloop.simulation.job import run_job
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.pick_place import load_pick_place
from sim_backend.buses.build import Build
from sim_backend.scene.world import World

ARMS = ("robot_arm", "so101")
PAUSE_S = 3.0
"""Time between two jobs, in which the next apple appears."""


@pytest.mark.parametrize("name", ARMS)
def test_every_apple_goes_to_its_bin(name):
    arm = find_arm(name)
    stack = SimulatedStack(files=read_arm_files(arm), build=Build(1.0, 1, apples=5)).up()
    settings, cell, diameters_mm = load_pick_place(arm.pick_place).settings(), stack.world.cell, set()
    for number, grade in enumerate("ABC"):
        stack.run(PAUSE_S)
        assert cell.fed == number and cell.cube_on_stand()
        diameters_mm.add(cell.apple.diameter_mm)
        assert run_job(stack, settings, grade, number + 1).bin == grade
    assert len(diameters_mm) == 3


@pytest.mark.parametrize("name", ARMS)
def test_apples_lie_on_the_stand(name):
    world = World(find_arm(name).scene, apples=3)
    low_mm, high_mm = world.cell.tray.diameters_mm
    for _ in range(3):
        world.data.qpos[world._qpos] = world.ready  # The arm is not driven.
        for _ in range(500):
            mujoco.mj_step(world.model, world.data)
            world.data.qvel[: world.cell.qvel.start] = 0.0
        assert world.cell.cube_on_stand()
        assert low_mm <= world.cell.apple.diameter_mm <= high_mm
        world.cell.feed_cube()


def test_an_apple_on_the_edge_of_the_stand_falls():
    """Rolling friction must not hold an apple that has no support."""
    world = World(apples=3)
    world.data.qpos[world.cell.qpos][0] += 0.03
    for _ in range(1500):
        mujoco.mj_step(world.model, world.data)
    assert not world.cell.cube_on_stand() and world.data.qpos[world.cell.qpos][2] < 0.08


def test_the_same_seed_gives_the_same_apples():
    first, again, other = (World(apples=seed).cell for seed in (1, 1, 2))
    assert first.apple == again.apple != other.apple
    first.feed_cube()
    again.feed_cube()
    assert first.apple == again.apple
    np.testing.assert_array_equal(first.home, again.home)


def test_mass_constants_are_those_of_mujoco():
    world = World(apples=1)
    model, dofs = world.model, world.cell.qvel
    changed = [model.dof_invweight0[dofs].copy(), model.body_invweight0[model.body("cube").id].copy()]
    mujoco.mj_setConst(model, mujoco.MjData(model))
    np.testing.assert_allclose(changed[0], model.dof_invweight0[dofs], rtol=1e-6)
    np.testing.assert_allclose(changed[1], model.body_invweight0[model.body("cube").id], rtol=1e-6)


def test_a_scene_without_apples_is_refused():
    with pytest.raises(ArmFileError, match="apple_diameter_m"):
        World(find_arm("koch").scene, apples=1)
