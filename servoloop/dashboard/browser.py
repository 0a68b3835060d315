"""Update the page of ``servoloop view`` from a source in a loop."""

from collections.abc import Callable
from typing import Final

from drivers.clock import Clock
from servoloop.dashboard.move_panel import MovePanel
from servoloop.dashboard.page import Page
from servoloop.recording.sources import Source

ARM_S: Final = 0.05
"""Interval at which the drawn arm is updated, in seconds."""
NUMBERS: Final = 7
"""Number of updates of the arm per update of the numbers."""
BEAT: Final = 20
"""Number of updates of the arm per heartbeat to the browsers."""


def show(page: Page, source: Source, clock: Clock, stop: Callable[[], bool], panel: MovePanel | None = None) -> None:
    """Show the source, and the buttons of ``panel`` if it is given, until ``stop`` returns True."""
    turn = 0
    while not stop():
        watched = source.robot
        page.status(source.status, source.up_to_date, beat=turn // BEAT)
        page.show_arm(watched)
        if panel is not None:
            panel.show()
        if turn % NUMBERS == 0:
            page.show_numbers(watched)
        turn += 1
        clock.sleep_until(clock.now() + ARM_S)
