"""A false position with a right checksum moves no joint, whichever way a measured position becomes a goal."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hal.lifecycle import LifecycleState
from servoloop.simulation.faulty_stack import FaultyStack
from sim_backend.faults.servos import FalsePosition
from tests.faults.rig import files_of
from tests.stack.rig import READY

REACH_RAD = 0.4
MOVE_S = 0.8


class Watched(FaultyStack):
    """A stack whose joints' true positions are kept from the moment at which ``watch`` is called."""

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
        """The arm's start with the third joint further on."""
        return [value + (REACH_RAD if index == 2 else 0.0) for index, value in enumerate(READY)]

    def transition(self, target: LifecycleState) -> None:
        asked = self.loop.component_transitions.ask(self.hardware.name, target)
        self.run(3.0, lambda: asked.done)
        asked.result()


def activation(stack: Watched) -> None:
    stack.watch()
    stack.up()
    stack.run(0.6)


def second_activation(stack: Watched) -> None:
    stack.up()
    stack.transition(LifecycleState.INACTIVE)
    stack.watch()
    stack.transition(LifecycleState.ACTIVE)
    stack.run(0.4)


WAYS: dict[Callable[[Watched], None], float] = {
    activation: 0.4,
    second_activation: 1.2,
}
"""The ways in which a measured position becomes a goal, and for how long each lasts, in seconds."""


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.__name__)
@settings(max_examples=12)
@given(
    joint=st.integers(1, 6),
    counts=st.integers(100, 4096).flatmap(lambda size: st.sampled_from((size, -size))),
    share=st.floats(0.0, 1.0),
)
@example(joint=3, counts=-1000, share=0.05)
@example(joint=3, counts=300, share=0.5)
def test_one_false_reading_moves_no_joint(
    way: Callable[[Watched], None], joint: int, counts: int, share: float
) -> None:
    stack = Watched()
    at_s = stack.world.time_s + share * WAYS[way]
    stack.player.play([FalsePosition(servo_id=joint, counts=counts, replies=1, at_s=at_s)])
    way(stack)
    moves = np.where(np.arange(6) == 2, REACH_RAD, 0.0) if way not in (activation, second_activation) else np.zeros(6)
    step = np.array([limit.velocity for limit in stack.loop.limits[:6]]) * stack.loop.period_s
    start = np.array(READY)
    assert (stack.highest[:6] <= start + moves + step).all(), stack.highest[:6] - start
    assert (stack.lowest[:6] >= start - step).all(), stack.lowest[:6] - start
