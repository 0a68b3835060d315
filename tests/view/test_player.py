"""Playback of a recording with pauses, different speeds and the time slider."""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from servoloop.dashboard.player import Player
from servoloop.dashboard.server import PageServer
from servoloop.recording.sources import PlayedRecording
from sim_backend.clock import SimulatedClock
from tests.recorder.rig import Rig


class Playing:
    """Recording of four seconds, played on a simulated clock."""

    def __init__(self, server: PageServer, path: Path) -> None:
        self.recording, self.clock = PlayedRecording(path), SimulatedClock()
        self.player = Player(server, self.recording, self.clock)
        self.begin_s = self.recording.robot.state.snapshot.stamp_s

    def after(self, seconds: float) -> float:
        """Return the time in the recording that is shown after a delay, in seconds since the first cycle."""
        self.clock.sleep_until(self.clock.now() + seconds)
        return self.player.robot.state.snapshot.stamp_s - self.begin_s

    def slide(self, time_s: float) -> None:
        """Move the slider as a browser does."""
        event: Any = SimpleNamespace(client=object(), target=SimpleNamespace(value=time_s))
        self.player._moved(event)


@pytest.fixture
def playing(tmp_path: Path) -> Iterator[Playing]:
    rig = Rig()
    rig.run(4.0)
    rig.record(tmp_path / "run.mcap")
    server = PageServer(port=0)
    yield Playing(server, tmp_path / "run.mcap")
    server.stop()


def cycle(seconds: float) -> Any:
    return pytest.approx(seconds, abs=0.051)


def test_a_recording_plays_at_the_selected_speed_and_restarts_at_its_end(playing: Playing) -> None:
    assert [playing.after(0.5), playing.after(1.0)] == [cycle(0.5), cycle(1.5)]
    assert playing.player._slider.value == cycle(1.5)
    playing.player._speed.value = "0.1"
    assert playing.after(5.0) == cycle(2.0)
    playing.player._speed.value = "10"
    assert playing.after(1.0) == 0.0


def test_a_paused_recording_continues_from_the_same_time(playing: Playing) -> None:
    playing.after(1.0)
    playing.player._toggle()
    assert playing.player._button.label == "Play" and playing.after(60.0) == cycle(1.0)
    playing.player._toggle()
    assert playing.player._button.label == "Pause" and playing.after(0.5) == cycle(1.5)


def test_the_slider_moves_the_playback_also_while_paused(playing: Playing) -> None:
    playing.after(1.0)
    playing.slide(3.0)
    assert playing.after(0.0) == cycle(3.0)
    playing.player._toggle()
    playing.slide(0.5)
    assert playing.after(9.0) == cycle(0.5) and playing.after(9.0) == cycle(0.5)
