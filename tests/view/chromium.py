"""A browser without a screen, and the page as a person sees it."""

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

from benchmarks.browser import PATIENCE_MS, VIEWPORT, browser_page


def find_chromium() -> str:
    """The path of this machine's Chromium; without one the test is skipped, and fails where a CI must have it."""
    path = shutil.which("chromium")
    if path is None:
        (pytest.fail if os.environ.get("CI") else pytest.skip)("there is no chromium on PATH: apt-get install chromium")
    return str(path)


SELDOM = """
window.requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 500);
window.cancelAnimationFrame = clearTimeout;
"""
"""Two pictures a second: as many as it can draw, a browser without a graphics card fills both processors with."""


AT_REST = 0.005
"""The share of pixels that may change in a picture at rest."""


BETWEEN_PANELS: Final = {"x": 320.0, "y": 150.0, "width": 460.0, "height": 500.0}
"""The pixels of the usual page on which the arm is drawn and no panel is."""


class OpenPage:
    """A page in a browser; ``requests`` are all that it has asked for."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.clip = BETWEEN_PANELS
        """The pixels that ``canvas`` takes."""
        self.requests: list[str] = []
        page.on("request", lambda request: self.requests.append(request.url))

    def wait_for_text(self, *texts: str) -> None:
        """Wait until the page has all of these texts."""
        script = "texts => texts.every(text => document.body.innerText.includes(text))"
        self.page.wait_for_function(script, arg=list(texts), timeout=PATIENCE_MS)

    def cells(self, first: str) -> list[str]:
        """The row of a table that begins so."""
        script = (
            "first => [...document.querySelectorAll('tr')].map(row => [...row.cells].map(cell => cell.innerText))"
            ".find(row => row[0] === first)"
        )
        found: list[str] = self.page.evaluate(script, first)
        return found

    def canvas(self) -> Image.Image:
        """Take a picture of the arm, without the panels."""
        taken = self.page.screenshot(clip=self.clip, timeout=PATIENCE_MS)  # type: ignore[arg-type]
        return Image.open(io.BytesIO(taken)).convert("RGB")

    def canvas_at_rest(self) -> Image.Image:
        """The first picture after which nothing changes for three more: loading, notices and the camera are done."""
        first, unchanged = self.canvas(), 0
        end = time.monotonic() + PATIENCE_MS / 1000.0
        while unchanged < 3:
            assert time.monotonic() < end, "the picture does not come to rest"
            self.page.wait_for_timeout(600)  # longer than one picture takes (SELDOM)
            after = self.canvas()
            first, unchanged = (first, unchanged + 1) if changed(first, after) < AT_REST else (after, 0)
        return first


def changed(before: Image.Image, after: Image.Image) -> float:
    """The share of pixels that are clearly different."""
    return float(different(before, after).mean())


def different(before: Image.Image, after: Image.Image) -> "np.ndarray[tuple[int, int], np.dtype[np.bool_]]":
    """Whether each pixel (rows, columns) is clearly different."""
    mask: np.ndarray[tuple[int, int], np.dtype[np.bool_]]
    mask = np.asarray(ImageChops.difference(before, after)).max(axis=2) > 40
    return mask


@contextmanager
def open_page(url: str, viewport: Mapping[str, int] = VIEWPORT) -> Iterator[OpenPage]:
    """The page in a browser without a screen and without a graphics card."""
    with browser_page(find_chromium(), viewport) as page:
        page.add_init_script(SELDOM)
        shown = OpenPage(page)
        page.goto(url)
        page.wait_for_selector("canvas", timeout=PATIENCE_MS)
        yield shown
