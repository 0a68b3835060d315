"""Draw the image of docs/view.md: a simulated job in the page of `servoloop view`. The script needs chromium on PATH.

Example: `python tools/view_picture.py docs/view.png`
"""

import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.processes.browser import browser_page
from servoloop.dashboard.page import Page
from servoloop.dashboard.server import PageServer
from servoloop.recording.reader import read_recording
from servoloop.recording.sources import PlayedRecording
from servoloop.simulation.job import job_settings
from servoloop.simulation.schedule import Schedule
from servoloop.simulation.simulate import simulate
from servoloop.stack.arm_folders import find_arm, read_arm_files

ARM = "so101"
SIZE = {"width": 1400, "height": 820}
DRAWN_MS = 10_000.0
SHOT_MS = 60_000.0
NOTICE = "Software WebGL rendering detected"


def main(picture: Path) -> None:
    """Record a job and draw the moment of the fastest motion."""
    with tempfile.TemporaryDirectory() as folder:
        path, arm = Path(folder) / "job.mcap", find_arm(ARM)
        schedule = Schedule(job=("A",), arm=ARM)
        simulate(read_arm_files(arm), job_settings(arm, schedule.job), schedule, path)
        run, recording = read_recording(path), PlayedRecording(path)
    server = PageServer(port=0)
    try:
        page, moment_s = Page(server), run.time_s[int(np.abs(run.velocity[:, 0]).argmax())]
        watched = recording.play_to(float(moment_s))
        page.status(f"recording: {path.name}")
        page.show_arm(watched)
        page.show_numbers(watched)
        photograph(server.url, picture)
    finally:
        server.stop()


def photograph(url: str, picture: Path) -> None:
    """Open the page in a headless browser and close its message about the missing graphics card."""
    with browser_page(shutil.which("chromium") or "chromium", SIZE) as page:
        page.goto(url)
        page.wait_for_selector("canvas")
        page.wait_for_timeout(DRAWN_MS)
        if page.get_by_text(NOTICE).count():
            # A click would wait until the button is at rest, which takes a long time without a graphics card.
            page.locator(f"[role=alert]:has-text('{NOTICE}') button").dispatch_event("click")
            page.wait_for_timeout(DRAWN_MS / 4)
        page.screenshot(path=picture, timeout=SHOT_MS)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
