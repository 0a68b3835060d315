"""Tests of unmodified programs of other projects, which were written for MoveIt, with the plan server."""

import json
import subprocess
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("moveit_msgs")

from nodes.namespace import namespace_arguments
from tests.pages import blocks
from tests.ros.planned_stack import planned_stack, program

pytestmark = [pytest.mark.ros, pytest.mark.slow]

CLIENTS = Path(__file__).parent / "moveit_clients"
SUCCESS = 1
(RENAMING,) = (block.commands for block in blocks("several-arms.md") if "--ros-args $rules" in block.text)
"""Command lines that start a program in the namespace ``/left``. The names in this program begin with a slash."""


@pytest.fixture(scope="module")
def arguments(ros_domain: int, tmp_path_factory: pytest.TempPathFactory, namespace: str) -> Iterator[list[str]]:
    """Run a planned stack, and yield the ROS arguments of its clients."""
    with planned_stack(tmp_path_factory.mktemp("planned"), "--hardware", "mock", namespace=namespace):
        yield namespace_arguments(namespace)


@pytest.mark.parametrize("namespace", ["", "/left"], scope="module")
def test_pymoveit2_plans_moves_and_changes_the_scene(arguments: list[str]) -> None:
    pytest.importorskip("pymoveit2")
    found = json.loads(program(str(CLIENTS / "drive_pymoveit2.py"), *arguments).splitlines()[-1])
    assert found.pop("distance to the pose, m") < 0.002
    assert found.pop("height of the line, m") == pytest.approx(0.03, abs=0.002)
    assert -0.6419 < found.pop("joint3 after the cancel") < -0.01
    assert "GOAL_IN_COLLISION" in found.pop("reason")
    assert found.pop("goal inside the wall") is False
    assert found.pop("canceled motion") is False
    assert all(found.values()), found


def remapped() -> list[str]:
    """Return the ROS arguments of the page for a program whose names start with a slash."""
    lines = "\n".join([*RENAMING[:-1], RENAMING[-1].replace("python program.py", "echo")])
    return subprocess.run(["sh", "-c", lines], capture_output=True, text=True, check=True).stdout.split()


@pytest.mark.runs(*RENAMING)
@pytest.mark.parametrize("namespace", ["", "/left"], scope="module")
def test_moveit2_commander_plans_moves_and_changes_the_scene(arguments: list[str], namespace: str) -> None:
    if find_spec("moveit2_commander") is None:
        pytest.skip("moveit2_commander is not installed")
    rules = remapped() if namespace else []
    found = json.loads(program(str(CLIENTS / "drive_moveit2_commander.py"), *rules).splitlines()[-1])
    assert found == {
        "joint goal": SUCCESS,
        "scaled trajectory": SUCCESS,
        "added": True,
        "goal inside the wall": False,
        "removed": True,
        "attached": True,
        "line": SUCCESS,
        "detached": True,
    }
