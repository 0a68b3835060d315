"""A third-party pick-and-place node on a new stack. When the test is repeated, a cube is on the stand again."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.ros.stack_process import running

pytestmark = pytest.mark.slow


def test_third_party_node_sorts_its_cubes(ros_domain: int, tmp_path: Path) -> None:
    program = Path(__file__).with_name("foreign_pick_place.py")
    with running(tmp_path):
        command = [sys.executable, str(program), "A", "B", "C"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=110)
    assert done.returncode == 0, done.stdout + done.stderr
