"""Differences between two arms that are built from the same parts, and the size of these differences."""

import mujoco
import numpy as np
import pytest

from drivers.servos import sts
from sim_backend.buses.feetech import VirtualBus
from sim_backend.line.rig import Supply
from sim_backend.line.spread import NOMINAL, SHARE, Quantity, Spread
from sim_backend.mechanics.motor import STS3215_12V
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.scene.world import SCENE, World


def test_the_nominal_arm_has_no_spread() -> None:
    assert NOMINAL.motor(STS3215_12V, 1) == STS3215_12V
    assert NOMINAL.supply(Supply(12.0)) == Supply(12.0)
    world, plain = World(spread=NOMINAL), mujoco.MjModel.from_xml_path(str(SCENE))
    assert (world.model.body_mass == plain.body_mass).all()


def test_a_seed_determines_an_arm_whose_parts_all_deviate() -> None:
    motors = [Spread(7).motor(STS3215_12V, servo_id) for servo_id in range(1, 8)]
    assert motors == [Spread(7).motor(STS3215_12V, servo_id) for servo_id in range(1, 8)]
    assert len({motor.torque_constant_nm_a for motor in motors}) == len({motor.resistance_ohm for motor in motors}) == 7
    assert Spread(8).motor(STS3215_12V, 1) != motors[0]
    assert Spread(7).supply(Supply(12.0)) != Spread(8).supply(Supply(12.0))


def test_factors_deviate_by_up_to_a_tenth() -> None:
    factors = [Spread(seed).factor(Quantity.MASS, body) for seed in range(50) for body in range(10)]
    assert 1.0 - SHARE <= min(factors) < 1.0 - 0.95 * SHARE
    assert 1.0 + 0.95 * SHARE < max(factors) <= 1.0 + SHARE
    assert np.mean(factors) == pytest.approx(1.0, abs=0.01)


def test_a_seeded_world_has_other_masses_and_friction() -> None:
    nominal, other, again = World().model, World(spread=Spread(3)).model, World(spread=Spread(3)).model
    heavy = nominal.body_mass > 0.0
    masses = other.body_mass[heavy] / nominal.body_mass[heavy]
    assert len(set(masses.round(6))) == heavy.sum() and np.abs(masses - 1.0).max() <= SHARE
    # A heavier body has the same shape, and MuJoCo's derived values follow its mass.
    assert other.body_inertia[heavy] == pytest.approx(nominal.body_inertia[heavy] * masses[:, None])
    assert other.body_subtreemass[0] == pytest.approx(other.body_mass.sum())
    rubs = nominal.dof_frictionloss > 0.0
    friction = other.dof_frictionloss[rubs] / nominal.dof_frictionloss[rubs]
    assert len(set(friction.round(6))) == rubs.sum() and np.abs(friction - 1.0).max() <= SHARE
    assert (other.body_mass == again.body_mass).all() and (other.dof_damping == again.dof_damping).all()


def test_servos_on_a_line_differ_in_speed_and_share_its_supply() -> None:
    line = VirtualBus.of(BenchPlant([1, 2]), sts.STS3215, spread=Spread(1))
    for servo in line.servos:
        servo.memory.put(sts.operating_mode, 2)
        servo.memory.put(sts.torque_enable, 1)
        servo.memory.put(sts.goal_time, 900)
    for _ in range(300):
        line.rig.step()
    one, other = line.rig.plant.velocities()
    assert one != pytest.approx(other, rel=0.005)
    unloaded_v = Spread(1).supply(Supply(12.0)).voltage_v
    assert line.servo(1).memory.get(sts.present_voltage) == pytest.approx(unloaded_v * 10.0, abs=1.5)
