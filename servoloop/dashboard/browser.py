"""The view's loop: from a source into the page, until it is told to end."""

import importlib.util
from collections.abc import Callable
from typing import Final

from drivers.clock import Clock
from drivers.errors import DriverError
from servoloop.dashboard.move_panel import MovePanel
from servoloop.dashboard.page import Page
from servoloop.extras import install_command
from servoloop.recording.sources import Source

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
        watched = source.robot
        page.status(source.status, source.up_to_date, beat=turn // BEAT)
        page.show_arm(watched)
        if panel is not None:
            panel.show()
        if turn % NUMBERS == 0:
            page.show_numbers(watched)
        turn += 1
        clock.sleep_until(clock.now() + ARM_S)


def require_view(what: str = "the view", library: str = "viser") -> None:
    """Raise DriverError, which names the command that installs it, where the library is missing."""
    if importlib.util.find_spec(library) is None:
        raise DriverError(f"{what} needs {library}: {install_command('view')}")
