"""The simulated stack with a fault player: without faults, nothing changes; clients can also have faults."""

import pytest

from controller.action_goals import GoalStatus
from hal.types import JointState
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.job import run_job
from servoloop.simulation.simulate import Digest
from servoloop.simulation.stack import SimulatedStack
from servoloop.simulation.stack_faults import NONSENSE, inventory_of
from servoloop.stack.arm_folders import find_arm
from servoloop.stack.pick_place import load_pick_place
from sim_backend.faults.draw import draw
from sim_backend.faults.fault_error import FaultError
from sim_backend.faults.text import parse
from tests.faults.rig import FaultRig, files_of, told
from tests.stack.rig import PICK, READY


@pytest.mark.parametrize("arm", ["robot_arm", "robot_arm_dynamixel"])
def test_without_faults_the_bytes_are_the_same(arm: str) -> None:
    digests: list[str] = []
    for kind in (SimulatedStack, FaultyStack):
        stack, digest = kind(files=files_of(arm)), Digest()

        def on_state(state: JointState, digest: Digest = digest) -> None:
            digest.add_state(state)

        stack.on_state = on_state
        stack.up()
        stack.go(PICK)
        stack.run(1.0)
        digests.append(digest.of(stack.ports.values()))
    assert digests[0] == digests[1]


def test_a_job_survives_noise_and_echo() -> None:
    stack = FaultyStack(files=files_of("robot_arm"))
    stack.up()
    stack.player.play([parse("noise chance=0.2"), parse("echo at=2s for=3s"), parse("lost_replies chance=0.02")])
    stack.run(2.5)
    record = run_job(stack, load_pick_place(find_arm("robot_arm").pick_place).settings(), "A")
    assert record.success, record.message


def test_a_canceled_goal_is_reported_and_the_arm_stops() -> None:
    stack = FaultyStack(files=files_of("robot_arm"))
    stack.up()
    handle = stack.go(PICK)
    stack.player.play([parse("client_cancels at=500ms")], stack.world.time_s)
    stack.run(2.0)
    assert handle.status is GoalStatus.CANCELED
    assert abs(stack.world.velocity()[:6]).max() < 0.05


def test_a_dead_client_sends_no_more_goals() -> None:
    stack = FaultyStack(files=files_of("robot_arm"))
    stack.up()
    handles = [stack.go(READY, 0.5)]

    def react() -> None:
        if handles[-1].done:
            handles.append(stack.go(READY, 0.5))

    stack.after_cycle = react
    stack.player.play([parse("client_dies at=2.2s")], stack.world.time_s)
    stack.run(4.5)
    assert handles[-1].status is GoalStatus.SUCCEEDED
    assert 2 <= len(handles) <= 4


def test_all_invalid_goals_are_refused_with_a_reason() -> None:
    stack = FaultyStack(files=files_of("robot_arm"))
    stack.up()
    stack.run(0.2)
    events = [parse(f"client_nonsense seed={seed} at={seed}ms") for seed in range(60)]
    stack.player.play(events, stack.world.time_s)
    stack.run(0.3)
    answers = stack.stack_faults.answers
    assert len(answers) == 60 and all(answers)
    assert len({str(answer).split()[0] for answer in answers}) >= len(NONSENSE) - 2


@pytest.mark.parametrize(
    ("kind", "controllers"),
    [
        ("controller_raises", {"arm_controller", "hand_controller", "joint_state_broadcaster"}),
        ("controller_nan", {"arm_controller", "hand_controller"}),
        ("controller_jumps", {"arm_controller", "hand_controller"}),
    ],
)
def test_controller_faults_are_drawn_for_every_possible_controller(kind: str, controllers: set[str]) -> None:
    there = inventory_of(files_of("robot_arm"))
    assert there.controllers == FaultRig().player.targets.inventory.controllers
    assert {getattr(event, "controller", "") for event in draw(1, there, 10.0, 30, [kind])} == controllers


def test_a_controller_that_commands_no_joints_cannot_command_nan() -> None:
    with pytest.raises(
        FaultError, match="joint_state_broadcaster commands no joints: specify one of arm_controller, hand"
    ):
        FaultRig().play(parse("controller_nan controller=joint_state_broadcaster"))


def test_an_exception_in_a_broadcaster_ends_no_goal() -> None:
    rig = told("robot_arm", parse("controller_raises controller=joint_state_broadcaster at=300ms"))
    assert rig.says("joint_state_broadcaster failed") and rig.says("goal: SUCCEEDED")


def test_nan_from_the_hand_controller_stops_the_hand_but_not_the_arm() -> None:
    rig = told("robot_arm", parse("controller_nan controller=hand_controller at=300ms"))
    assert rig.says("safety gate: hand_right_joint: the command is nan: holding") and rig.says("goal: SUCCEEDED")


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
def test_commands_that_are_not_finite_hold_the_joints(value: str) -> None:
    rig = told("robot_arm", parse(f"controller_nan value={value} at=300ms"))
    assert rig.says(f"safety gate: joint1, joint2, joint3, joint4, joint5, joint6: the command is {value}: holding")


def test_a_servo_that_a_goal_enables_after_a_short_brown_out_is_recognized_as_reset() -> None:
    """The servo responds again before the next cycle, but it has lost its torque limit."""
    rig = told("robot_arm", parse("brown_out id=3 boot=2ms at=300ms"))
    assert rig.says("servo 3 has lost its torque")
    assert not rig.says("servo 3 does not respond")
