"""View of virtual servos without a stack. Any other program can move the servos."""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from sim_backend.control import ask, control_path
from tests.ros.stack_process import until
from tests.view.chromium import find_chromium, open_page
from tests.view.test_page_in_chromium import degrees

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300), pytest.mark.usefixtures("one_browser")]

PATIENCE_S = 60.0


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    find_chromium()
    words = ("emulate", str(tmp_path / "bus"), "--arm", "so101", "--view")
    command = [sys.executable, "-u", "-m", "servoloop", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline().startswith("ready: 6 servos")
            found = re.search(r"the page is at (\S+)", process.stdout.readline())
            assert found is not None
            yield found[1]
        finally:
            process.terminate()
            status = process.wait(PATIENCE_S)
    assert status == 0


@pytest.mark.runs("servoloop emulate ./bus --arm so101 --view")
def test_the_page_shows_a_joint_that_is_moved_by_hand(address: str, tmp_path: Path) -> None:
    with open_page(address) as shown:
        shown.wait_for_text("virtual servos", "elbow_flex")
        ask(control_path(tmp_path / "bus"), {"do": "move", "joints": ["shoulder_pan"], "position": 0.5})
        until(lambda: abs(degrees(shown, "shoulder_pan") - 28.6) < 1.0)
