"""Test the backlash between motor and link: the free travel of the link, what the encoder measures, and how inertia and
friction are split."""

import mujoco
import numpy as np
import pytest

from sim_backend.mechanics.plant import Coupling, WorldPlant
from sim_backend.scene.backlash import OUTPUT_SHARE, motor_name
from sim_backend.scene.world import World
from tests.sim_backend.robot_arm import JOINTS

GAP = 0.02
UPRIGHT = (0.0,) * 7


def world_with_gap(joint: str) -> World:
    return World(initial_position=UPRIGHT, backlash={joint: GAP})


def push(world: World, dof: int, effort: float) -> float:
    """Push from one side of the gap until rest. Return the angle between link and motor."""
    world.data.qfrc_applied[dof] = effort
    for _ in range(2000):
        world.advance()
    world.data.qfrc_applied[dof] = 0.0
    return float(world.data.joint("joint1").qpos[0] - world.data.joint(motor_name("joint1")).qpos[0])


def test_a_link_moves_freely_within_the_gap_only() -> None:
    world = world_with_gap("joint1")
    link = world.model.joint("joint1").dofadr[0]
    # The effort exceeds the friction of the link but not that of the motor.
    torque_nm = 0.02
    assert push(world, link, torque_nm) == pytest.approx(0.5 * GAP, abs=0.05 * GAP)
    assert push(world, link, -torque_nm) == pytest.approx(-0.5 * GAP, abs=0.05 * GAP)
    assert abs(world.data.joint(motor_name("joint1")).qpos[0]) < 0.001


def test_a_reversing_motor_crosses_the_gap_before_the_link_follows() -> None:
    world = world_with_gap("joint1")
    for direction in (1.0, -1.0):
        world.step([0.2 * direction, *[0.0] * 6])
        for _ in range(300):
            world.advance()
        behind = world.data.joint("joint1").qpos[0] - world.data.joint(motor_name("joint1")).qpos[0]
        assert behind == pytest.approx(-0.5 * GAP * direction, abs=0.1 * GAP)


def test_the_encoder_measures_the_link_and_back_emf_follows_the_motor() -> None:
    world = world_with_gap("joint2")
    plant = WorldPlant(world, [Coupling(2, "joint2")])
    world.data.joint("joint2").qpos, world.data.joint(motor_name("joint2")).qpos = 0.3, 0.295
    world.data.joint("joint2").qvel, world.data.joint(motor_name("joint2")).qvel = 1.0, 2.0
    assert plant.angles() == pytest.approx([plant.couplings[0].zero_rad + 0.3])
    assert plant.velocities() == [2.0]
    assert world.velocity()[1] == 1.0
    plant.push([0.5])
    mujoco.mj_forward(world.model, world.data)
    assert world.data.qfrc_actuator[world.model.joint(motor_name("joint2")).dofadr[0]] == 0.5


def test_inertia_and_friction_are_split_between_motor_and_link() -> None:
    plain, gaps = World().model, World(backlash=dict.fromkeys(JOINTS, GAP)).model
    for name in JOINTS:
        whole, link, motor = (
            np.array([model.dof_armature[dof], model.dof_frictionloss[dof], model.dof_damping[dof]])
            for model, dof in (
                (plain, plain.joint(name).dofadr[0]),
                (gaps, gaps.joint(name).dofadr[0]),
                (gaps, gaps.joint(motor_name(name)).dofadr[0]),
            )
        )
        assert link + motor == pytest.approx(whole)
        assert link == pytest.approx(OUTPUT_SHARE * whole)


def test_without_a_gap_the_motor_has_no_separate_joint() -> None:
    assert World().model.nv == World(backlash={}).model.nv == World(backlash={"joint1": GAP}).model.nv - 1


def test_an_arm_starts_in_the_middle_of_its_gaps() -> None:
    world = World(backlash=dict.fromkeys(JOINTS, GAP))
    for joint in JOINTS:
        assert world.data.joint(motor_name(joint)).qpos == world.data.joint(joint).qpos
