"""The emulator has real-time priority while it serves, and none while it computes: before, and for its pictures.

Two that draw at that priority keep the processors of a small machine from every other arm's servos for seconds.
"""

import os
from pathlib import Path

import pytest

from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.emulator import EmulatorOptions, emulate
from servoloop.stack.processes import PRIORITY, realtime_priority
from sim_backend.buses.build import Build
from sim_backend.scene.picture import Recorder


class Scheduler:
    """The policy of this process, as the system would keep it."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, grants: bool = True) -> None:
        self.policy = os.SCHED_OTHER
        self.priorities = set[int]()
        """The real-time priorities that were granted."""
        self.grants = grants
        monkeypatch.setattr(os, "sched_setscheduler", self._set)
        monkeypatch.setattr(os, "sched_getscheduler", lambda pid: self.policy)

    def _set(self, pid: int, policy: int, param: os.sched_param) -> None:
        if policy == os.SCHED_RR and not self.grants:
            raise PermissionError(pid, "not permitted")
        self.policy = policy
        if policy == os.SCHED_RR:
            self.priorities.add(param.sched_priority)


def test_it_has_priority_while_it_serves_and_not_while_it_draws(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scheduler, seen = Scheduler(monkeypatch), dict[str, int]()
    monkeypatch.setattr(Recorder, "__init__", lambda self, world: seen.update(built=scheduler.policy))
    monkeypatch.setattr(Recorder, "save", lambda self, folder: seen.update(drawn=scheduler.policy))
    emulate(
        read_arm_files(find_arm()),
        tmp_path / "bus",
        EmulatorOptions(Build(0.0), tmp_path),
        stop=lambda: True,
        on_ready=lambda: seen.update(served=scheduler.policy),
    )
    assert seen == {"built": os.SCHED_OTHER, "served": os.SCHED_RR, "drawn": os.SCHED_OTHER}
    assert min(scheduler.priorities) > PRIORITY, "it answers late while another stack starts"


@pytest.mark.parametrize("grants", [True, False])
def test_it_is_given_back_after_an_exception_too(monkeypatch: pytest.MonkeyPatch, grants: bool) -> None:
    scheduler = Scheduler(monkeypatch, grants)
    with pytest.raises(ZeroDivisionError), realtime_priority():
        assert (scheduler.policy == os.SCHED_RR) is grants
        raise ZeroDivisionError
    assert scheduler.policy == os.SCHED_OTHER


def test_what_is_no_longer_granted_becomes_ordinary(monkeypatch: pytest.MonkeyPatch) -> None:
    scheduler = Scheduler(monkeypatch, grants=False)
    scheduler.policy = os.SCHED_RR
    with realtime_priority():
        assert scheduler.policy == os.SCHED_RR
    assert scheduler.policy == os.SCHED_OTHER
