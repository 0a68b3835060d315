"""Track which button on the page is held.

A browser sends a message repeatedly while a button is held. The button counts as released when the messages stop or
when the click ends.
"""

import threading
from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import Final, Protocol

from drivers.clock import Clock


class Moves(Protocol):
    """Client that moves the arm: servoloop.manual.robot_client.RobotClient."""

    def jog(self, joint: str, share: float) -> None: ...
    def approach(self, pose: Mapping[str, float], share: float = 1.0) -> bool: ...
    def stop(self) -> None: ...


class Command(Protocol):
    """Motion that continues while its button is held."""

    def step(self, client: Moves) -> str:
        """Continue the motion by one step and return a message about it.

        Raises HandlingError if the arm cannot be moved.
        """
        ...


@dataclass(frozen=True, slots=True)
class Turn:
    """Motion of one joint at a fraction (-1 to 1) of its full speed."""

    joint: str
    share: float

    def step(self, client: Moves) -> str:
        """Move the joint by one step."""
        client.jog(self.joint, self.share)
        return f"moving {self.joint} ({'+' if self.share > 0 else '−'})"


@dataclass(frozen=True, slots=True)
class GoTo:
    """Motion to a pose (rad or m, keyed by joint name) at a fraction (0 to 1) of full speed."""

    name: str
    pose: Mapping[str, float]
    share: float

    def step(self, client: Moves) -> str:
        """Move the joints of the pose by one step."""
        return f"reached: {self.name}" if client.approach(self.pose, self.share) else f"moving: {self.name}"


REPEATS_HZ: Final = 20.0
"""Rate at which a browser reports a held button, in Hz."""
GOOD_S: Final = 0.2
"""Maximum age, in seconds, at which a report that a button is held is still valid."""
BEGIN_S: Final = 0.1
"""Minimum time that a button must be reported as held before the arm moves, in seconds.

Neither a single report nor several delayed reports that arrive at once move the arm.
"""
GAP_S: Final = 0.6
"""Minimum time without a report after which the next report counts as a new press, in seconds.

On a hidden page, browsers send only one report per second.
"""
LONGEST_S: Final = 10.0
"""Maximum duration of a press, in seconds. A limit is needed because the browser may miss the release of a button."""
TAKEN: Final = "another browser or button is moving the arm; release this button and press it again later"
TOO_LONG: Final = f"a button can be held for at most {LONGEST_S:.0f} s; release it and press it again"


@dataclass(slots=True)
class _Press:
    button: Hashable
    command: Command
    began_s: float
    last_s: float


class HeldButtons:
    """Tracker that determines which button moves the arm, among all buttons of all browsers. All methods are
    thread-safe.

    Each button in each browser is identified by a key, ``button``. A press that was rejected or ended has no effect
    until the button is released. This rule prevents unexpected motion while a user holds a button and the arm is at
    rest.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._press: _Press | None = None
        self._over: dict[Hashable, float] = {}
        """Time of the last report of each button whose press was rejected or ended."""

    def hold(self, button: Hashable, command: Command) -> str:
        """Process a browser's report that a button is held.

        Args:
            button: Key of the button.
            command: Motion to perform. Only the command in the first report of a press is used.

        Returns:
            The reason why the press is rejected or ended, returned once per press; otherwise an empty string.
        """
        with self._lock:
            now_s = self._clock.now()
            self._over = {other: last_s for other, last_s in self._over.items() if now_s - last_s <= GAP_S}
            if button in self._over:
                self._over[button] = now_s
                return ""
            press = self._press
            if press is not None and press.button == button and now_s - press.last_s <= GAP_S:
                press.last_s = now_s
                return self._end(TOO_LONG) if now_s - press.began_s > LONGEST_S else ""
            if press is not None and press.button != button and now_s - press.last_s <= GOOD_S:
                self._over[button] = now_s
                return TAKEN
            self._end()
            self._press = _Press(button, command, now_s, now_s)
            return ""

    def release(self, button: Hashable) -> None:
        """Process a browser's report that a button was released."""
        with self._lock:
            self._over.pop(button, None)
            if self._press is not None and self._press.button == button:
                self._press = None

    def end(self) -> None:
        """End the current press. The button has no effect until it is released and pressed again."""
        with self._lock:
            self._end()

    def command(self) -> Command | None:
        """Return the command of the held button, or None if no button is held."""
        with self._lock:
            press = self._press
            if press is None or self._clock.now() - press.last_s > GOOD_S:
                return None
            return press.command if press.last_s - press.began_s >= BEGIN_S else None

    def _end(self, why: str = "") -> str:
        if self._press is not None:
            self._over[self._press.button] = self._press.last_s
            self._press = None
        return why
