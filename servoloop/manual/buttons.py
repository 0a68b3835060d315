"""Buttons of a page that are held. A browser repeats that one is; its silence, or a click's end, is the release."""

import threading
from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import Final, Protocol

from drivers.clock import Clock


class Moves(Protocol):
    """What moves the arm: nodes.handling.robot_client.RobotClient."""

    def jog(self, joint: str, share: float) -> None: ...
    def approach(self, pose: Mapping[str, float], share: float = 1.0) -> bool: ...
    def stop(self) -> None: ...


class Wish(Protocol):
    """A motion that goes on as long as it is wished."""

    def on(self, client: Moves) -> str:
        """Go on a little; in words what is done. Raises HandlingError where the arm cannot be moved."""
        ...


@dataclass(frozen=True, slots=True)
class Turn:
    """A joint turns, at this share (-1 to 1) of its full speed."""

    joint: str
    share: float

    def on(self, client: Moves) -> str:
        """Turn on a little."""
        client.jog(self.joint, self.share)
        return f"{self.joint} turns {'on' if self.share > 0 else 'back'}"


@dataclass(frozen=True, slots=True)
class GoTo:
    """The joints of a pose (rad or m) go there, at this share (0 to 1) of full speed."""

    name: str
    pose: Mapping[str, float]
    share: float

    def on(self, client: Moves) -> str:
        """Go on a little."""
        return f"there: {self.name}" if client.approach(self.pose, self.share) else f"on the way: {self.name}"


REPEATS_HZ: Final = 20.0
"""So often a browser says that a button is held."""
GOOD_S: Final = 0.2
"""A word of a browser is good for so long,"""
BEGIN_S: Final = 0.1
"""and the first ones are not enough: not one alone, nor many at once that a network has kept back."""
GAP_S: Final = 0.6
"""After so long without a word it is another press. A browser gives a page that is hidden a word a second."""
LONGEST_S: Final = 10.0
"""No press is good for longer: a browser may have missed that the button was let go."""
TAKEN: Final = "another browser, or another button, is moving the arm: let go, and press when it has ended"
TOO_LONG: Final = f"a button is good for {LONGEST_S:.0f} s: let go, and press again"


@dataclass(slots=True)
class _Press:
    who: Hashable
    wish: Wish
    began_s: float
    last_s: float


class Presses:
    """The one press that counts, for any threads. ``who`` is a button in a browser.

    A press that does not count, because another did or because it was ended, does not later, either: who holds a
    button while nothing moves is not surprised by a motion.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._press: _Press | None = None
        self._over: dict[Hashable, float] = {}
        """Presses that count no more, and when they were last heard of."""

    def hold(self, who: Hashable, wish: Wish) -> str:
        """A browser says that a button is held; the first wish of a press counts. Returns why it does not, once."""
        with self._lock:
            now_s = self._clock.now()
            self._over = {other: last_s for other, last_s in self._over.items() if now_s - last_s <= GAP_S}
            if who in self._over:
                self._over[who] = now_s
                return ""
            press = self._press
            if press is not None and press.who == who and now_s - press.last_s <= GAP_S:
                press.last_s = now_s
                return self._end(TOO_LONG) if now_s - press.began_s > LONGEST_S else ""
            if press is not None and press.who != who and now_s - press.last_s <= GOOD_S:
                self._over[who] = now_s
                return TAKEN
            self._end()
            self._press = _Press(who, wish, now_s, now_s)
            return ""

    def release(self, who: Hashable) -> None:
        """A browser says that a button was let go."""
        with self._lock:
            self._over.pop(who, None)
            if self._press is not None and self._press.who == who:
                self._press = None

    def end(self) -> None:
        """What is held counts no more, until it is let go and pressed again."""
        with self._lock:
            self._end()

    def wish(self) -> Wish | None:
        """What is to be done now; None where nothing is held."""
        with self._lock:
            press = self._press
            if press is None or self._clock.now() - press.last_s > GOOD_S:
                return None
            return press.wish if press.last_s - press.began_s >= BEGIN_S else None

    def _end(self, why: str = "") -> str:
        if self._press is not None:
            self._over[self._press.who] = self._press.last_s
            self._press = None
        return why
