"""Manual motion over the command socket, without ROS: jogging, poses, and what prevents a motion."""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from hal.types import JointLimits
from servoloop.cli import app
from servoloop.command_socket.command_errors import CommandError
from servoloop.manual.joints_now import HandlingError
from servoloop.manual.poses import Poses
from servoloop.manual.robot import LiveRobot
from servoloop.manual.robot_client import RobotClient
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.robot_files import Files
from servoloop.stack.shipped_files import ARMS
from tests.command_socket.rig import SocketRig, served
from tests.command_socket.test_bad_clients import at_rest
from tests.pages import commands
from tests.servoloop.served import eventually
from tests.stack.rig import READY

JOINT, TICK_S = "joint1", 0.02


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[SocketRig]:
    with served(monkeypatch, files(tmp_path)) as rig:
        yield rig


def files(folder: Path) -> Files:
    """Files of an arm whose poses are stored in a folder of the test."""
    (folder / "mine").mkdir()
    (folder / "mine" / "arm.yaml").write_text(f"description: mine\nlike: {ARMS / 'robot_arm'}\n")
    return read_arm_files(find_arm(f"{folder}/mine"))


@contextmanager
def mover(rig: SocketRig, name: str = "test") -> Iterator[RobotClient]:
    with LiveRobot.find() as robot, rig.client(name) as socket:
        robot.wait()
        client = RobotClient(socket, robot)
        client.connect()
        yield client


def hold(client: RobotClient, joint: str, share: float = 1.0, ticks: int = 20) -> None:
    """Jog a joint for some time."""
    for _ in range(ticks):
        client.jog(joint, share)
        time.sleep(TICK_S)


def test_joint_and_hand_move_only_while_commanded(rig: SocketRig) -> None:
    with mover(rig) as client:
        assert client.joints == ("joint1", "joint2", "joint3", "joint4", "joint5", "joint6", "hand_right_joint")
        for joint in (JOINT, "hand_right_joint"):
            at = rig.stack.loop.hardware.joints.index(joint)
            before = rig.stack.loop.command[at]
            hold(client, joint)
            at_rest(rig)
            assert before + 0.003 < rig.stack.loop.command[at] < before + 0.25 * (20 * TICK_S + 2.0)


def test_running_goal_of_another_program_is_not_replaced_and_stop_cancels_it(rig: SocketRig) -> None:
    with mover(rig) as client, rig.client("other") as other:
        goal = rig.stack.go(READY, 3000.0)
        eventually(lambda: rig.stack.arm.newest_goal is goal)
        with pytest.raises(HandlingError, match="arm_controller is executing a goal: stop the goal first"):
            hold(client, JOINT)
        other.request("stop")
        eventually(lambda: goal.done)
        client.listen()
        hold(client, JOINT)
        assert rig.positions()[0] > 0.01


def test_one_program_at_a_time_moves_the_arm(rig: SocketRig) -> None:
    with mover(rig, "first") as first, mover(rig, "second") as second:
        hold(first, JOINT)
        with pytest.raises(HandlingError, match=r"first \(process \d+\) has control of the arm"):
            second.jog(JOINT, 1.0)

        def free() -> bool:
            first.listen()
            try:
                second.jog(JOINT, 1.0)
            except HandlingError:
                return False
            return True

        eventually(free)
        second.stop()
        first.jog(JOINT, 1.0)


def test_deactivated_controller_is_named_and_others_still_move(rig: SocketRig) -> None:
    with mover(rig) as client, rig.client() as other:
        other.request("take")
        other.request("switch", deactivate=["arm_controller"])
        other.request("release")
        eventually(lambda: client.listen() or JOINT not in client.joints)
        with pytest.raises(HandlingError, match=f"no active controller moves {JOINT}: activate arm_controller"):
            client.jog(JOINT, 0.1)
        client.jog("hand_right_joint", 0.1)
        with pytest.raises(HandlingError, match="no active controller moves joint9"):
            client.approach({"joint9": 0.0})


def test_pose_is_reached_within_the_limits(rig: SocketRig) -> None:
    with mover(rig) as client:
        pose = {JOINT: 0.1, "joint6": READY[5] - 0.1}
        eventually(lambda: client.approach(pose) or time.sleep(TICK_S))
        at = at_rest(rig)
    np.testing.assert_allclose([at[0], at[5]], list(pose.values()), atol=0.01)


def test_joint_without_a_measurement_does_not_move(rig: SocketRig) -> None:
    class Silent:
        limits = dict.fromkeys(rig.stack.loop.hardware.joints, JointLimits(-1.0, 1.0, 2.0, 9.0, 9.0))

        def joints_now(self) -> object:
            return replace(robot.joints_now(), age_s=1.0)

    with LiveRobot.find() as robot, rig.client() as socket:
        robot.wait()
        client = RobotClient(socket, Silent())  # type: ignore[arg-type]
        client.connect()
        with pytest.raises(HandlingError, match="the joint positions are outdated"):
            client.jog(JOINT, 1.0)


def test_the_end_of_the_stack_ends_the_motion(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with served(monkeypatch, files(tmp_path)) as rig, LiveRobot.find() as robot:
        robot.wait()
        client = RobotClient(rig.client(), robot)
        client.connect()
    with pytest.raises(CommandError, match="the connection to the stack of mine has ended"):
        client.jog(JOINT, 1.0)


def without_ros(*words: str) -> "subprocess.CompletedProcess[str]":
    """Run a command in a process that finds no rclpy."""
    command = [sys.executable, "-m", "tests.servoloop.without", "ros", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=60.0, cwd=Path(__file__).parents[2])


def printed(*words: str) -> str:
    """Run a command that succeeds, and return its output."""
    ran = CliRunner().invoke(app, words)
    assert ran.exit_code == 0, ran.output
    return ran.stdout


def test_saved_poses_and_motions_are_those_of_the_running_arm(rig: SocketRig) -> None:
    folder = rig.stack.files.folder
    assert folder is not None
    assert printed("pose", "list") == f"no poses are saved in {folder}/poses.yaml\n"
    assert printed("teach", "list") == f"no motions are saved in {folder}\n"
    printed("pose", "save", "here")
    assert (
        printed("pose", "list")
        == printed("pose", "list", "--arm", "mine")
        == printed("pose", "list", "--arm", str(folder))
    )
    assert printed("pose", "list").startswith("here: joint1 ")
    assert printed("pose", "remove", "here") == "here was removed\n" and not Poses(folder).all()
    assert "shoulder_pan" not in printed("pose", "list", "--arm", "so101"), "an arm whose stack does not run"


@pytest.mark.runs("servoloop stop")
def test_commands_move_and_stop_the_arm_without_ros(rig: SocketRig) -> None:
    folder = rig.stack.files.folder
    assert folder is not None and "servoloop stop" in commands("handling.md")
    Poses(folder).save("aside", {JOINT: 0.05})
    done = without_ros("pose", "go", "aside")
    assert (done.returncode, done.stdout) == (0, "mine is at aside\n"), done.stderr
    assert at_rest(rig)[0] == pytest.approx(0.05, abs=0.01)
    goal = rig.stack.go([0.5, *READY[1:]], 3000.0)
    done = without_ros("stop")
    assert (done.returncode, done.stdout) == (0, "all motions of mine were stopped\n"), done.stderr
    eventually(lambda: goal.done)
