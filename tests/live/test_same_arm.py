"""Two stacks of one arm: a program that has chosen one of them by its process ID keeps using that stack."""

import pytest

from drivers.clock import MonotonicClock
from servoloop.recording.sources import LiveSource
from tests.live.rig import LiveRig, runtime_folder
from tests.servoloop.served import eventually


def test_source_stays_with_the_chosen_stack(monkeypatch: pytest.MonkeyPatch) -> None:
    with runtime_folder(monkeypatch):
        rigs = [LiveRig("so101", pid) for pid in (1, 2)]
        source = LiveSource("2", MonotonicClock())
        try:

            def live() -> bool:
                rigs[1].play(0.1)
                return source.connected

            eventually(live)
        finally:
            source.close()
            for rig in rigs:
                rig.feed.close((), failed=False)
