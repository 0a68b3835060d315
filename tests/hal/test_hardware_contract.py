"""Tests of the ``Hardware`` contract with virtual servos, the arm in MuJoCo and the mock."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.servos import ax_mx as dynamixel1
from drivers.servos import scs, sts
from drivers.servos import x as x_series
from drivers.servos.register import ServoModel
from hal.hal_errors import LifecycleError
from hal.hardware import Hardware
from hal.joint import Joint
from hal.lifecycle import LifecycleState
from hal.mock_hardware import MockHardware
from hal.robot_description.description import parse_urdf
from hal.robot_file.robot import assemble
from hal.robot_file.robot_file import load_robot_file
from hal.servos.servo_hardware import ServoHardware
from hal.types import FloatArray, JointCommand, JointState
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.line.line import ServoLine
from sim_backend.mechanics.plant import Coupling, WorldPlant
from sim_backend.scene.mujoco_hardware import MujocoHardware
from sim_backend.scene.world import World

ROOT = Path(__file__).resolve().parents[2]
PERIOD_S = 0.05
UNCONFIGURED, INACTIVE, ACTIVE = LifecycleState.UNCONFIGURED, LifecycleState.INACTIVE, LifecycleState.ACTIVE


def robot_joints() -> tuple[Joint, ...]:
    description = parse_urdf((ROOT / "urdf" / "robot_arm.urdf").read_text())
    file = load_robot_file(ROOT / "config" / "robot_arm.yaml")
    joints = assemble(file, description, description.components[0]).joints
    return tuple(replace(joint, settings=()) for joint in joints)  # the settings are registers of an STS


JOINTS = robot_joints()
MODELS = (sts.STS3215, scs.SCS15, dynamixel1.AX_12A, dynamixel1.MX_28, x_series.XM430_W350)
"""One model of each series; for protocol 1.0, one model that is read by single reads and one that is read by group
reads."""


def driven(joint: Joint, model: ServoModel) -> Joint:
    """Return the joint with a different servo model. The zero of a servo without a full turn is the middle of its
    range."""
    if model == dynamixel1.MX_28:  # with the factory gain, the arm would sink onto the stand
        return replace(joint, model=model, settings=((dynamixel1.p_gain.name, 96),))
    if model.positions is None:
        return replace(joint, model=model)
    zero = model.positions // 2 + round((joint.zero_counts / 4096 - 0.5) * model.counts_per_turn)
    made = replace(joint, model=model, zero_counts=zero, torque_limit=1.0)  # an SCS does not support other values
    ends = sorted((made.position(0), made.position(model.positions - 1)))
    limits = replace(joint.limits, lower=max(joint.limits.lower, ends[0]), upper=min(joint.limits.upper, ends[1]))
    return replace(made, limits=limits)


def driven_by(model: ServoModel) -> Callable[[Clock], Hardware]:
    """Return an arm with this servo model in every joint, as its bus and its virtual line."""
    joints = [driven(joint, model) for joint in JOINTS]
    models = {joint.servo_id: model for joint in joints}

    def make(clock: Clock) -> Hardware:
        couplings = [
            Coupling(j.servo_id, j.name, j.sign, j.zero_counts, j.transmission, model.counts_per_turn) for j in joints
        ]
        world = World()
        world.hold_until_driven()  # activation takes time, during which a limp arm would sink
        plant = WorldPlant(world, couplings)
        line: ServoLine[Any]
        if model in x_series.MODELS.values():
            line = VirtualDynamixelBus.of(plant, models)
        else:
            line = VirtualBus.of(plant, models)
        return ServoHardware("arm", joints, lambda: Bus(VirtualPort(line, clock), clock, models), clock)

    return make


def mujoco(clock: Clock) -> Hardware:
    return MujocoHardware("arm", JOINTS, World(), clock)


def mock(clock: Clock) -> Hardware:
    return MockHardware("arm", [joint.name for joint in JOINTS], clock)


@dataclass
class Arm:
    hardware: Hardware
    clock: SimulatedClock

    def up(self) -> FloatArray:
        """Configure and activate the arm. Return the positions of the arm, clipped to the limits."""
        self.hardware.configure()
        self.hardware.activate()
        lower = np.array([joint.limits.lower for joint in JOINTS])
        upper = np.array([joint.limits.upper for joint in JOINTS])
        return np.clip(self.hardware.read().position, lower, upper)

    def pause(self) -> JointState:
        self.clock.sleep_until(self.clock.now() + PERIOD_S)
        return self.hardware.read()

    def follow(self, begin: FloatArray, end: FloatArray, cycles: int) -> JointState:
        """Move along a straight line in a number of cycles, and then wait half a second for the arm to settle."""
        for share in [*np.linspace(0.0, 1.0, cycles), *[1.0] * 10]:
            self.hardware.write(JointCommand(begin + (end - begin) * share, PERIOD_S))
            state = self.pause()
        return state


BACKENDS: dict[str, Callable[[Clock], Hardware]] = {
    **{model.name: driven_by(model) for model in MODELS},
    "mujoco": mujoco,
    "mock": mock,
}


@pytest.fixture(params=BACKENDS)
def arm(request: pytest.FixtureRequest) -> Iterator[Arm]:
    clock = SimulatedClock(500.0)
    made = Arm(BACKENDS[request.param](clock), clock)
    yield made
    made.hardware.cleanup()


def test_new_hardware_is_unconfigured_with_name_and_joints(arm: Arm) -> None:
    assert arm.hardware.state is UNCONFIGURED
    assert arm.hardware.name == "arm"
    assert arm.hardware.joints == tuple(joint.name for joint in JOINTS)


def test_the_life_cycle(arm: Arm) -> None:
    hardware = arm.hardware
    for _ in range(2):
        hardware.configure()
        assert hardware.state is INACTIVE
        hardware.activate()
        assert hardware.state is ACTIVE
        assert list(hardware.deactivate(relax=False)) == []
        assert hardware.state is INACTIVE
        hardware.activate()
        assert list(hardware.deactivate(relax=True)) == []
        assert hardware.state is INACTIVE
        hardware.cleanup()
        assert hardware.state is UNCONFIGURED


CALLS: dict[str, Callable[[Hardware], object]] = {
    "configure": lambda hardware: hardware.configure(),
    "activate": lambda hardware: hardware.activate(),
    "cleanup": lambda hardware: hardware.cleanup(),
    "deactivate": lambda hardware: hardware.deactivate(relax=True),
    "read": lambda hardware: hardware.read(),
    "write": lambda hardware: hardware.write(JointCommand(np.zeros(len(JOINTS)), PERIOD_S)),
}


@pytest.mark.parametrize(
    ("way", "call"),
    [
        ((), "activate"),
        ((), "deactivate"),
        ((), "write"),
        ((), "read"),
        (("configure", "activate", "cleanup"), "read"),
        (("configure",), "configure"),
        (("configure",), "deactivate"),
        (("configure",), "write"),
        (("configure", "activate"), "configure"),
        (("configure", "activate"), "activate"),
        (("configure", "activate", "deactivate"), "deactivate"),
        (("configure", "activate", "deactivate"), "write"),
    ],
)
def test_a_call_in_the_wrong_state_is_refused_and_changes_nothing(arm: Arm, way: tuple[str, ...], call: str) -> None:
    for step in way:
        CALLS[step](arm.hardware)
    state = arm.hardware.state
    with pytest.raises(LifecycleError, match=f"cannot {call} while {state.name.lower()}: the component must be"):
        CALLS[call](arm.hardware)
    assert arm.hardware.state is state


@pytest.mark.parametrize("way", [(), ("configure",), ("configure", "activate")])
def test_cleanup_is_allowed_in_every_state_and_twice(arm: Arm, way: tuple[str, ...]) -> None:
    for step in way:
        CALLS[step](arm.hardware)
    arm.hardware.cleanup()
    arm.hardware.cleanup()
    assert arm.hardware.state is UNCONFIGURED
    arm.up()


@pytest.mark.parametrize("way", [("configure",), ("configure", "activate")])
def test_a_measurement_is_complete_and_has_its_time(arm: Arm, way: tuple[str, ...]) -> None:
    for step in way:
        CALLS[step](arm.hardware)
    state = arm.pause()
    assert state.stamp_s == arm.clock.now()
    assert state.position.shape == state.velocity.shape == state.effort.shape == (len(JOINTS),)
    assert np.isfinite(state.position).all() and np.isfinite(state.velocity).all()
    assert state.faults == {}


def test_activation_moves_nothing(arm: Arm) -> None:
    arm.hardware.configure()
    before = arm.hardware.read().position
    arm.hardware.activate()
    for _ in range(5):
        state = arm.pause()
        # A limp arm sinks while its servos are read, and then the compliant servos hold it below its goal.
        np.testing.assert_allclose(state.position, before, atol=0.07)


def test_only_the_commanded_joint_moves(arm: Arm) -> None:
    begin = arm.up()
    end = begin + np.array([-0.3, 0.0, 0.0, 0.1, 0.0, 0.3, 0.0])
    state = arm.follow(begin, end, cycles=20)
    np.testing.assert_allclose(state.position, end, atol=0.05)
    # A coarse sensor alternates between two counts and reports a speed each time.
    standing = [arm.pause() for _ in range(40)]
    assert np.ptp([state.position for state in standing], axis=0).max() < 0.01
    np.testing.assert_allclose(np.mean([state.velocity for state in standing], axis=0), 0.0, atol=0.1)


def test_a_prismatic_joint_moves_in_meters(arm: Arm) -> None:
    begin = arm.up()
    end = begin.copy()
    end[-1] = 0.02
    state = arm.follow(begin, end, cycles=10)
    assert state.position[-1] == pytest.approx(0.02, abs=0.002)


def test_later_changes_of_a_command_have_no_effect(arm: Arm) -> None:
    """The caller may change its array after the call."""
    begin = arm.up()
    command = begin.copy()
    arm.hardware.write(JointCommand(command, PERIOD_S))
    command += 0.5
    np.testing.assert_allclose(arm.pause().position, begin, atol=0.05)


def test_without_commands_the_joints_stay(arm: Arm) -> None:
    begin = arm.up()
    arm.hardware.write(JointCommand(begin, PERIOD_S))
    for _ in range(20):
        state = arm.pause()
    np.testing.assert_allclose(state.position, begin, atol=0.06)  # a compliant servo sags under 0.8 N m


def test_after_deactivation_without_relax_the_joints_hold(arm: Arm) -> None:
    begin = arm.up()
    lifted = begin + np.array([0.0, 0.2, 0.2, 0.0, 0.0, 0.0, 0.0])
    before = arm.follow(begin, lifted, cycles=15).position
    arm.hardware.deactivate(relax=False)
    for _ in range(20):
        state = arm.pause()
    np.testing.assert_allclose(state.position, before, atol=0.06)


def test_the_hardware_can_be_activated_again(arm: Arm) -> None:
    begin = arm.up()
    arm.hardware.deactivate(relax=True)
    for _ in range(4):
        arm.pause()
    arm.hardware.activate()
    before = arm.hardware.read().position
    np.testing.assert_allclose(arm.pause().position, before, atol=0.1)
    assert before.shape == begin.shape
