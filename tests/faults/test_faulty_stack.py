"""The simulated stack with a player: without faults the same as without one, and what clients do to it."""

import pytest

from controller.action_goals import GoalStatus
from hal.types import JointState
from servoloop.arms.folder import find_arm
from servoloop.arms.pick_place import load_pick_place
from servoloop.simulation.digest import Digest
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.job import run_job
from servoloop.simulation.stack import SimulatedStack
from servoloop.simulation.stack_faults import NONSENSE
from sim_backend.faults.text import parse
from tests.faults.rig import files_of
from tests.stack.rig import PICK, READY


@pytest.mark.parametrize("arm", ["robot_arm", "robot_arm_dynamixel"])
def test_without_faults_it_does_the_same_to_the_byte(arm: str) -> None:
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


def test_a_cancelled_goal_is_answered_and_the_arm_stands() -> None:
    stack = FaultyStack(files=files_of("robot_arm"))
    stack.up()
    handle = stack.go(PICK)
    stack.player.play([parse("client_cancels at=500ms")], stack.world.time_s)
    stack.run(2.0)
    assert handle.status is GoalStatus.CANCELED
    assert abs(stack.world.velocity()[:6]).max() < 0.05


def test_a_client_that_is_dead_sends_nothing_more() -> None:
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


def test_all_nonsense_is_refused_with_its_reason() -> None:
    stack = FaultyStack(files=files_of("robot_arm"))
    stack.up()
    stack.run(0.2)
    events = [parse(f"client_nonsense seed={seed} at={seed}ms") for seed in range(60)]
    stack.player.play(events, stack.world.time_s)
    stack.run(0.3)
    answers = stack.stack_faults.answers
    assert len(answers) == 60 and all(answers)
    assert len({str(answer).split()[0] for answer in answers}) >= len(NONSENSE) - 2
