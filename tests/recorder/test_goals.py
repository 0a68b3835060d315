"""Goals in a recording: trajectory and gripper goals, each with its result."""

import numpy as np

from controller.action_goals import GoalStatus
from controller.gripper.goal import GripperGoal, GripperParameters
from controller.gripper.gripper_action_controller import GripperActionController
from servoloop.recording.message_types import JOINT_STATE
from servoloop.recording.sampler import CycleSample, GoalBegin, GoalEnd
from tests.recorder.rig import Rig
from tests.stack.rig import PICK, READY

HAND = "hand_right_joint"


def events(samples: list[CycleSample]) -> list[GoalBegin | GoalEnd]:
    return [event for sample in samples for event in sample.goals]


def test_replaced_goal_ends_before_its_successor_begins() -> None:
    rig = Rig()
    rig.stack.go(PICK)
    rig.run(0.2)
    rig.stack.go(READY)
    begin, end, second, last = events(rig.run(3.0) and rig.samples)
    assert isinstance(begin, GoalBegin) and begin.controller == "arm_controller" and begin.joints[0] == "joint1"
    assert isinstance(end, GoalEnd) and end.status is GoalStatus.ABORTED and "preempted" in end.text
    assert not end.missed, "the joints have left no tolerance"
    assert isinstance(second, GoalBegin) and isinstance(last, GoalEnd) and last.status is GoalStatus.SUCCEEDED


def test_gripper_goal_is_recorded_as_joint_state_with_velocity_and_effort_limits() -> None:
    rig = Rig()
    stack = rig.stack
    limits, index = stack.files.limits[HAND], stack.loop.hardware.joints.index(HAND)
    gripper = GripperActionController("gripper", GripperParameters(joint=HAND), limits, index)
    stack.manager.registry.add(gripper)
    (before, *_) = rig.run(0.05)
    gripper.activate(before.state, np.array([0.0]))
    gripper.submit(GripperGoal(0.03, max_velocity=0.05, max_effort=2.0))
    gripper.update(before.state, before.state.stamp_s, 0.05)
    (sample, *_) = rig.run(0.05)
    (begin,) = sample.goals
    assert begin == GoalBegin("gripper", (HAND,), GripperGoal(0.03, 0.05, 2.0))
    (message,) = (one for one in rig.messages.of_cycle(sample) if one.topic == "/gripper/goal")
    assert message.kind == JOINT_STATE
    command = message.message
    assert (command.name, *command.position, *command.velocity, *command.effort) == ([HAND], 0.03, 0.05, 2.0)  # type: ignore[attr-defined]
    gripper.deactivate()
    (end,) = events(rig.run(0.2))
    assert isinstance(end, GoalEnd) and (end.controller, end.status) == ("gripper", GoalStatus.ABORTED)
