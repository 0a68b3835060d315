"""Playback controls for a recording on the page: time slider, pause and speed."""

from typing import Final

import viser

from drivers.clock import Clock
from servoloop.recording.robot_state import ObservedRobot
from servoloop.recording.sources import SPEEDS, Playback, PlayedRecording

PAUSE: Final = "Pause"
PLAY: Final = "Play"


class Player:
    """Looping playback of a recording, controlled by the browsers."""

    up_to_date = True

    def __init__(self, server: viser.ViserServer, recording: PlayedRecording, clock: Clock) -> None:
        self._playback = Playback(recording, clock)
        self.status, self.close = f"recording: {recording.name}", self._playback.close
        gui, length_s = server.gui, recording.length_s
        with gui.add_folder("PlayedRecording", order=0.0):
            self._slider = gui.add_slider(
                "Time (s)", min=0.0, max=max(0.1, round(length_s, 1)), step=0.1, initial_value=0.0
            )
            self._button = gui.add_button(PAUSE)
            self._speed = gui.add_dropdown("Speed", SPEEDS, initial_value=self._playback.speed)
        self._slider.on_update(self._moved)
        self._button.on_click(lambda _: self._toggle())
        self._sought = False

    @property
    def robot(self) -> ObservedRobot:
        """Robot state at the current playback time."""
        self._playback.speed = self._speed.value
        sought, self._sought = self._sought, False
        watched = self._playback.robot
        shown = round(self._playback.time_s, 1)
        if not sought and shown != self._slider.value:  # do not move a slider that a user is dragging
            self._slider.value = shown  # type: ignore[misc]  # viser defines the setter separately
        return watched

    def _moved(self, event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
        if event.client is not None:  # A browser moved the slider, not this program.
            self._playback.seek(float(event.target.value))
            self._sought = True

    def _toggle(self) -> None:
        self._playback.toggle()
        self._button.label = PAUSE if self._playback.playing else PLAY
