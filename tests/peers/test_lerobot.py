"""LeRobot's Dynamixel bus class on virtual servos, with the settings that LeRobot gives a Koch.

LeRobot has an environment of its own.
"""

import subprocess

import pytest

from tests.integrations.lerobot.environment import lerobot_environment
from tests.peers.conftest import Serve
from tests.peers.waiting import ROOT

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
MODELS = ("xl430-w250",) * 2 + ("xl330-m288",) * 4


def test_a_koch_with_lerobots_settings_keeps_its_calibration_and_reaches_its_goals(serve: Serve) -> None:
    link = serve(",".join(MODELS), *range(1, 7))
    program = [str(lerobot_environment() / "bin" / "python"), "tests/peers/lerobot_koch.py", link]
    done = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, timeout=300.0)
    assert (done.returncode, done.stdout) == (0, "the Koch has reached its goals\n"), done.stderr
