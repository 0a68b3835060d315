"""The view's loop: from a source into the page, until it is told to end."""

from collections.abc import Callable
from typing import Final

from drivers.clock import Clock
from servoloop.live.source import Source
from servoloop.view.move_panel import MovePanel
from servoloop.view.page import Page

ARM_S: Final = 0.05
"""The arm moves in the page this often,"""
NUMBERS: Final = 7
"""and numbers are renewed every so many times."""
BEAT: Final = 20
"""The number of turns between two signs of life to the browsers."""


def show(page: Page, source: Source, clock: Clock, stop: Callable[[], bool], panel: MovePanel | None = None) -> None:
    """Show the source until ``stop`` says so, with the buttons that move it where there are some."""
    turn = 0
    while not stop():
        watched = source.watched
        page.status(source.status, source.well, beat=turn // BEAT)
        page.show_arm(watched)
        if panel is not None:
            panel.show()
        if turn % NUMBERS == 0:
            page.show_numbers(watched)
        turn += 1
        clock.sleep_until(clock.now() + ARM_S)
