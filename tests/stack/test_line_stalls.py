"""The bus stalls for up to 0.2 s at random times during motions. No goal is aborted, and the arm stays close to its
path."""

import random
from typing import Any, Final

import numpy as np
import pytest

from controller.action_goals import GoalStatus
from servoloop.recording.bus_tap import BusTap
from servoloop.simulation.stack import SimulatedStack
from tests.stack.rig import BINS, PICK, READY

LONGEST_S: Final = 0.2
WAY_RAD: Final = 1.5
MOVE_S: Final = 1.8
LARGEST_ERROR_RAD: Final = 0.2
"""Largest measured following error, in rad. The path tolerance is 0.3 rad."""
LARGEST_STEP_BACK_RAD: Final = 0.01
"""Largest step backward, in rad. Without a stall, the largest step is 0.008 rad, at the end of the motion, because the
lead overshoots."""


@pytest.mark.parametrize("seed", range(5))
def test_bus_stall_does_not_abort_a_goal(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rig, chance = SimulatedStack().up(), random.Random(seed)
    rig.run(0.5)
    silent_until_s, read, stalls = 0.0, BusTap.read, 0

    def stalling_read(port: BusTap[Any], size: int, deadline_s: float) -> bytes:
        if port.clock.now() < silent_until_s:
            port.clock.sleep_until(min(deadline_s, silent_until_s))
        return b"" if port.clock.now() < silent_until_s else read(port, size, deadline_s)

    def begin_stalls() -> None:
        nonlocal silent_until_s, stalls
        if chance.random() < 0.05:
            silent_until_s, stalls = rig.clock.now() + chance.uniform(0.05, 0.2), stalls + 1

    monkeypatch.setattr(BusTap, "read", stalling_read)
    rig.after_cycle = begin_stalls
    for pose in (READY, PICK, BINS["A"], READY):
        handle = rig.go(pose)
        rig.run(10.0, lambda handle=handle: handle.done)  # type: ignore[misc]
        assert handle.status is GoalStatus.SUCCEEDED, handle.error_text
    assert stalls >= 2 and rig.loop.figures.unmeasured > 0


@pytest.mark.parametrize("both_ways", [True, False])
@pytest.mark.parametrize("at_s", [0.5, 0.7, 0.9, 1.1, 1.3])
def test_path_waits_for_the_arm_and_never_runs_backward(
    at_s: float, both_ways: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Replies are lost. With ``both_ways``, goals are also delivered late and all at once, as if the process had been
    stopped."""
    rig = SimulatedStack().up()
    rig.run(0.5)
    rig.go([*READY[:5], -WAY_RAD])
    rig.run(5.0)
    begin_s, end_s = rig.clock.now() + at_s, rig.clock.now() + at_s + LONGEST_S
    read, write = BusTap.read, BusTap.write
    held: list[bytes] = []

    def stalls() -> bool:
        return begin_s <= rig.clock.now() < end_s

    def stalling_read(port: BusTap[Any], size: int, deadline_s: float) -> bytes:
        if stalls():
            port.clock.sleep_until(min(deadline_s, end_s))
        return b"" if stalls() else read(port, size, deadline_s)

    def stalling_write(port: BusTap[Any], data: bytes) -> None:
        held.append(data)
        while held and not (both_ways and stalls()):
            write(port, held.pop(0))

    monkeypatch.setattr(BusTap, "read", stalling_read)
    monkeypatch.setattr(BusTap, "write", stalling_write)
    behind: list[float] = []
    commanded: list[float] = []

    def note_error() -> None:
        assert rig.arm.tracking is not None
        commanded.append(float(rig.loop.command[5]))
        if rig.arm.tracking.rate > 0.0:
            behind.append(float(np.abs(rig.arm.tracking.error).max()))

    rig.after_cycle = note_error
    handle = rig.go([*READY[:5], WAY_RAD], MOVE_S)
    rig.run(10.0, lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED, handle.error_text
    assert rig.loop.figures.unmeasured >= 3
    assert max(behind) < LARGEST_ERROR_RAD
    assert np.diff(commanded).min() > -LARGEST_STEP_BACK_RAD
