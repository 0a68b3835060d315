"""Update the page of ``servoloop view`` from a source in a loop."""

from collections.abc import Callable, Sequence
from typing import Final

from drivers.clock import Clock
from servoloop.dashboard.page import Page
from servoloop.recording.robot_state import ObservedRobot
from servoloop.recording.sources import Source

ARM_S: Final = 0.05
"""Interval at which the drawn arm is updated, in seconds."""
NUMBERS: Final = 7
"""Number of arm updates between updates of the displayed numbers."""
BEAT: Final = 20
"""Number of arm updates between heartbeats sent to the browsers."""


Part = Callable[[ObservedRobot], None]
"""Function that updates another part of the page, such as the buttons or the cameras."""


def show(page: Page, source: Source, clock: Clock, stop: Callable[[], bool], parts: Sequence[Part] = ()) -> None:
    """Show the source and the other parts of the page until ``stop`` returns True."""
    turn = 0
    while not stop():
        watched = source.robot
        page.status(source.status, source.up_to_date, beat=turn // BEAT)
        page.show_arm(watched)
        for part in parts:
            part(watched)
        if turn % NUMBERS == 0:
            page.show_numbers(watched)
        turn += 1
        clock.sleep_until(clock.now() + ARM_S)
