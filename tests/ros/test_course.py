"""Follow docs/course.md: its commands in their order, with one stack and one pick-and-place node."""

import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

pytest.importorskip("moveit_msgs")
pytest.importorskip("ompl")

from tests.pages import ROOT, blocks, code
from tests.ros.planned_stack import planning_up
from tests.ros.stack_process import PATIENCE_S, until

pytestmark = pytest.mark.slow

PAGE = "course.md"
SHELLS = [block.commands for block in blocks(PAGE) if block.language == "sh"]
_SET_UP, (UP,), (UP_WITH_FILES,), LOOK, MOVE, (NODE,), (PICK,), ENABLE, READ, (GRADE,), (NO_VISION,), *_REST = SHELLS
SCENE, (PROGRAM, REMOVE), _DEMO, _REAL = _REST
*QUERIES, RATE = LOOK
*PARAMETERS, NODE_WITH_TIME = READ
PROGRAMS = {"servoloop": ["-m", "servoloop"], "ros2": ["-m", "servoloop_ros2"], "python": []}
COMMAND_S = 100.0
EXPECTED = {
    "list_controllers": "arm_controller           joint_trajectory_controller/JointTrajectoryController  active",
    "list_hardware_interfaces": "joint1/position [available] [claimed]",
    "list_hardware_components": "label=active",
    "action list": "/arm_controller/follow_joint_trajectory [control_msgs/action/FollowJointTrajectory]",
    "topic list": "/joint_states [sensor_msgs/msg/JointState]",
    "echo": "position:",
    "send_goal": "Goal finished with status: SUCCEEDED",
    "pub": "publishing #1",
    "enable": "success=True",
    "param list": "bins.A",
    "param get": "Value: [0.4, -0.2, -0.8, -0.6, -1.1, 1.55]",
    "param set": "Set parameter successful",
    "apply_planning_scene": "success=True",
    "scene list": "box: box at 0.250, 0.150",
    "course.py": "the arm is at the ready pose",
    "scene remove": "removed box",
}
"""Expected part of the output, keyed by a part of the command."""


def program_of(command: str) -> list[str]:
    name, *arguments = shlex.split(command)
    return [sys.executable, *PROGRAMS[name], *arguments]


@pytest.fixture(scope="module")
def environment() -> dict[str, str]:
    distributions = [str(ROOT / "integrations" / name) for name in ("moveit_py", "ros2_cli")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *distributions])}


@pytest.fixture(scope="module")
def stack(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with planning_up(tmp_path_factory.mktemp("up"), UP):
        yield


@contextmanager
def running(command: str, log: Path, ready: str, environment: dict[str, str]) -> Iterator[None]:
    """Run a program until the end of the block, from the moment at which its output contains ``ready``."""
    with log.open("w") as out:
        process = subprocess.Popen(program_of(command), stdout=out, stderr=out, cwd=ROOT, env=environment)
    try:
        until(lambda: ready in log.read_text(), lambda: process.poll() is not None and log.read_text())
        yield
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) in (0, 130), log.read_text()


def check(command: str, folder: Path, environment: dict[str, str]) -> None:
    """Run a command to its end, and compare its output with the expected part."""
    done = subprocess.run(
        program_of(command), capture_output=True, text=True, timeout=COMMAND_S, cwd=folder, env=environment
    )
    assert done.returncode == 0, command + done.stdout + done.stderr
    expected = [text for part, text in EXPECTED.items() if part in command]
    assert expected and expected[0] in done.stdout, command + done.stdout


@pytest.mark.runs(UP, *QUERIES, RATE, *MOVE)
def test_stack_is_inspected_and_moved(stack: None, tmp_path: Path, environment: dict[str, str]) -> None:
    for command in (*QUERIES, *MOVE):
        check(command, tmp_path, environment)
    with running(RATE, tmp_path / "rate", "average rate: ", environment):
        pass


@pytest.mark.runs(NODE, PICK, *ENABLE, *PARAMETERS, GRADE, NO_VISION, NODE_WITH_TIME)
@pytest.mark.timeout(240)
def test_node_sorts_by_action_and_by_topic(stack: None, tmp_path: Path, environment: dict[str, str]) -> None:
    node = tmp_path / "node"
    with running(NODE, node, "ready for goals", environment):
        for command in (PICK, *ENABLE, *PARAMETERS, GRADE):
            check(command, tmp_path, environment)
        until(lambda: "bin A" in node.read_text())
        check(NO_VISION, tmp_path, environment)
    with ExitStack() as programs:
        programs.enter_context(running(NODE_WITH_TIME, tmp_path / "slower", "ready for goals", environment))
        check("ros2 param get /vision_pick_place_controller bins.A", tmp_path, environment)


@pytest.mark.runs(*SCENE, PROGRAM, REMOVE, f"{PAGE} python 1")
def test_program_plans_around_the_box(stack: None, tmp_path: Path, environment: dict[str, str]) -> None:
    (tmp_path / "course.py").write_text(code(PAGE, "python"))
    for command in (*SCENE, PROGRAM, REMOVE):
        check(command, tmp_path, environment)


@pytest.mark.runs(UP_WITH_FILES)
def test_stack_starts_with_the_files_of_a_user(ros_domain: int, tmp_path: Path, environment: dict[str, str]) -> None:
    other_domain = {**environment, "ROS_DOMAIN_ID": str(ros_domain + 1)}  # The stack of the other tests is running.
    with running(UP_WITH_FILES, tmp_path / "up", "ready: robot_arm", other_domain):
        pass
