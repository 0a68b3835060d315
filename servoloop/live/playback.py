"""A recording as a source: at any speed, over and over, from any moment."""

from drivers.clock import Clock
from servoloop.live.recording import Recording
from servoloop.live.watched import Watched

SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "5", "10")
"""Times the speed of the run."""


class Playback:
    """Plays a recording. One thread asks for ``watched``; any thread may seek, pause and change the speed."""

    well = True

    def __init__(self, recording: Recording, clock: Clock) -> None:
        self.playing = True
        self.speed = "1"
        """One of ``SPEEDS``."""
        self.time_s = 0.0
        """The moment that is shown, from the first cycle."""
        self.length_s = recording.length_s
        self.name = recording.name
        self._recording, self._clock = recording, clock
        self._asked_s: float | None = None
        self._last_s = clock.now()

    @property
    def status(self) -> str:
        """The recording's name, the moment, and how it is played."""
        speed = f"{self.speed} times the speed" if self.playing else "paused"
        return f"recording: {self.name}, {self.time_s:.1f} of {self.length_s:.1f} s, {speed}"

    @property
    def watched(self) -> Watched:
        """The robot at the moment that is played now."""
        self._advance()
        return self._recording.play_to(self.time_s)

    def seek(self, time_s: float) -> None:
        """Go to a moment; beyond an end of the recording that end is meant."""
        self._asked_s = min(max(time_s, 0.0), self.length_s)

    def toggle(self) -> None:
        """Pause, or play on."""
        self.playing = not self.playing

    def close(self) -> None:
        """Nothing is open."""

    def _advance(self) -> None:
        now_s = self._clock.now()
        passed_s, self._last_s = now_s - self._last_s, now_s
        asked_s, self._asked_s = self._asked_s, None
        if asked_s is not None:
            self.time_s = asked_s
        elif self.playing:
            self.time_s += passed_s * float(self.speed)
            if self.time_s > self.length_s:
                self.time_s = 0.0
