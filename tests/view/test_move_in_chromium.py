"""Buttons of the page in a browser move the arm of a running stack while they are held."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")

from action_msgs.msg import GoalStatus

from servoloop.manual.buttons import LONGEST_S
from servoloop.manual.poses import Poses
from servoloop.manual.robot import LiveRobot
from servoloop.manual.robot_client import SLOW
from servoloop.stack.shipped_files import ARMS
from sim_backend.control import ask, control_path
from tests.live.rig import runtime_folder
from tests.ros.stack_process import PATIENCE_S, PICK, READY, ArmClient, arm_client, emulating, running, until
from tests.view.chromium import OpenPage, find_chromium, open_page
from tests.view.view_process import viewing

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(300), pytest.mark.usefixtures("one_browser")]

ON, BACK = "Move (+)", "Move (−)"
AGAIN_S = 9.0
SPEED = 0.5 * SLOW
"""Speed at the default setting of the slider."""


@pytest.fixture
def link(ros_domain: int, tmp_path: Path) -> Iterator[Path]:
    """Serve virtual servos in a folder with an arm that has a saved pose."""
    find_chromium()
    with pytest.MonkeyPatch.context() as patch, runtime_folder(patch), emulating(tmp_path) as link:
        patch.chdir(tmp_path)
        (tmp_path / "mine").mkdir()
        (tmp_path / "mine" / "arm.yaml").write_text(f"description: mine\nlike: {ARMS / 'robot_arm'}\n")
        Poses(tmp_path / "mine").save("aside", {"joint1": 0.3})
        yield link


def test_the_arm_moves_while_a_button_is_held(link: Path, tmp_path: Path) -> None:
    stack = running(tmp_path, "--port", str(link), "--arm", "mine")
    with stack, LiveRobot.find() as robot, viewing() as address, arm_client() as arm:
        robot.wait()
        arm.wait(arm.send(READY))
        with open_page(address) as shown:
            shown.page.wait_for_selector(f"button:has-text('{ON}'):enabled", timeout=60_000.0)
            check_held_and_let_go(shown, robot)
            check_pose_and_hand(shown, robot)
            check_page_that_is_left(shown, robot)
            check_stop(shown, robot, arm)
            hold(shown, BACK, moved(robot, by=-0.05))
        resting(robot)  # the browser is closed now
        with open_page(address) as shown:
            check_fault(shown, robot, link)


def at(robot: LiveRobot, joint: str = "joint1") -> float:
    now = robot.snapshot
    return float(now.position[now.joints.index(joint)])


def hold(shown: OpenPage, label: str, ready: Callable[[], bool]) -> None:
    """Press a button until ``ready`` returns True, and keep it pressed.

    If the press ends, press again as a user would, because servos may miss cycles on a busy machine.
    """
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        shown.page.get_by_role("button", name=label, exact=True).hover()
        shown.page.mouse.down()
        again_s = time.monotonic() + AGAIN_S
        while time.monotonic() < again_s:
            if ready():
                return
            shown.page.wait_for_timeout(50)
        shown.page.mouse.up()
    raise AssertionError(shown.page.inner_text("body"))


def moved(robot: LiveRobot, joint: str = "joint1", by: float = 0.05) -> Callable[[], bool]:
    """Return a function that reports whether a joint has moved by this distance from its present position."""
    before = at(robot, joint)
    return lambda: (at(robot, joint) - before) * np.sign(by) > abs(by)


def says(shown: OpenPage, text: str) -> Callable[[], bool]:
    return lambda: text in shown.page.inner_text("body")


def resting(robot: LiveRobot) -> None:
    """Wait until the commands no longer change, and check that the maximum duration of a press is not the reason."""
    before, last = at(robot), list[bytes]()

    def still() -> bool:
        last.append(robot.snapshot.command.tobytes())
        time.sleep(0.1)
        return len(last) > 5 and len(set(last[-5:])) == 1

    until(still)
    assert abs(at(robot) - before) < SPEED * LONGEST_S / 2


def check_held_and_let_go(shown: OpenPage, robot: LiveRobot) -> None:
    """The image of the arm and the numbers change. The motion stops at the end of the click, even if the mouse has left
    the button."""
    before = shown.cells("joint1")[1]
    hold(shown, ON, moved(robot))
    until(lambda: shown.cells("joint1")[1] != before)
    shown.page.mouse.up()
    resting(robot)
    hold(shown, BACK, moved(robot, by=-0.05))
    shown.page.mouse.move(550, 400)
    shown.page.mouse.up()
    resting(robot)


def check_pose_and_hand(shown: OpenPage, robot: LiveRobot) -> None:
    hold(shown, "Go to the pose", says(shown, "reached: aside"))
    shown.page.mouse.up()
    resting(robot)
    assert at(robot) == pytest.approx(0.3, abs=0.02)
    hold(shown, "Close the hand", moved(robot, "hand_right_joint", 0.005))
    shown.page.mouse.up()
    resting(robot)


def check_page_that_is_left(shown: OpenPage, robot: LiveRobot) -> None:
    """The arm stops when the window loses focus or the browser freezes, although the button is not released."""
    hold(shown, BACK, moved(robot, by=-0.05))
    shown.page.evaluate("window.dispatchEvent(new Event('blur'))")
    resting(robot)
    shown.page.mouse.up()
    hold(shown, ON, moved(robot))
    browser = shown.page.context.browser
    assert browser is not None
    processes = browser.new_browser_cdp_session().send("SystemInfo.getProcessInfo")["processInfo"]
    renderers = [one["id"] for one in processes if one["type"] == "renderer"]
    assert renderers
    signal_all(renderers, signal.SIGSTOP)
    resting(robot)
    signal_all(renderers, signal.SIGCONT)
    shown.page.mouse.up()


def signal_all(pids: list[int], number: int) -> None:
    for pid in pids:
        os.kill(pid, number)


def check_stop(shown: OpenPage, robot: LiveRobot, arm: ArmClient) -> None:
    """A goal of another client is not overridden, and a click on the stop button ends it."""
    future = arm.send([at(robot) + 0.5, *PICK[1:]], 60)
    hold(shown, ON, says(shown, "arm_controller is executing a goal: stop the goal first"))
    shown.page.mouse.up()
    shown.page.get_by_role("button", name="Stop everything").click()
    assert arm.wait(future).status == GoalStatus.STATUS_ABORTED  # type: ignore[attr-defined]
    shown.wait_for_text("All motions of all clients were stopped.")
    resting(robot)


def check_fault(shown: OpenPage, robot: LiveRobot, link: Path) -> None:
    """A joint does not move if another servo of its controller is silent, and the page shows the name of this servo."""
    ask(control_path(link), {"do": "fault", "text": "silent id=3"})
    shown.wait_for_text("joint3 (servo 3): joint3: servo 3 does not respond")
    hold(shown, ON, says(shown, "\njoint3: servo 3 does not respond"))
    shown.page.mouse.up()
    resting(robot)
