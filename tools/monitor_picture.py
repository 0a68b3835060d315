"""Draw the image of docs/monitor.md: simulated jobs as `servoloop monitor` shows them.

Example: `python tools/monitor_picture.py docs/monitor.svg`
"""

import asyncio
import re
import sys
import tempfile
from pathlib import Path

import numpy as np

from drivers.clock import MonotonicClock
from pick_place.settings import JobSettings
from servoloop.dashboard.terminal import ALL, JOINTS_S, MonitorApp
from servoloop.recording.reader import read_recording
from servoloop.recording.sources import Playback, PlayedRecording
from servoloop.simulation.schedule import Schedule
from servoloop.simulation.simulate import simulate
from servoloop.stack.robot_files import read_files
from sim_backend.faults.text import parse

COLUMNS, LINES = 130, 44
JOBS = ("A", "B", "C")
FAULT = parse("silent id=5 at=20s for=0.2s")
JOINT = "1"
STILL_S = 1.5 * ALL * JOINTS_S
"""Maximum time until every widget is updated, in seconds. A screen that does not change for this time has settled."""
SETTLE_S = 30.0


def main(picture: Path) -> None:
    """Record the jobs, and write the moment of the fastest motion in the last job as an SVG file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "job.mcap"
        simulate(read_files(), {"": JobSettings()}, Schedule(job=JOBS, faults=(FAULT,)), path)
        run, recording = read_recording(path), PlayedRecording(path)
    playback = Playback(recording, MonotonicClock())
    playback.toggle()
    last = len(run.time_s) * (len(JOBS) - 1) // len(JOBS)
    playback.seek(float(run.time_s[last + int(np.abs(run.velocity[last:, 0]).argmax())]))
    picture.write_text(asyncio.run(screen(playback)))


async def screen(playback: Playback) -> str:
    """Return the settled screen as an SVG that loads no fonts from other machines.

    Raises TimeoutError if the screen never settles.
    """
    app = MonitorApp(playback)
    async with app.run_test(size=(COLUMNS, LINES)) as pilot:
        await pilot.press(JOINT)
        async with asyncio.timeout(SETTLE_S):
            former, drawn = "", app.export_screenshot(simplify=True)
            while drawn != former:  # The size of a strip is the space that was available when the strip was drawn.
                await pilot.pause(STILL_S)
                former, drawn = drawn, app.export_screenshot(simplify=True)
    return re.sub(r"@font-face \{.*?\}", "", drawn, flags=re.DOTALL)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
