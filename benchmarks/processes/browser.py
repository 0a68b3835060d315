"""Start a headless browser without a graphics card, for benchmarks, images and tests."""

import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from playwright.sync_api import Page, sync_playwright

WITHOUT_GPU: Final = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
VIEWPORT: Final = {"width": 1100, "height": 700}
PATIENCE_MS: Final = 60_000.0
NICE: Final = 10
"""Nice value of a browser with low priority, and of its session."""


@contextmanager
def browser_page(chromium: str, viewport: Mapping[str, int] = VIEWPORT, *, stand_back: bool = False) -> Iterator[Page]:
    """Open an empty page in the browser that is installed at this path.

    ``viewport`` is the width and height of the page in pixels. If ``stand_back`` is true, the browser has the lowest
    priority on the machine.
    """
    with tempfile.TemporaryDirectory(prefix="browser-") as folder, sync_playwright() as playwright:
        program = _standing_back(chromium, Path(folder)) if stand_back else chromium
        browser = playwright.chromium.launch(executable_path=program, args=WITHOUT_GPU)
        try:
            yield browser.new_page(viewport=viewport)  # type: ignore[arg-type]
        finally:
            browser.close()


def _standing_back(chromium: str, folder: Path) -> str:
    """Return the path of a script that starts the browser with a lower priority than all other programs.

    Without a graphics card, a browser keeps all processors busy with rendering. Linux gives the browser's session as
    much processor time as all other sessions together, regardless of its nice value (sched(7), autogroup). If the
    browser is started by root, it even raises its own priority. The kernel threads that transfer the bytes of serial
    ports and pseudo-terminals then have to wait for the browser.
    """
    command = f"nice -n {NICE} "
    if os.geteuid() == 0 and shutil.which("setpriv"):
        command += "setpriv --bounding-set -sys_nice -- "
    program = folder / "chromium"
    group = f"echo {NICE} 2> /dev/null > /proc/self/autogroup"
    program.write_text(f'#!/bin/sh\n{group}\nexec {command}{chromium} "$@"\n')
    program.chmod(0o755)
    return str(program)
