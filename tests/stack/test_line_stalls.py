"""The line stalls for up to 0.2 s, at random moments of motions: no goal ends by it."""

import random

import pytest

from controller.action_goals import GoalStatus
from servoloop.simulation.recording import RecordingPort
from servoloop.simulation.stack import SimulatedStack
from tests.stack.rig import BINS, PICK, READY


@pytest.mark.parametrize("seed", range(5))
def test_a_stall_of_the_line_ends_no_goal(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rig, chance = SimulatedStack().up(), random.Random(seed)
    rig.run(0.5)
    silent_until_s, read, stalls = 0.0, RecordingPort.read, 0

    def stalling_read(port: RecordingPort, size: int, deadline_s: float) -> bytes:
        if port.clock.now() < silent_until_s:
            port.clock.sleep_until(min(deadline_s, silent_until_s))
        return b"" if port.clock.now() < silent_until_s else read(port, size, deadline_s)

    def begin_stalls() -> None:
        nonlocal silent_until_s, stalls
        if chance.random() < 0.05:
            silent_until_s, stalls = rig.clock.now() + chance.uniform(0.05, 0.2), stalls + 1

    monkeypatch.setattr(RecordingPort, "read", stalling_read)
    rig.after_cycle = begin_stalls
    for pose in (READY, PICK, BINS["A"], READY):
        handle = rig.go(pose)
        rig.run(10.0, lambda handle=handle: handle.done)  # type: ignore[misc]
        assert handle.status is GoalStatus.SUCCEEDED, handle.error_text
    assert stalls >= 2 and rig.loop.figures.unmeasured > 0
