"""Friction that grows with the load: the friction law, on a bench and in the simulated world."""

import numpy as np
import pytest

from drivers.servos import x
from drivers.servos.ax_mx import MX_64, MX_106, AxMxModel
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus, servo_of
from sim_backend.line.common_plant import CommonPlant
from sim_backend.mechanics.gears import Gears
from sim_backend.mechanics.plant import BenchPlant, Coupling, WorldPlant
from sim_backend.scene.world import World
from sim_backend.servos.dynamixel.motors import IDENTIFIED
from tests.sim_backend.robot_arm import JOINTS, READY

GEARS = Gears(0.01, 0.02, 0.05, 0.1, sticking_nm=0.03, sticking_share=0.2, sticking_rad_s=0.5, sticking_exponent=1.0)


def bench(gears: Gears) -> BenchPlant:
    plant = BenchPlant([1])
    plant.fit([gears])
    return plant


def moved(plant: BenchPlant, torque_nm: float, load_nm: float) -> float:
    """Return how far the shaft turns in a second, in rad."""
    before = plant.angles()[0]
    plant.load_nm[:] = [load_nm]
    for _ in range(1000):
        plant.push([torque_nm])
        plant.advance()
    return plant.angles()[0] - before


def test_the_friction_law() -> None:
    assert GEARS.friction_nm(0.0, 100.0) == pytest.approx(0.05)
    assert GEARS.friction_nm(2.0, 100.0) == pytest.approx(0.25)
    assert GEARS.friction_nm(-2.0, 0.0) == pytest.approx(0.05 + 0.03 + 0.3 * 2.0)
    assert GEARS.friction_nm(0.0, -0.5) == pytest.approx(0.05 + 0.03 / np.e)


def test_a_loaded_shaft_starts_only_beyond_the_friction_of_both_torques() -> None:
    # At rest, friction of 0.08 + 0.3 * (motor + load) opposes the torque motor - load, so the motor needs (0.08 + 1.3 *
    # load) / 0.7.
    needed = (0.08 + 1.3 * 1.0) / 0.7
    assert moved(bench(GEARS), 0.99 * needed, -1.0) == 0.0
    assert moved(bench(GEARS), 1.01 * needed, -1.0) > 0.1
    held = (0.7 * 1.0 - 0.08) / 1.3  # with less torque, the load drives the motor
    assert moved(bench(GEARS), 1.01 * held, -1.0) == 0.0
    assert moved(bench(GEARS), 0.99 * held, -1.0) < -0.01


def test_friction_never_reverses_a_shaft() -> None:
    plant = bench(Gears(0.0001, 0.0, 0.01, 0.9, sticking_share=0.5))
    plant.joints.velocity[0] = 1.0
    plant.load_nm[:] = [-0.5]
    speeds = []
    for _ in range(300):
        plant.push([0.5])
        plant.advance()
        speeds.append(plant.velocities()[0])
    assert min(speeds) == 0.0
    assert speeds[-1] == 0.0


def test_gears_are_converted_to_joint_units() -> None:
    behind = GEARS.behind(-20.0)
    assert behind.rotor_kg_m2 == pytest.approx(4.0)
    assert behind.viscous_nm_s == pytest.approx(8.0)
    # A force of 3 N on the joint is 0.15 N m on the shaft, and 0.01 m/s are 0.2 rad/s.
    assert behind.friction_nm(3.0, 0.01) == pytest.approx(20.0 * GEARS.friction_nm(0.15, 0.2))


@pytest.mark.parametrize("model", [MX_64, MX_106], ids=lambda model: model.name)
def test_identified_gears_are_used_on_the_bench(model: AxMxModel) -> None:
    plant = BenchPlant([1, 2], inertia_kg_m2=99.0)
    VirtualBus.of(plant, {1: model, 2: model})
    gears = IDENTIFIED[model.name].gears
    assert gears is not None
    plant.push([1.0, 0.0])
    plant.advance()
    free = 1.0 - gears.friction_nm(1.0, 0.0)
    assert plant.velocities()[0] == pytest.approx(free * 0.001 / gears.rotor_kg_m2)
    assert servo_of(model, 1).gears == gears


def test_servos_without_identified_gears_keep_those_of_the_bench() -> None:
    plant = BenchPlant([1], inertia_kg_m2=0.5, friction_nm=0.0)
    VirtualDynamixelBus.of(plant, {1: x.XL430_W250})
    plant.push([1.0])
    plant.advance()
    assert plant.velocities()[0] == pytest.approx(0.002)


COUPLINGS = [Coupling(i, joint, transmission=0.03 if joint == JOINTS[6] else 1.0) for i, joint in enumerate(JOINTS, 1)]


def held_arm(load_share: float) -> tuple[World, WorldPlant]:
    """Return the arm in the ready pose, with gears only on joint 3."""
    world = World(initial_position=READY)
    plant = WorldPlant(world, COUPLINGS)
    gears = Gears(0.01, 0.05, 0.02, load_share)
    plant.fit([gears if coupling.joint == "joint3" else None for coupling in COUPLINGS])
    return world, plant


def gravity(world: World) -> list[float]:
    """Return the shaft torques that hold the arm (N m)."""
    return [float(world.data.qfrc_bias[world.model.joint(c.joint).dofadr[0]]) * c.transmission for c in COUPLINGS]


def drift(load_share: float, given: float) -> float:
    """Return the motion of joint 3 within 0.3 s (rad) at this share of its holding torque. The other joints hold."""
    world, plant = held_arm(load_share)
    for _ in range(300):
        torques = gravity(world)
        torques[2] *= given
        plant.push(torques)
        plant.advance()
    return float(abs(world.position()[2] - READY[2]))


def test_load_dependent_friction_holds_a_joint_in_the_world() -> None:
    assert drift(0.0, 0.8) > 10.0 * drift(0.3, 0.8)
    # At half of the torque, the friction (0.3 times the sum of motor and load) is less than the missing torque.
    assert drift(0.3, 0.3) > 0.05


def test_other_joints_keep_the_friction_and_inertia_of_the_scene() -> None:
    world, _ = held_arm(0.3)
    fresh, dof = World().model, world.model.joint("joint3").dofadr[0]
    others = [i for i in range(world.model.nv) if i != dof]
    for field in ("dof_frictionloss", "dof_damping", "dof_armature"):
        assert (getattr(world.model, field)[others] == getattr(fresh, field)[others]).all()
    assert world.model.dof_armature[dof] == 0.01


def test_gears_of_an_arm_on_two_lines() -> None:
    world = World()
    common = CommonPlant(WorldPlant(world, COUPLINGS))
    for joints in (JOINTS[:6], JOINTS[6:]):
        models = {c.servo_id: x.XL330_M288 for c in COUPLINGS if c.joint in joints}
        common.join(VirtualDynamixelBus.of(common.part(joints), models))
    gears = IDENTIFIED[x.XL330_M288.name].gears
    assert gears is not None
    inertias = [world.model.dof_armature[world.model.joint(name).dofadr[0]] for name in JOINTS]
    assert inertias[:6] == pytest.approx([gears.rotor_kg_m2] * 6)
    assert inertias[6] == pytest.approx(gears.rotor_kg_m2 / 0.03**2)


def test_two_runs_are_identical() -> None:
    def run() -> bytes:
        world = World()
        line = VirtualDynamixelBus.of(WorldPlant(world, COUPLINGS), dict.fromkeys(range(1, 8), x.XL330_M288))
        line.advance(0.0)
        line.advance(0.3)
        return world.position().tobytes() + world.velocity().tobytes()

    assert run() == run()
