"""Blocked joints: after the result of a goal, no servo presses against an obstacle or releases its torque, and the next
goal succeeds."""

from collections.abc import Callable

import numpy as np
import pytest

from controller.action_goals import GoalStatus
from controller.manager.switch import SwitchRequest
from controller.trajectory.goal import TrajectoryGoal
from controller.trajectory.goal_result import ErrorCode
from hal.lifecycle import LifecycleState
from hal.types import JointState
from servoloop.simulation.stack import SimulatedStack
from tests.controller.moveit_plans import trapezoid
from tests.stack.rig import PICK, READY
from tests.stack.test_full_scale import LIFTED_FAST, LIMITS, at, here

WEIGHT = 0.3
"""Share of the full drive needed to carry the arm."""


def loads(state: JointState) -> dict[str, float]:
    return {joint: abs(health.load) for joint, health in state.health.items()}


def states_of(stack: SimulatedStack, seconds: float) -> list[JointState]:
    seen: list[JointState] = []
    stack.on_state = seen.append
    stack.run(seconds)
    return seen


@pytest.mark.parametrize("canceled", [False, True], ids=["goal_time", "cancel"])
def test_arm_sent_into_the_stand_stops_pressing(canceled: bool) -> None:
    stack = SimulatedStack().up()
    stack.run(1.5)
    into = (PICK[0], PICK[1] - 0.5, *PICK[2:])
    handle = stack.go(into)
    stack.run(2.6 if canceled else 6.0, lambda: handle.done)
    if canceled:
        stack.arm.cancel(handle)
        stack.run(4.0, lambda: handle.done)
    else:
        assert handle.error_code == ErrorCode.GOAL_TOLERANCE_VIOLATED and "joint2 is off by" in handle.error_text
    assert handle.status is (GoalStatus.CANCELED if canceled else GoalStatus.ABORTED)
    for state in states_of(stack, 3.0):
        assert not state.faults and not any(health.alarms for health in state.health.values())
        assert max(loads(state).values()) < WEIGHT
    after = stack.go(READY)
    stack.run(6.0, lambda: after.done)
    assert after.status is GoalStatus.SUCCEEDED, after.error_text


def deactivate(stack: SimulatedStack) -> None:
    stack.manager.switch(SwitchRequest((), (stack.arm.name,)), stack.loop.command)


def set_inactive(stack: SimulatedStack) -> None:
    change = stack.loop.component_transitions.ask(stack.hardware.name, LifecycleState.INACTIVE)
    stack.run(6.0, lambda: change.done)
    assert change.result() is None


@pytest.mark.parametrize("end", [deactivate, set_inactive])
def test_pressing_arm_is_relieved_when_its_controller_is_deactivated(end: Callable[[SimulatedStack], None]) -> None:
    stack = SimulatedStack().up()
    stack.run(1.5)
    stack.go((PICK[0], PICK[1] - 0.5, *PICK[2:]))
    pressed: list[JointState] = states_of(stack, 2.6)
    assert max(loads(pressed[-1]).values()) > WEIGHT
    end(stack)
    stack.run(2.0)
    for state in states_of(stack, 3.0):
        assert not state.faults and not any(health.alarms for health in state.health.values())
        assert max(loads(state).values()) < WEIGHT


def test_jammed_joint_is_relieved_before_its_servo_releases() -> None:
    start, end = LIFTED_FAST
    stack = at(start)
    goal = TrajectoryGoal(stack.arm.joints, tuple(trapezoid(here(stack).tolist(), end, LIMITS)))
    assert stack.arm.check(goal) is None
    handle = stack.arm.submit(goal)
    stack.run(0.4)
    stack.world.jam("joint1")
    stack.run(0.1)
    jammed_at = here(stack)[0]
    stack.run(4.0, lambda: handle.done)
    assert handle.error_code == ErrorCode.PATH_TOLERANCE_VIOLATED and "joint1 is off by" in handle.error_text
    rests = here(stack)
    for state in states_of(stack, 3.0):
        assert not state.faults and not state.health["joint1"].alarms
        assert loads(state)["joint1"] < 0.1
    assert here(stack)[0] == pytest.approx(jammed_at, abs=0.01)
    assert np.abs(here(stack) - rests).max() < 0.01
    stack.world.free("joint1")
    after = stack.go(start)
    stack.run(6.0, lambda: after.done)
    assert after.status is GoalStatus.SUCCEEDED, after.error_text
