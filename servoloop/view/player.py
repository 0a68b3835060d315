"""A recording as the source of a page: a time slider, pause and speed."""

from typing import Final

import viser

from drivers.clock import Clock
from servoloop.view.recording import Recording
from servoloop.view.watched import Watched

SPEEDS: Final = ("0.1", "0.25", "0.5", "1", "2", "5", "10")
PAUSE, PLAY = "Pause", "Play"


class Player:
    """Plays a recording over and over; browsers say where and how fast."""

    def __init__(self, server: viser.ViserServer, recording: Recording, clock: Clock) -> None:
        self._recording, self._clock = recording, clock
        self._length_s = self._recording.length_s
        self.status = f"recording: {recording.name}"
        self._time_s = 0.0
        self._asked_s: float | None = None
        self._last_s = clock.now()
        gui = server.gui
        with gui.add_folder("Recording", order=0.0):
            self._slider = gui.add_slider(
                "Time (s)", min=0.0, max=max(0.1, round(self._length_s, 1)), step=0.1, initial_value=0.0
            )
            self._button = gui.add_button(PAUSE)
            self._speed = gui.add_dropdown("Speed", SPEEDS, initial_value="1")
        self._playing = True
        self._slider.on_update(self._moved)
        self._button.on_click(lambda _: self._toggle())

    @property
    def watched(self) -> Watched:
        """The robot at the moment that is played now."""
        self._advance()
        return self._recording.play_to(self._time_s)

    def close(self) -> None:
        """Nothing is open."""

    def _advance(self) -> None:
        now_s = self._clock.now()
        passed_s, self._last_s = now_s - self._last_s, now_s
        asked_s, self._asked_s = self._asked_s, None
        if asked_s is not None:
            self._time_s = asked_s
        elif self._playing:
            self._time_s += passed_s * float(self._speed.value)
            if self._time_s > self._length_s:
                self._time_s = 0.0
        shown = round(self._time_s, 1)
        if asked_s is None and shown != self._slider.value:
            self._slider.value = shown  # type: ignore[misc]  # its setter stands apart from its property

    def _moved(self, event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
        if event.client is not None:  # by a browser, not by us
            self._asked_s = float(event.target.value)

    def _toggle(self) -> None:
        self._playing = not self._playing
        self._button.label = PAUSE if self._playing else PLAY
