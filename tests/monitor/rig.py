"""Show the monitor's screen without a terminal, and read its text."""

import asyncio
import html
import re
from collections.abc import Awaitable, Callable

from textual.pilot import Pilot

from servoloop.dashboard.terminal import MonitorApp
from servoloop.recording.robot_state import ObservedRobot
from servoloop.recording.sources import Source

SIZE = (140, 44)


class FixedSource:
    """Source whose state is constant."""

    status, up_to_date = "robot_arm: live", True

    def __init__(self, watched: ObservedRobot) -> None:
        self.robot = watched

    def close(self) -> None:
        """Do nothing; the source holds no resources."""


def on_screen(
    source: Source,
    look: Callable[[MonitorApp, Pilot[None]], Awaitable[None]],
    size: tuple[int, int] = SIZE,
    stop: Callable[[], bool] = lambda: False,
) -> None:
    """Show a source on the screen, and run ``look`` on that screen. Errors of the screen are raised."""
    app = MonitorApp(source, stop)

    async def run() -> None:
        async with app.run_test(size=size) as pilot:
            await pilot.pause()
            await pilot.pause()
            await look(app, pilot)

    asyncio.run(run())


def words(app: MonitorApp) -> str:
    """Return the text on the screen, line by line."""
    texts = re.findall(r"<text[^>]* y=\"([\d.]+)\"[^>]*>([^<]*)</text>", app.export_screenshot(simplify=True))
    lines: dict[str, str] = {}
    for y, text in texts:
        lines[y] = lines.get(y, "") + html.unescape(text).rstrip("\n")
    return "\n".join(lines.values()).replace("\u00a0", " ")
