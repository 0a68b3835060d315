"""Run commands with ``--arm`` for arms other than the default arm, in real processes over ROS."""

import json
from pathlib import Path

import pytest
from sensor_msgs.msg import JointState

from servoloop.stack.arm_folders import find_arm
from servoloop.stack.pick_place import load_pick_place
from tests.ros.stack_process import StackProcess, until
from tests.ros.trajectory_client import REACHED, SUCCEEDED, TrajectoryClient, goal_of, point, trajectory
from tests.ros.trajectory_stacks import client_of

pytestmark = pytest.mark.slow

DEMO_S = 180.0
INTERRUPTED = 130


def page(arm: str) -> tuple[str, str]:
    """Return the commands of an arm's page. The demo starts a second stack of its own, on a virtual port."""
    return f"servoloop demo --arm {arm}", f"servoloop up --arm {arm} --port /dev/ttyACM0"


def start(folder: Path, arm: str) -> StackProcess:
    """Run the demo with one cube."""
    return StackProcess(folder / "demo.log", "demo", "--arm", arm, "--grades", "C", "--out", str(folder / "out"))


def test_so101_in_mujoco_reaches_a_goal(ros_domain: int, tmp_path: Path) -> None:
    poses_file = load_pick_place(find_arm("so101").pick_place)
    with client_of(tmp_path, "--arm", "so101", "--hardware", "mujoco") as client:
        assert _reached(client, poses_file.joints, poses_file.poses.ready)


def _reached(client: TrajectoryClient, joints: tuple[str, ...], pose: tuple[float, ...]) -> bool:
    states: list[JointState] = []
    client.node.create_subscription(JointState, "/joint_states", states.append, 10)
    outcome = client.outcome(client.send(goal_of(trajectory(point(list(pose), 2.0), names=list(joints)))))
    assert outcome == (SUCCEEDED, 0, REACHED), client.stack.words
    return set(states[-1].name) == {*joints, "gripper"}


@pytest.mark.runs(*page("so101"))
def test_demo_sorts_a_cube_with_an_so101(ros_domain: int, tmp_path: Path) -> None:
    demo = start(tmp_path, "so101")
    assert demo.process.wait(DEMO_S) == 0, demo.words
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["cubes"] == {"in_their_bins": 1, "of": 1}
    assert (tmp_path / "out" / "arm.png").exists()


@pytest.mark.runs(*page("so100"), *page("koch"))
@pytest.mark.parametrize("arm", ["so100", "koch"])
def test_demo_starts_with_a_cube_in_its_bin(arm: str, ros_domain: int, tmp_path: Path) -> None:
    demo = start(tmp_path, arm)
    try:
        until(lambda: "cube in bin C" in demo.words, lambda: demo.process.poll() is not None and demo.words)
    finally:
        assert demo.end() == INTERRUPTED, demo.words
