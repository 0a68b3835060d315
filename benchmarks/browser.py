"""A browser without a screen and without a graphics card, for benches, pictures and tests."""

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
"""Of a browser that stands back, and of its session."""


@contextmanager
def browser_page(chromium: str, viewport: Mapping[str, int] = VIEWPORT, *, stand_back: bool = False) -> Iterator[Page]:
    """An empty page of the browser at this path; ``viewport``: its width and height in pixels.

    ``stand_back``: whatever else runs on this machine comes first.
    """
    with tempfile.TemporaryDirectory(prefix="browser-") as folder, sync_playwright() as playwright:
        program = _standing_back(chromium, Path(folder)) if stand_back else chromium
        browser = playwright.chromium.launch(executable_path=program, args=WITHOUT_GPU)
        try:
            yield browser.new_page(viewport=viewport)  # type: ignore[arg-type]
        finally:
            browser.close()


def _standing_back(chromium: str, folder: Path) -> str:
    """A program that starts the browser behind everything else.

    Without a graphics card a browser draws all the time, on all processors. Linux gives it as much of them as to all
    other sessions together, whatever its nice value (sched(7), autogroup), and where root starts it, it raises its
    priority even above others: the kernel's threads that carry the bytes of serial ports and pseudo-terminals wait
    for it then.
    """
    command = f"nice -n {NICE} "
    if os.geteuid() == 0 and shutil.which("setpriv"):
        command += "setpriv --bounding-set -sys_nice -- "
    program = folder / "chromium"
    group = f"echo {NICE} 2> /dev/null > /proc/self/autogroup"
    program.write_text(f'#!/bin/sh\n{group}\nexec {command}{chromium} "$@"\n')
    program.chmod(0o755)
    return str(program)
