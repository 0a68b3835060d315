"""The three commands of docs/index.md show a moving arm in the browser."""

import os
import re
import signal
import subprocess
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from tests.live.rig import runtime_folder
from tests.pages import ROOT, blocks
from tests.ros.stack_process import PATIENCE_S, until
from tests.view.chromium import changed, find_chromium, open_page
from tests.view.test_page_in_chromium import MOVED, degrees

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(300), pytest.mark.usefixtures("one_browser")]

THREE = blocks("index.md")[0].commands


@pytest.mark.runs(*THREE)
def test_three_commands_lead_to_a_moving_arm_in_the_browser(
    ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    find_chromium()
    log = tmp_path / "log"
    first, second, third = THREE
    script = f"{first} && {second} && exec {third} --out {tmp_path / 'out'}"
    with runtime_folder(monkeypatch), log.open("w") as out:
        environment = {**os.environ, "ROS_DOMAIN_ID": str(ros_domain)}
        with subprocess.Popen(["sh", "-c", script], cwd=ROOT, env=environment, stdout=out, stderr=out) as demo:
            try:
                check_page(log, demo)
            finally:
                demo.send_signal(signal.SIGINT)
                status = demo.wait(PATIENCE_S)
    # On a slow machine, the demo may have ended before the page was opened.
    assert status == 0 or (status == 130 and "interrupted" in log.read_text()), log.read_text()


def check_page(log: Path, demo: "subprocess.Popen[bytes]") -> None:
    """Check that the page is available at the printed address, and that the arm moves in the image and in the
    numbers."""
    address = re.compile(r"the arm in a browser:\s+(http://127\.0\.0\.1:\d+\S*)")

    def ended() -> str:
        return log.read_text() if demo.poll() is not None else ""

    until(lambda: address.search(log.read_text()), ended)
    found = address.search(log.read_text())
    assert found is not None
    with open_page(found[1]) as shown:
        shown.wait_for_text("robot_arm: live", "joint1 (servo 1)")
        before, at = shown.canvas(), degrees(shown, "joint6")
        until(lambda: abs(degrees(shown, "joint6") - at) > 20.0, ended)
        until(lambda: changed(before, shown.canvas()) > MOVED, ended)
