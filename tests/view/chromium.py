"""Helpers that open the page in a headless browser and read it as a user sees it."""

import io
import os
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Final

import numpy as np
import pytest
from PIL import Image, ImageChops
from playwright.sync_api import Page

from benchmarks.processes.browser import PATIENCE_MS, VIEWPORT, browser_page


def find_chromium() -> str:
    """Return the path of Chromium. Without Chromium, the test is skipped, but in CI it fails."""
    path = shutil.which("chromium")
    if path is None:
        (pytest.fail if os.environ.get("CI") else pytest.skip)("chromium is not on PATH")
    return str(path)


SELDOM = """
window.requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 500);
window.cancelAnimationFrame = clearTimeout;
"""
"""Script that limits drawing to two frames per second, because software rendering would use all processors."""


AT_REST = 0.005
"""Maximum share of pixels that may change in an image of an arm at rest."""


BETWEEN_PANELS: Final = {"x": 320.0, "y": 150.0, "width": 460.0, "height": 500.0}
"""Region of the default page that shows the arm and no panels, in pixels."""


class OpenPage:
    """Page in a browser. ``requests`` contains the URLs of all requests of the page."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.clip = BETWEEN_PANELS
        """Region that ``canvas`` captures, in pixels."""
        self.requests: list[str] = []
        page.on("request", lambda request: self.requests.append(request.url))

    def wait_for_text(self, *texts: str) -> None:
        """Wait until the page shows all of these texts."""
        script = "texts => texts.every(text => document.body.innerText.includes(text))"
        self.page.wait_for_function(script, arg=list(texts), timeout=PATIENCE_MS)

    def cells(self, first: str) -> list[str]:
        """Return the cells of the table row whose first cell is ``first``."""
        script = (
            "first => [...document.querySelectorAll('tr')].map(row => [...row.cells].map(cell => cell.innerText))"
            ".find(row => row[0] === first)"
        )
        found: list[str] = self.page.evaluate(script, first)
        return found

    def canvas(self) -> Image.Image:
        """Capture an image of the arm, without the panels."""
        taken = self.page.screenshot(clip=self.clip, timeout=PATIENCE_MS)  # type: ignore[arg-type]
        return Image.open(io.BytesIO(taken)).convert("RGB")

    def canvas_at_rest(self) -> Image.Image:
        """Return the first image that is followed by three equal images, which shows that loading has finished."""
        first, unchanged = self.canvas(), 0
        end = time.monotonic() + PATIENCE_MS / 1000.0
        while unchanged < 3:
            assert time.monotonic() < end, "the image does not come to rest"
            self.page.wait_for_timeout(600)  # longer than one frame (SELDOM)
            after = self.canvas()
            first, unchanged = (first, unchanged + 1) if changed(first, after) < AT_REST else (after, 0)
        return first


def changed(before: Image.Image, after: Image.Image) -> float:
    """Return the share of pixels that differ clearly."""
    return float(different(before, after).mean())


def different(before: Image.Image, after: Image.Image) -> "np.ndarray[tuple[int, int], np.dtype[np.bool_]]":
    """Return whether each pixel (rows, columns) differs clearly."""
    mask: np.ndarray[tuple[int, int], np.dtype[np.bool_]]
    mask = np.asarray(ImageChops.difference(before, after)).max(axis=2) > 40
    return mask


@contextmanager
def open_page(url: str, viewport: Mapping[str, int] = VIEWPORT) -> Iterator[OpenPage]:
    """Open the page in a headless browser."""
    with browser_page(find_chromium(), viewport) as page:
        page.add_init_script(SELDOM)
        shown = OpenPage(page)
        page.goto(url)
        page.wait_for_selector("canvas", timeout=PATIENCE_MS)
        yield shown
