"""The program of the MoveIt course, and ``servoloop goto`` and ``scene``, with the plan server."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("moveit_msgs")

from nodes.planning_client.scene_watch import SceneWatch
from planning.scene import Sphere
from tests.pages import ROOT
from tests.ros.planned_stack import planned_stack, program, servoloop
from tests.ros.stack_process import until

COURSE = Path(__file__).with_name("moveit_course.py")
MOVEIT_PY = str(ROOT / "integrations" / "moveit_py")


@pytest.fixture(scope="module")
def stack(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with planned_stack(tmp_path_factory.mktemp("planned"), "--hardware", "mock"):
        yield


def test_program_of_the_course_moves_arm_and_hand(stack: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", ":".join([MOVEIT_PY, *sys.path[1:]]))
    assert program(str(COURSE)).splitlines()[-1] == "arm: True, pose: True, hand: True"


@pytest.mark.slow
def test_goto_moves_the_tool_or_names_the_reason(stack: None) -> None:
    moved = servoloop("goto", "0.25", "-0.05", "0.3")
    assert (moved.returncode, moved.stdout.partition(";")[0]) == (0, "done: the tool is at the pose"), moved.stderr
    planned = servoloop("goto", "0.25", "0.05", "0.3", "--plan-only")
    assert planned.stdout.startswith("a motion is possible; "), planned.stderr
    refused = servoloop("goto", "3", "0", "0")
    assert refused.returncode == 1
    assert "NO_IK_SOLUTION" in refused.stderr
    assert "Traceback" not in refused.stderr
    assert "frame" in servoloop("goto", "0.2", "0", "0.3", "--frame", "moon").stderr


@pytest.mark.slow
def test_scene_is_listed_and_changed(stack: None, tmp_path: Path) -> None:
    added = servoloop("scene", "add", "wall", "box", "0.1", "0.1", "0.4", "--at", "0.3", "-0.1", "0.2")
    assert added.stdout == "added wall\n", added.stderr
    listed = servoloop("scene", "list").stdout
    assert "wall: box at 0.300, -0.100, 0.200 in base_link" in listed
    assert "stand" in listed
    inside = servoloop("goto", "0.3", "-0.1", "0.2", "--plan-only")
    assert inside.returncode == 1
    assert "wall" in inside.stderr
    assert servoloop("scene", "remove", "wall").returncode == 0
    unknown = servoloop("scene", "remove", "wall")
    assert unknown.returncode == 1
    assert "the scene has no object wall; its objects: " in unknown.stderr
    bench = tmp_path / "bench.yaml"
    bench.write_text("objects:\n  cup: {position_m: [0.2, 0.3, 0.05], cylinder: {height_m: 0.1, radius_m: 0.04}}\n")
    assert servoloop("scene", "load", str(bench)).stdout == "added cup\n"
    assert "cup: cylinder at 0.200, 0.300, 0.050" in servoloop("scene", "list").stdout
    assert servoloop("scene", "remove", "cup").returncode == 0


@pytest.mark.slow
def test_view_gets_the_scene_and_the_plans(stack: None) -> None:
    watch = SceneWatch()
    watch.start()
    try:
        until(lambda: "stand" in {item.name for item in watch.newest.items})
        assert servoloop("scene", "add", "lamp", "sphere", "0.05", "--at", "-0.2", "0.3", "0.3").returncode == 0
        until(lambda: "lamp" in {item.name for item in watch.newest.items})
        (lamp,) = (item for item in watch.newest.items if item.name == "lamp")
        ((shape, pose),) = lamp.shapes
        assert (shape, lamp.link) == (Sphere(0.05), "")
        assert pose.position_m == pytest.approx([-0.2, 0.3, 0.3])
        assert servoloop("goto", "0.25", "0.1", "0.3").returncode == 0
        until(lambda: watch.newest.plan is not None)
        assert watch.newest.plan is not None
        assert set(watch.newest.plan.joints) == {f"joint{number}" for number in range(1, 7)}
        assert servoloop("scene", "remove", "lamp").returncode == 0
        until(lambda: "lamp" not in {item.name for item in watch.newest.items})
    finally:
        watch.close()
