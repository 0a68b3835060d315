"""The emulator has real-time priority while it serves, but not while it computes or draws pictures.

Two emulators that draw with this priority would block the servos of other arms for seconds on a small machine.
"""

import os
from pathlib import Path

import pytest

from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.emulator import emulate
from servoloop.stack.emulator_options import EmulatorOptions
from servoloop.stack.processes import PRIORITY, realtime_priority
from sim_backend.scene.picture import FilmRecorder


class Scheduler:
    """Simulated scheduling policy of this process."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, grants: bool = True) -> None:
        self.policy = os.SCHED_OTHER
        self.priorities = set[int]()
        """Real-time priorities that were granted."""
        self.grants = grants
        monkeypatch.setattr(os, "sched_setscheduler", self._set)
        monkeypatch.setattr(os, "sched_getscheduler", lambda pid: self.policy)

    def _set(self, pid: int, policy: int, param: os.sched_param) -> None:
        if policy == os.SCHED_RR and not self.grants:
            raise PermissionError(pid, "not permitted")
        self.policy = policy
        if policy == os.SCHED_RR:
            self.priorities.add(param.sched_priority)


def test_the_emulator_has_priority_while_it_serves_but_not_while_it_draws(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scheduler, seen = Scheduler(monkeypatch), dict[str, int]()
    monkeypatch.setattr(FilmRecorder, "__init__", lambda self, world: seen.update(built=scheduler.policy))
    monkeypatch.setattr(FilmRecorder, "save", lambda self, folder: seen.update(drawn=scheduler.policy))
    emulate(
        read_arm_files(find_arm()),
        tmp_path / "bus",
        EmulatorOptions(backlash_deg=0.0, pictures=tmp_path),
        (),
        stop=lambda: True,
        on_ready=lambda: seen.update(served=scheduler.policy),
    )
    assert seen == {"built": os.SCHED_OTHER, "served": os.SCHED_RR, "drawn": os.SCHED_OTHER}
    assert min(scheduler.priorities) > PRIORITY, "it answers late while another stack starts"


@pytest.mark.parametrize("grants", [True, False])
def test_the_priority_is_restored_after_an_exception(monkeypatch: pytest.MonkeyPatch, grants: bool) -> None:
    scheduler = Scheduler(monkeypatch, grants)
    with pytest.raises(ZeroDivisionError), realtime_priority():
        assert (scheduler.policy == os.SCHED_RR) is grants
        raise ZeroDivisionError
    assert scheduler.policy == os.SCHED_OTHER


def test_a_priority_that_is_refused_falls_back_to_the_ordinary_one(monkeypatch: pytest.MonkeyPatch) -> None:
    scheduler = Scheduler(monkeypatch, grants=False)
    scheduler.policy = os.SCHED_RR
    with realtime_priority():
        assert scheduler.policy == os.SCHED_RR
    assert scheduler.policy == os.SCHED_OTHER
