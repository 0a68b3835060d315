"""The process stalls for up to 0.2 s at random times during motions. No goal is aborted, and no joint jumps."""

import random
from functools import cache

import numpy as np
import pytest

from controller.action_goals import GoalStatus
from hal.types import FloatArray, JointState
from servoloop.simulation.stack import SimulatedStack
from tests.stack.rig import BINS, PICK, READY

SEEDS = range(5)
LONGEST_STEP = 2.0
"""Largest motion in a late cycle, as a multiple of the largest motion in an ordinary cycle."""
SHARE = 0.15
"""Share of cycles in which the process stalls."""


class Job:
    """Job that moves the arm between poses while the process stalls between cycles or during an update."""

    def __init__(self, share: float = 0.0, seed: int = 0) -> None:
        self.rig = SimulatedStack().up()
        self.rig.run(0.5)
        self.stalls = 0
        self.commands: list[FloatArray] = []
        self._share, self._chance = share, random.Random(seed)
        update, write = self.rig.arm.update, self.rig.loop.hardware.write

        def stalling_update(state: JointState, now_s: float, period_s: float) -> None:
            self._stall()
            update(state, now_s, period_s)
            self._stall()

        def recording_write(values: FloatArray, period_s: float) -> None:
            self.commands.append(values.copy())
            write(values, period_s)

        self.rig.arm.update = stalling_update  # type: ignore[method-assign]
        self.rig.loop.hardware.write = recording_write  # type: ignore[method-assign]
        self.rig.after_cycle = self._stall

    def _stall(self) -> None:
        if self._chance.random() < self._share / 3:
            self.stalls += 1
            self.rig.clock.sleep_until(self.rig.clock.now() + self._chance.uniform(0.05, 0.2))

    def run(self) -> "Job":
        for pose in (READY, PICK, BINS["A"], READY):
            handle = self.rig.go(pose)
            self.rig.run(10.0, lambda handle=handle: handle.done)  # type: ignore[misc]
            assert handle.status is GoalStatus.SUCCEEDED, handle.error_text
        return self

    @property
    def largest_steps(self) -> FloatArray:
        """Largest change of each command from cycle to cycle."""
        steps: FloatArray = np.abs(np.diff(np.array(self.commands), axis=0)).max(axis=0)
        return steps

    @property
    def fastest(self) -> FloatArray:
        """Highest velocity of each joint of the arm in the world."""
        trace = self.rig.trace
        speeds: FloatArray = np.abs(np.diff(np.array(trace.actual), axis=0)) / np.diff(trace.world_s)[:, None]
        return speeds.max(axis=0)


@cache
def undisturbed() -> Job:
    return Job().run()


@pytest.mark.parametrize("seed", SEEDS)
def test_process_stall_aborts_no_goal_and_causes_no_jump(seed: int) -> None:
    job = Job(SHARE, seed).run()
    assert job.stalls > 10 and job.rig.loop.figures.missed >= job.stalls
    limit = np.array([limit.velocity for limit in job.rig.loop.limits])
    assert (job.largest_steps <= limit * job.rig.loop.period_s + 1e-9).all()
    assert (job.largest_steps <= LONGEST_STEP * undisturbed().largest_steps + 1e-9).all()
    assert (job.fastest <= np.maximum(1.05 * limit[:6], LONGEST_STEP * undisturbed().fastest)).all()
    assert job.rig.loop.figures.unmeasured == 0
