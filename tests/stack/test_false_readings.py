"""A false position with a valid checksum never moves a joint, whatever event turns a measured position into a goal."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.action_goals import GoalStatus
from controller.manager.switch import SwitchRequest
from controller.shutdown import shut_down
from hal.lifecycle import LifecycleState
from servoloop.simulation.faulty_stack import FaultyStack
from sim_backend.faults.false_replies import FalsePosition
from sim_backend.faults.text import parse
from tests.faults.rig import files_of
from tests.stack.rig import READY

REACH_RAD = 0.4
MOVE_S = 0.8


class TrackedStack(FaultyStack):
    """Stack that records the true joint positions once ``watch`` has been called."""

    def __init__(self) -> None:
        super().__init__(files=files_of("robot_arm"), keep_alive=True, start=(*READY, 0.02))
        self.lowest = self.highest = np.empty(0)
        self.on_step = self._see

    def watch(self) -> None:
        self.lowest = self.highest = self.world.position()

    def _see(self, time_s: float) -> None:
        if self.lowest.size:
            here = self.world.position()
            self.lowest, self.highest = np.minimum(self.lowest, here), np.maximum(self.highest, here)

    @property
    def goal(self) -> list[float]:
        """Start pose in which the third joint has moved."""
        return [value + (REACH_RAD if index == 2 else 0.0) for index, value in enumerate(READY)]

    def transition(self, target: LifecycleState) -> None:
        asked = self.loop.component_transitions.ask(self.hardware.name, target)
        self.run(3.0, lambda: asked.done)
        asked.result()


def activation(stack: TrackedStack) -> None:
    stack.watch()
    stack.up()
    stack.run(0.6)


def second_activation(stack: TrackedStack) -> None:
    stack.up()
    stack.transition(LifecycleState.INACTIVE)
    stack.watch()
    stack.transition(LifecycleState.ACTIVE)
    stack.run(0.4)


def motion(stack: TrackedStack) -> None:
    stack.up()
    stack.watch()
    handle = stack.go(stack.goal, MOVE_S)
    stack.run(3.0, lambda: handle.done)
    stack.run(0.3)
    assert handle.status is GoalStatus.SUCCEEDED, handle.error_text


def cancel(stack: TrackedStack) -> None:
    stack.up()
    stack.watch()
    handle = stack.go(stack.goal, MOVE_S)
    stack.run(0.4)
    stack.arm.cancel(handle)
    stack.run(1.0, lambda: handle.done)
    stack.run(0.3)


def dead_stop(stack: TrackedStack) -> None:
    """With ``decelerate_on_cancel: false``, the controller holds the measured position, as in ros2_control."""
    constraints = stack.arm.parameters.constraints.model_copy(update={"decelerate_on_cancel": False})
    stack.arm.reconfigure(stack.arm.parameters.model_copy(update={"constraints": constraints}))
    cancel(stack)


def controller_switch(stack: TrackedStack) -> None:
    stack.up()
    stack.watch()
    stack.go(stack.goal, MOVE_S)
    stack.run(0.4)
    for active in (False, True):
        switch(stack, active)
        stack.run(0.3)


def switch(stack: TrackedStack, active: bool) -> None:
    name = (stack.arm.name,)
    request = SwitchRequest(activate=name) if active else SwitchRequest(deactivate=name)
    stack.manager.switch(request, stack.loop.within_limits)


def silence(stack: TrackedStack) -> None:
    stack.up()
    stack.watch()
    stack.player.play([parse("silent id=3 at=0.2s for=0.25s")], stack.world.time_s)
    stack.go(stack.goal, MOVE_S)
    stack.run(1.5)


def shutdown(stack: TrackedStack) -> None:
    stack.up()
    stack.watch()
    stack.go(stack.goal, MOVE_S)
    stack.run(0.4)
    assert shut_down(stack.loop, False, None, 1.0) == []


WAYS: dict[Callable[[TrackedStack], None], float] = {
    activation: 0.4,
    second_activation: 1.2,
    motion: 1.6,
    cancel: 1.0,
    dead_stop: 1.0,
    controller_switch: 1.2,
    silence: 1.2,
    shutdown: 1.0,
}
"""Events in which a measured position becomes a goal, with their durations in seconds."""


def deceived(way: Callable[[TrackedStack], None], joint: int, counts: int, share: float) -> None:
    """One reading is wrong by ``counts`` after a ``share`` of the event's time, and no joint leaves its path."""
    stack = TrackedStack()
    at_s = stack.world.time_s + share * WAYS[way]
    stack.player.play([FalsePosition(servo_id=joint, counts=counts, replies=1, at_s=at_s)])
    way(stack)
    moves = np.where(np.arange(6) == 2, REACH_RAD, 0.0) if way not in (activation, second_activation) else np.zeros(6)
    step = np.array([limit.velocity for limit in stack.loop.limits[:6]]) * stack.loop.period_s
    start = np.array(READY)
    assert (stack.highest[:6] <= start + moves + step).all(), stack.highest[:6] - start
    assert (stack.lowest[:6] >= start - step).all(), stack.lowest[:6] - start


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.__name__)
@pytest.mark.parametrize(("counts", "share"), [(-1000, 0.05), (300, 0.5)])
def test_one_false_reading_moves_no_joint(way: Callable[[TrackedStack], None], counts: int, share: float) -> None:
    deceived(way, 3, counts, share)


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.__name__)
@settings(max_examples=30)
@given(
    joint=st.integers(1, 6),
    counts=st.integers(100, 4096).flatmap(lambda size: st.sampled_from((size, -size))),
    share=st.floats(0.0, 1.0),
)
def test_false_reading_at_any_time_moves_no_joint(
    way: Callable[[TrackedStack], None], joint: int, counts: int, share: float
) -> None:
    deceived(way, joint, counts, share)
