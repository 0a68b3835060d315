"""Joints of a stack that also serves ROS clients move only while a program keeps commanding them."""

import os
import pty
import re
import shlex
import signal
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")

from action_msgs.msg import GoalStatus
from controller_manager_msgs.srv import SwitchController

from controller.guided_motion import HORIZON_S
from hal.types import JointLimits
from nodes.clients.client_node import client_node
from servoloop.command_socket.client import CommandClient
from servoloop.manual.joints_now import HandlingError, JointsNow, MovableRobot
from servoloop.manual.robot import LiveRobot
from servoloop.manual.robot_client import SLOW, RobotClient
from servoloop.stack.shipped_files import ARMS
from tests.live.rig import runtime_folder
from tests.pages import commands
from tests.ros.stack_process import PICK, READY, arm_client, emulating, running, until

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(300)]

JOINT = "joint1"
UP, JOG, STOP, *POSES = commands("handling.md")


@pytest.fixture(scope="module")
def stack(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    folder = tmp_path_factory.mktemp("handling")
    with pytest.MonkeyPatch.context() as patch, runtime_folder(patch), emulating(folder) as link:
        patch.chdir(folder)
        (folder / "my_arm").mkdir()
        (folder / "my_arm" / "arm.yaml").write_text(f"description: mine\nlike: {ARMS / 'robot_arm'}\n")
        up, port, _ = shlex.split(UP)[1:]
        assert up == "up"
        with running(folder, port, str(link), "--arm", "my_arm"):
            with arm_client() as arm:
                arm.wait(arm.send(READY))  # The arm has sunk without torque.
            yield


@pytest.fixture
def robot(stack: None) -> Iterator[LiveRobot]:
    with LiveRobot.find() as robot:
        robot.wait()
        yield robot


@contextmanager
def client(robot: MovableRobot) -> Iterator[RobotClient]:
    with CommandClient.find(name="test") as commands:
        made = RobotClient(commands, robot)
        made.connect()
        yield made


def at(robot: LiveRobot, joint: str = JOINT) -> float:
    now = robot.snapshot
    return float(now.position[now.joints.index(joint)])


def standstill(robot: LiveRobot) -> None:
    """Wait until all commanded velocities are zero."""
    last: list[bytes] = []

    def still() -> bool:
        last.append(robot.snapshot.command.tobytes())
        time.sleep(0.1)
        return len(last) > 5 and len(set(last[-5:])) == 1

    until(still)


def hold_on(moving: RobotClient, joint: str) -> None:
    """Move the joint a short distance. The motion is repeated if a slow machine has interrupted it."""
    try:
        moving.jog(joint, 1.0)
    except HandlingError as error:
        if "the load of this computer" not in str(error):
            raise


def test_joint_and_hand_move_only_while_commanded(robot: LiveRobot) -> None:
    with client(robot) as moving:
        assert moving.joints == ("joint1", "joint2", "joint3", "joint4", "joint5", "joint6", "hand_right_joint")
        for joint in (JOINT, "hand_right_joint"):
            before, began_s = at(robot, joint), robot.curves.time_s[-1]
            for _ in range(30):
                hold_on(moving, joint)
                time.sleep(0.04)
            standstill(robot)
            assert at(robot, joint) > before + 0.003
            assert speed(robot, joint, began_s) <= 1.6 * SLOW, "slightly faster after a late set point"


def speed(robot: LiveRobot, joint: str, since_s: float) -> float:
    """Return the maximum commanded speed of a joint, averaged over five cycles."""
    curves, number = robot.curves, robot.snapshot.joints.index(joint)
    mine = curves.time_s > since_s
    time_s, command = curves.time_s[mine], curves.command[mine, number]
    return float((np.abs(command[5:] - command[:-5]) / (time_s[5:] - time_s[:-5])).max())


def test_running_goal_is_not_replaced_and_stop_ends_it(robot: LiveRobot) -> None:
    with client(robot) as moving, arm_client() as arm:
        future = arm.send([at(robot) + 0.3, *PICK[1:]], 30)
        with pytest.raises(HandlingError, match="arm_controller is executing a goal: stop the goal first"):
            for _ in range(40):
                time.sleep(0.05)
                moving.jog(JOINT, 0.01)
        moving.stop()
        assert arm.wait(future).status == GoalStatus.STATUS_ABORTED  # type: ignore[attr-defined]
        before = at(robot)
        for _ in range(30):
            with suppress(HandlingError):  # until the status reports the end of the goal
                moving.jog(JOINT, -1.0)
            time.sleep(0.04)
        standstill(robot)
        assert at(robot) < before - 0.05, "after the goal the arm can be moved again"


def test_deactivated_controller_is_named_and_others_still_move(robot: LiveRobot) -> None:
    def switch(**lists: list[str]) -> None:
        answer = service.call_async(SwitchController.Request(strictness=2, **lists))
        executor.spin_until_future_complete(answer, 20.0)
        assert answer.result().ok

    def named() -> bool:
        try:
            moving.jog(JOINT, 0.1)
        except HandlingError as error:
            assert str(error) == f"no active controller moves {JOINT}: activate arm_controller"
            return True
        time.sleep(0.04)
        return False

    def moves() -> bool:
        with suppress(HandlingError):
            moving.jog(JOINT, 0.1)
            return True
        time.sleep(0.04)
        return False

    with client_node("test_handling") as (node, executor), client(robot) as moving:
        service = node.create_client(SwitchController, "/controller_manager/switch_controller")
        assert service.wait_for_service(20.0)
        moving.jog(JOINT, 0.1)
        switch(deactivate_controllers=["arm_controller"])
        try:
            until(named)
            moving.jog("hand_right_joint", 0.1)
            with pytest.raises(HandlingError, match="activate arm_controller"):
                moving.approach({JOINT: 0.0})
        finally:
            switch(activate_controllers=["arm_controller"])
        until(moves)


class Faulty:
    """A robot whose servo faults include one more fault."""

    def __init__(self, robot: LiveRobot) -> None:
        self._robot = robot

    @property
    def limits(self) -> Mapping[str, JointLimits]:
        return self._robot.limits

    def joints_now(self) -> JointsNow:
        return replace(self._robot.joints_now(), faults={"joint2": "servo 2 has lost its torque"})


def test_faulty_joint_is_named_and_its_controller_does_not_move(robot: LiveRobot) -> None:
    with client(Faulty(robot)) as moving:
        with pytest.raises(HandlingError, match="joint2: servo 2 has lost its torque"):
            moving.jog(JOINT, 1.0)
        moving.jog("hand_right_joint", 1.0)  # The hand belongs to another controller.


def test_saved_pose_is_reached_and_invalid_poses_are_refused(robot: LiveRobot, tmp_path: Path) -> None:
    with client(robot) as moving:
        pose = {JOINT: at(robot) + 0.2, "joint6": at(robot, "joint6") - 0.2}
        until(lambda: moving.approach(pose) or time.sleep(0.04))
        standstill(robot)
        assert at(robot) == pytest.approx(pose[JOINT], abs=0.02)
        with pytest.raises(HandlingError, match="no active controller moves joint9"):
            moving.approach({"joint9": 0.0})


def servoloop(words: str, *more: str) -> subprocess.CompletedProcess[str]:
    """Run a command of the documentation page to its end."""
    return subprocess.run(
        [sys.executable, "-m", *shlex.split(words), *more], capture_output=True, text=True, timeout=120.0, check=False
    )


@pytest.mark.runs(UP, *POSES)
def test_pose_commands_save_go_list_and_forget(robot: LiveRobot) -> None:
    save, list_, go, remove = POSES
    saved = at(robot)
    done = servoloop(save)
    assert (done.returncode, done.stdout) == (0, "over_the_box: 7 joints of my_arm\n"), done.stderr
    with client(robot) as moving:
        until(lambda: moving.approach({JOINT: saved + 0.2}) or time.sleep(0.04))
    standstill(robot)
    done = servoloop(go)
    assert (done.returncode, done.stdout) == (0, "my_arm is at over_the_box\n"), done.stderr
    standstill(robot)
    assert at(robot) == pytest.approx(saved, abs=0.02)
    listed = re.match(r"over_the_box: joint1 (\S+), joint2 ", servoloop(list_, "--arm", "my_arm").stdout)
    assert listed and float(listed[1]) == pytest.approx(saved, abs=0.005)
    assert servoloop(remove, "--arm", "my_arm").stdout == "over_the_box was removed\n"
    lost = servoloop(go)
    assert lost.returncode == 1 and "there is no pose over_the_box in" in lost.stderr


def test_arm_stops_when_the_moving_program_is_killed(robot: LiveRobot) -> None:
    program = (
        "import time\n"
        "from tests.handling.test_handling_over_ros import LiveRobot, client\n"
        "with LiveRobot.find() as robot:\n"
        "    robot.wait()\n"
        "    with client(robot) as moving:\n"
        "        while True:\n"
        "            moving.jog('joint1', -1.0)\n"
        "            print('.', flush=True)\n"
        "            time.sleep(0.04)\n"
    )
    before = at(robot)
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as process:
        until(lambda: at(robot) < before - 0.1, lambda: process.poll())
        process.send_signal(signal.SIGKILL)
    killed = at(robot)
    standstill(robot)
    assert killed - at(robot) <= SLOW * (HORIZON_S + 0.5), (
        "the arm rests before its last set point, because the feed is late"
    )


class Screen:
    """Output of a program in a terminal. The output is read continuously, so that a full terminal cannot block the
    program."""

    def __init__(self, terminal: int) -> None:
        self.shown = b""
        self._terminal = terminal
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        with suppress(OSError):  # The terminal is closed.
            while text := os.read(self._terminal, 65536):
                self.shown += text


@pytest.mark.runs(STOP)
def test_stop_ends_a_goal_of_a_ros_client(robot: LiveRobot) -> None:
    with arm_client() as arm:
        future = arm.send([at(robot) + 0.3, *PICK[1:]], 30)
        done = servoloop(STOP)
        assert (done.returncode, done.stdout) == (0, "all motions of my_arm were stopped\n"), done.stderr
        assert arm.wait(future).status == GoalStatus.STATUS_ABORTED  # type: ignore[attr-defined]


@pytest.mark.runs(JOG)
def test_jog_in_a_terminal_moves_and_stops(robot: LiveRobot) -> None:
    """A repeating key moves the joint, a released key stops it, and q quits and restores the terminal."""
    ours, theirs = pty.openpty()
    before, modes = at(robot), termios.tcgetattr(theirs)
    screen = Screen(ours)
    command = [sys.executable, "-m", *shlex.split(JOG)]
    with subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs) as jog:

        def ended() -> str:
            return screen.shown.decode() if jog.poll() is not None else ""

        def press() -> bool:
            os.write(ours, b"\x1b[C")
            time.sleep(0.05)
            return at(robot) > before + 0.1

        try:
            until(lambda: b"hold left or right" in screen.shown, ended)
            until(press, ended)
            standstill(robot)
            os.write(ours, b"q")
            assert jog.wait(20.0) == 0
        finally:
            jog.kill()
    assert termios.tcgetattr(theirs) == modes
    os.close(theirs)
    os.close(ours)
