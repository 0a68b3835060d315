"""The node of docs/write-a-node.md moves the arm of ``servoloop up``."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.pages import code, commands
from tests.ros.stack_process import running

pytestmark = pytest.mark.slow

PAGE = "write-a-node.md"
OFF_RAD = 0.06


@pytest.mark.runs(*commands(PAGE), f"{PAGE} python 1")
def test_node_of_the_page_moves_the_arm(ros_domain: int, tmp_path: Path) -> None:
    assert commands(PAGE) == ["servoloop up", "python swing.py"]
    (tmp_path / "swing.py").write_text(code(PAGE, "python"))
    node = [sys.executable, "swing.py"]
    with running(tmp_path):
        done = subprocess.run(node, cwd=tmp_path, capture_output=True, text=True, timeout=90.0, check=False)
    assert done.returncode == 0, done.stderr
    reports = re.findall(r"joint1 was sent to (\S+) rad and is at (\S+)", done.stdout)
    assert [float(target) for target, _ in reports] == [0.5, -0.5, 0.0]
    assert all(abs(float(target) - float(measured)) < OFF_RAD for target, measured in reports), done.stdout


def test_node_without_a_stack_names_the_command_to_start(ros_domain: int, tmp_path: Path) -> None:
    text = code(PAGE, "python").replace("timeout_sec=10.0", "timeout_sec=0.5")
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, timeout=60.0, check=False)
    assert done.returncode == 1 and "start servoloop up" in done.stderr
