"""The page in a browser shows the motion, the numbers and the faults of a running stack."""

from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest

pytest.importorskip("rclpy")

from servoloop.dashboard.page import Page
from servoloop.dashboard.server import PageServer
from sim_backend.control import ask, control_path
from tests.live.rig import runtime_folder
from tests.ros.stack_process import PICK, arm_client, emulating, running, until
from tests.view.chromium import OpenPage, changed, find_chromium, open_page
from tests.view.view_process import viewing

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(300), pytest.mark.usefixtures("one_browser")]

MOVED = 0.02
"""Share of the image that changes when the arm moves. The arm and its shadow cover more than a tenth of the image."""


@pytest.fixture
def link(ros_domain: int, tmp_path: Path) -> Iterator[Path]:
    """Serve virtual servos, and use a separate folder for the files of running stacks."""
    find_chromium()
    with pytest.MonkeyPatch.context() as patch, runtime_folder(patch), emulating(tmp_path) as link:
        patch.chdir(tmp_path)
        yield link


@pytest.mark.runs("servoloop view")
def test_the_page_shows_the_arm_as_it_moves_and_names_a_silent_servo(link: Path, tmp_path: Path) -> None:
    (tmp_path / "again").mkdir()
    with running(tmp_path, "--port", str(link)) as stack, viewing() as address, open_page(address) as shown:
        shown.wait_for_text("robot_arm: live", "joint1 (servo 1)")
        check_motion(shown)
        check_fault(shown, link)
        stack.end()
        shown.wait_for_text("the stack has stopped. Waiting for it to restart")
        with emulating(tmp_path / "again"), running(tmp_path / "again", "--port", str(tmp_path / "again" / "bus")):
            shown.wait_for_text("robot_arm: live")
            until(lambda: "does not respond" not in shown.page.inner_text("body"))
        check_requests(shown)


def test_a_page_without_a_connection_does_not_report_a_live_robot() -> None:
    server = PageServer(port=0)
    try:
        page = Page(server)
        page.status("so101: live")
        with open_page(server.url) as shown:
            shown.wait_for_text("the connection to servoloop view is lost")
            assert "so101: live" not in shown.page.inner_text("body")
            page.status("so101: live", beat=1)
            shown.wait_for_text("so101: live")
            assert "is lost" not in shown.page.inner_text("body")
    finally:
        server.stop()


def check_motion(shown: OpenPage) -> None:
    """The image changes only when the arm moves, and the numbers reach the goal."""
    before = shown.canvas_at_rest()
    goal_deg = np.degrees(PICK[5])
    assert abs(degrees(shown, "joint6") - goal_deg) > 90.0
    with arm_client() as client:
        client.wait(client.send([0.4, *PICK[1:]]))
    until(lambda: abs(degrees(shown, "joint6") - goal_deg) < 1.0)
    until(lambda: changed(before, shown.canvas()) > MOVED)


def check_fault(shown: OpenPage, link: Path) -> None:
    """The page shows the name of a silent servo and counts its missing answers."""
    assert "does not respond" not in shown.page.inner_text("body")
    ask(control_path(link), {"do": "fault", "text": "silent id=3"})
    shown.wait_for_text("joint3 (servo 3): joint3: servo 3 does not respond")
    until(lambda: "silent" in shown.cells("joint3 (servo 3)")[1])
    assert "does not respond" in shown.cells("joint3")[5]


def check_requests(shown: OpenPage) -> None:
    """The page sends no request to another machine."""
    hosts = {urlsplit(url.removeprefix("blob:")).hostname for url in shown.requests}
    assert hosts == {"127.0.0.1"}, shown.requests


def degrees(shown: OpenPage, joint: str) -> float:
    return float(shown.cells(joint)[1].removesuffix("\u00a0°"))
