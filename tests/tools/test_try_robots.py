"""Tests of the tool that tries robots of others on mock hardware."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from servoloop.stack.shipped_files import CONTROLLERS, URDF
from tests.pages import ROOT, commands

COMMAND = "python tools/try_robots.py robots"


@pytest.mark.slow
@pytest.mark.runs(COMMAND)
def test_robots_come_up_or_are_refused_with_the_message(tmp_path: Path) -> None:
    assert commands("public-robots.md") == [COMMAND]
    for name, text in (("good", URDF.read_text()), ("bad", URDF.read_text().replace("joint3", "joint9", 1))):
        (tmp_path / name).mkdir()
        (tmp_path / name / "robot.urdf").write_text(text)
        shutil.copy(CONTROLLERS, tmp_path / name / "controllers.yaml")
    tool = [sys.executable, str(ROOT / "tools" / "try_robots.py"), str(tmp_path)]
    done = subprocess.run(tool, capture_output=True, text=True, timeout=100)
    bad, good = done.stdout.splitlines()
    assert good == "good: starts" and bad.startswith("bad: ") and "joint3" in bad
    assert done.returncode == 0 and "1 of 2 started" in done.stderr
