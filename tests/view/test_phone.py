"""The page on a phone shows the arm above the controls and keeps the stop button visible."""

from collections.abc import Iterator

import numpy as np
import pytest

from servoloop.dashboard.page import Page
from servoloop.dashboard.scene import MEASURED
from servoloop.dashboard.server import PageServer
from tests.recorder.rig import Rig
from tests.view.chromium import OpenPage, different, find_chromium, open_page
from tests.view.rig import watched
from tests.view.test_move_panel import Panel

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300), pytest.mark.usefixtures("one_browser")]

PHONE = {"width": 390, "height": 844}
NOTICE_PX = 150
"""Height of the notice about the missing graphics card, in pixels."""
ARM_PIXELS = 1500
"""Lower bound for the number of pixels that the arm covers."""
STOP = "Stop everything"
SHEET = ".mantine-Paper-root:has(.mantine-ScrollArea-viewport)"
SCROLL = "sheet => { sheet.querySelector('.mantine-ScrollArea-viewport').scrollTop = 400 }"


@pytest.fixture
def server() -> Iterator[PageServer]:
    find_chromium()
    server = PageServer(port=0)
    yield server
    server.stop()


def test_the_arm_is_visible_and_the_stop_button_stays_visible(server: PageServer) -> None:
    rig, page = Rig(), Page(server)
    rig.run(0.2)
    Panel(server)
    page.show_arm(watched(rig))
    page.show_numbers(watched(rig))
    with open_page(server.url, PHONE) as shown:
        shown.wait_for_text(STOP, "Last minute")
        shown.clip = {"x": 0.0, "y": NOTICE_PX, "width": PHONE["width"], "height": sheet_top(shown) - NOTICE_PX}
        check_arm(shown, server)
        check_stop(shown)


def check_arm(shown: OpenPage, server: PageServer) -> None:
    """The whole arm is visible above the controls. The pixels of the arm are those that change when its shapes are
    removed."""
    before = shown.canvas_at_rest()
    server.scene.remove_by_name(MEASURED)
    arm = different(before, shown.canvas_at_rest())
    rows, columns = np.nonzero(arm)
    height, width = arm.shape
    assert arm.sum() > ARM_PIXELS
    assert rows.min() > 0 and rows.max() < height - 1 and columns.min() > 0 and columns.max() < width - 1


def check_stop(shown: OpenPage) -> None:
    """The button can be pressed at the start and after the controls have been scrolled."""
    for scrolled in (False, True):
        if scrolled:
            shown.page.locator(SHEET).first.evaluate(SCROLL)
            assert not in_sight(shown, "text=Color")
        assert in_sight(shown, f"button:has-text('{STOP}')")


def in_sight(shown: OpenPage, selector: str) -> bool:
    """Return whether the center of an element is visible."""
    script = """element => {
        const box = element.getBoundingClientRect();
        const top = document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2);
        return element.contains(top);
    }"""
    found: bool = shown.page.locator(selector).first.evaluate(script)
    return found


def sheet_top(shown: OpenPage) -> float:
    box = shown.page.locator(SHEET).first.bounding_box()
    assert box is not None
    return box["y"]
