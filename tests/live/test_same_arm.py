"""Two stacks of one arm: a program that has chosen one of them by its process ID keeps using that stack. An arm is also
found by a name with characters that are not allowed in the names of sockets."""

import pytest

from drivers.clock import MonotonicClock
from servoloop.recording.sources import LiveSource
from servoloop.recording.stream import LiveError, find_stack
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


@pytest.mark.parametrize("name", ["my-arm", "my arm", "müarm"])
def test_arm_in_a_folder_with_any_name_is_found_by_this_name(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    with runtime_folder(monkeypatch):
        rig = LiveRig(name)
        assert find_stack(name).pid == 1
        with pytest.raises(LiveError, match="no stack of other-arm is running"):
            find_stack("other-arm")
        rig.feed.close((), failed=False)
