"""Parts of teleoperation: the dead-man key, the mapping of joints, and refused combinations."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.teleop.ramp_in import SHARE, RampIn
from drivers.clock import MonotonicClock
from drivers.driver_errors import DriverError
from drivers.servos import sts
from hal.hal_errors import ActivationError
from hal.lifecycle import LifecycleState
from hal.servos.leader_arm import LeaderArm
from servoloop.manual import dead_man
from servoloop.manual.dead_man import DeadMansKey, HandsFree
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.terminal import FIRST_S, REPEAT_S
from servoloop.teleop.arms import TeleopError, followed_joints
from sim_backend.packets.instructions import Instruction
from tests.hal.bench import IDS, JOINTS, Bench
from tests.teleop.rig import FOLLOWER, LEADER, Rig


@pytest.fixture
def key(monkeypatch: pytest.MonkeyPatch) -> DeadMansKey:
    """Return a dead-man key on a terminal without input."""
    monkeypatch.setattr(dead_man, "typed", lambda wait_s: [])
    return DeadMansKey()


def test_key_counts_as_held_until_its_repeats_stop(key: DeadMansKey) -> None:
    assert not key.allowed(0.0)
    key.press("space", 1.0)
    assert key.allowed(1.0 + FIRST_S) and not key.allowed(1.0 + FIRST_S + 0.01), "a tap is no more than that"
    for number in range(20):
        key.press("space", 3.0 + 0.03 * number)
    assert key.allowed(3.57 + REPEAT_S) and not key.allowed(3.58 + REPEAT_S)


def test_q_ends_the_teleoperation_and_releases_the_key(key: DeadMansKey) -> None:
    key.press("x", 1.0)
    key.press("q", 1.0)
    assert key.ended() and not key.allowed(1.0)
    assert HandsFree().allowed(0.0) and not HandsFree().ended()


def test_command_key_does_not_count_as_held(key: DeadMansKey) -> None:
    with_commands = DeadMansKey("a")
    with_commands.press("x", 1.0)
    with_commands.press("a", 1.1)
    assert not with_commands.allowed(1.1) and with_commands.commands() == ["a"] and not with_commands.commands()
    key.press("a", 1.0)
    assert key.allowed(1.0) and not key.commands()


def test_joints_follow_by_angle_and_hands_by_share_of_range() -> None:
    trigger = next(joint for joint in LEADER.robot.joints if joint.name == "gripper")
    pulled = replace(trigger, limits=replace(trigger.limits, lower=0.0, upper=0.5))
    robot = replace(LEADER.robot, joints=(*LEADER.robot.joints[:-1], pulled))
    joints = {
        one.joint: one for one in followed_joints(replace(LEADER, robot=robot), FOLLOWER, Rig().teleop.stack.setup)
    }
    assert (joints["elbow_flex"].gain, joints["elbow_flex"].offset) == (1.0, 0.0)
    jaw = joints["gripper"]
    assert jaw.offset == pytest.approx(jaw.limits.lower)
    assert jaw.offset + 0.5 * jaw.gain == pytest.approx(jaw.limits.upper)
    assert all(one.compliance is not None for one in joints.values())


def test_a_follower_with_other_joints_is_refused() -> None:
    with pytest.raises(TeleopError, match="so101_leader lacks joint1, joint2"):
        followed_joints(LEADER, read_arm_files(find_arm("robot_arm")), Rig().teleop.stack.setup)


def test_a_leader_is_never_driven() -> None:
    leader = LeaderArm(LEADER.robot.joints, lambda: {}, MonotonicClock())
    assert not leader.command_interfaces
    with pytest.raises(ActivationError, match="moved by hand"):
        leader.activate()


@pytest.mark.parametrize("servo_id", IDS)
def test_a_leader_that_is_reconnected_with_torque_is_closed_whenever_a_servo_falls_silent(servo_id: int) -> None:
    bench = Bench()
    leader = LeaderArm(JOINTS, bench.open_bus, bench.clock)
    leader.configure()
    leader.release()
    leader.cleanup()
    for other in IDS:
        bench.servos.servo(other).memory.put(sts.torque_enable, 1)
    begin, instructions = 0, 1
    while begin < instructions:

        def fall_silent(number: int, instruction: Instruction, begin: int = begin) -> None:
            if number == begin:
                bench.servos.faults.silence(servo_id)

        bench.watch_next_port = fall_silent
        with pytest.raises((DriverError, ActivationError)):
            leader.configure()
        assert leader.state is LifecycleState.UNCONFIGURED, begin
        bench.servos.faults.restore(servo_id)
        begin, instructions = begin + 1, len(bench.port.sent)


@given(st.lists(st.floats(-1.5, 1.5), min_size=2, max_size=6))
def test_joining_never_exceeds_its_share_of_the_velocity_limit(targets: list[float]) -> None:
    limits = [joint.limits for joint in FOLLOWER.robot.joints[:1]]
    ramp = RampIn(np.array([0.0]), limits, 0.02)
    for target in targets:
        for _ in range(7):
            before = ramp.command
            ramp.step(np.array([target]))
            assert abs(ramp.command - before)[0] <= SHARE * limits[0].velocity * 0.02 + 1e-9
