"""Keys of a terminal that are held. Terminals tell presses and repeats, and no releases: no repeat is a release."""

import os
import select
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, Final

FIRST_S: Final = 0.7
"""A key that is held repeats after so long at first: half a second in most terminals."""
REPEAT_S: Final = 0.25
"""And then many times in this; so long after the key is let go it still counts as held."""
_before: dict[int, list[Any]] = {}
"""The settings of terminals that give each key now, from before that, by descriptor."""
NAMES: Final = {"\x1b[A": "up", "\x1b[B": "down", "\x1b[C": "right", "\x1b[D": "left", " ": "space"}


class HeldKey:
    """The key that is held, fed with what was typed; times in s."""

    def __init__(self, tap_s: float) -> None:
        """``tap_s``: so long a key counts as held that was pressed once, until repeats come."""
        self._tap_s = tap_s
        self._key = ""
        self._pressed_s = self._until_s = -1.0
        self._over = False
        """Whether the press counts no more, however long the key is held."""

    def press(self, key: str, now_s: float) -> bool:
        """A key was pressed, or repeats. Returns whether this is a new press."""
        repeats = key == self._key and now_s - self._pressed_s <= FIRST_S
        self._key, self._pressed_s = key, now_s
        self._over = self._over and repeats
        if not self._over:
            self._until_s = now_s + (REPEAT_S if repeats else self._tap_s)
        return not repeats

    def release(self) -> None:
        """Forget the press. A key that is still held counts again only after it was released and pressed."""
        self._until_s, self._over = -1.0, True

    def held(self, now_s: float) -> str:
        """The key; empty where none is held."""
        return self._key if now_s <= self._until_s else ""


def split_keys(text: str) -> Iterator[str]:
    """The names of keys in what a terminal has sent; arrows are up, down, right and left."""
    while text:
        for code, name in NAMES.items():
            if text.startswith(code):
                text = text[len(code) :]
                yield name
                break
        else:
            yield text[0]
            text = text[1:]


def typed(wait_s: float) -> list[str]:
    """What was typed at this terminal; waits so long for it. A terminal that is gone says q, to quit."""
    descriptor = sys.stdin.fileno()
    if not select.select([descriptor], [], [], wait_s)[0]:
        return []
    try:
        text = os.read(descriptor, 1024).decode(errors="replace")
    except OSError:
        text = ""
    return list(split_keys(text)) if text else ["q"]


@contextmanager
def raw_keys(keep: bool = False) -> Iterator[None]:
    """The terminal gives each key as it is pressed, without showing it; at the end all is as it was.

    ``keep``: what was typed before, too. Else it is forgotten.
    """
    descriptor = sys.stdin.fileno()
    before = _before[descriptor] = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor, termios.TCSANOW if keep else termios.TCSAFLUSH)
    try:
        yield
    finally:
        _before.pop(descriptor, None)
        with suppress(termios.error):  # a terminal that is gone
            termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def put_back() -> None:
    """Leave terminals as they were before ``raw_keys``, for a program that ends at once and gets to no end of it."""
    for descriptor, before in list(_before.items()):  # the main thread may be taking one away
        with suppress(termios.error, OSError):
            if os.tcgetpgrp(descriptor) == os.getpgrp():  # from the background it would stop the program
                termios.tcsetattr(descriptor, termios.TCSANOW, before)
