"""A stack in simulated time (``servoloop up --rtf`` and ``--step``), as seen from other processes."""

import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from mujoco_ros2_control_msgs.srv import SetPause, StepSimulation
from rclpy.action import ActionClient
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from sorting_arm_interfaces.action import PickPlace
from tf2_msgs.msg import TFMessage

from servoloop.stack.shipped_files import CONFIG
from tests.pages import commands
from tests.ros.manager_client import ManagerClient, manager_client
from tests.ros.stack_process import PATIENCE_S, StackProcess, running, until

NODES = ("controller_manager", "arm_controller", "robot_arm", "robot_state_publisher", "ros2_control_node")
PERIOD_S = 0.05
_, *UP = commands("simulation.md")
LONGEST_JOB_S = 15.0
"""Time limit of a job in simulated seconds. The limit includes delays of clients, for which simulated time does not
wait."""
SUCCEEDED = 4  # action_msgs/msg/GoalStatus
BINS_Y_M = {"A": 0.123, "B": 0.0, "C": -0.123}
TABLE_M = 0.05
"""Height below which a cube is in a bin, in m. The height of a cube on the stand or in the hand is greater."""


@pytest.fixture(scope="module")
def stack(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[StackProcess]:
    """Run a stack that is paused at the start and then runs as fast as possible."""
    with running(tmp_path_factory.mktemp("stack"), "--rtf", "max", "--step") as stack:
        yield stack


@pytest.fixture(scope="module")
def client(stack: StackProcess) -> Iterator[ManagerClient]:
    with manager_client() as client:
        yield client


def seconds(stamp: Time) -> float:
    return float(stamp.sec + stamp.nanosec * 1e-9)


def pause(client: ManagerClient, paused: bool) -> None:
    assert client.call(SetPause, "/ros2_control_node/set_pause", paused=paused).success


def step(client: ManagerClient, steps: int) -> Any:
    return client.call(StepSimulation, "/ros2_control_node/step_simulation", steps=steps)


@contextmanager
def stamps(client: ManagerClient) -> Iterator[Callable[[], list[float]]]:
    """Record the stamps of the joint states of all cycles within the block. The first message, which is latched, is
    skipped."""
    with client.hearing(JointState, "/joint_states") as heard:
        while not heard:  # The stack has discovered the subscription when the first message arrives.
            assert step(client, 1).success
            client.executor.spin_once(timeout_sec=0.2)
        yield lambda: [seconds(message.header.stamp) for message in heard]


def test_steps_are_cycles_and_only_they_advance_time(client: ManagerClient) -> None:
    with stamps(client) as heard, client.hearing(Clock, "/clock") as clock:
        first = heard()[-1]
        assert step(client, 7).success
        client.spin_until(lambda: heard()[-1] > first + 6.5 * PERIOD_S)
        assert step(client, 1).success
        client.spin_until(lambda: heard()[-1] > first + 7.5 * PERIOD_S)
        since = [stamp for stamp in heard() if stamp >= first]
        assert len(since) == 1 + 7 + 1
        periods_s = [after - before for before, after in pairwise(since)]
        assert periods_s == pytest.approx([PERIOD_S] * 8, abs=0.001)  # The time on the bus varies slightly.
        clock.clear()
        client.spin_until(lambda: len(clock) > 5)  # A paused simulation publishes its time again for new subscribers.
        assert {seconds(message.clock) for message in clock} == {since[-1]}
        assert heard()[-1] == since[-1]


def test_paused_stack_responds_and_switches_controllers(client: ManagerClient) -> None:
    with stamps(client) as heard:
        before = heard()[-1]
        assert client.switch((), ["hand_controller"])[0]
        assert client.listed()["hand_controller"].state == "inactive"
        assert client.switch(["hand_controller"])[0]
        assert client.listed()["hand_controller"].state == "active"
        assert client.get("/arm_controller", "action_monitor_rate") == [20.0]
        assert heard()[-1] == before


def test_zero_steps_and_steps_of_a_running_simulation_are_refused(client: ManagerClient) -> None:
    refused = step(client, 0)
    assert not refused.success and "at least one step" in refused.message
    pause(client, False)
    try:
        refused = step(client, 1)
        assert not refused.success and "not paused" in refused.message
    finally:
        pause(client, True)


@pytest.mark.row("cm-sim-time")
def test_every_node_uses_simulated_time(client: ManagerClient) -> None:
    for node in NODES:
        assert client.get(f"/{node}", "use_sim_time") == [True]
    with client.hearing(DiagnosticArray, "/diagnostics") as reports, client.hearing(Clock, "/clock") as clock:
        while len(reports) < 2:
            step(client, 10)
            client.executor.spin_once(timeout_sec=0.1)
        newest, before = seconds(reports[-1].header.stamp), seconds(reports[-2].header.stamp)
        assert newest <= seconds(clock[-1].clock) + 1e-6
        assert 1.0 - PERIOD_S <= newest - before <= 1.0 + PERIOD_S


@pytest.fixture
def picker(client: ManagerClient, tmp_path: Path) -> Iterator[ActionClient]:
    """Run the unchanged pick-and-place node with simulated time from /clock."""
    module, parameters = "nodes.vision_pick_place_controller", str(CONFIG / "vision_pick_place_controller.yaml")
    arguments = ["--ros-args", "--params-file", parameters, "-p", "use_sim_time:=true"]
    with (tmp_path / "node.log").open("wb") as log:
        node = subprocess.Popen([sys.executable, "-m", module, *arguments], stdout=log, stderr=subprocess.STDOUT)
    action = ActionClient(client.node, PickPlace, "/sorting/arm/pick_place")
    try:
        assert action.wait_for_server(30.0)
        yield action
    finally:
        action.destroy()
        node.terminate()
        assert node.wait(30.0) == 0


def test_three_cubes_are_sorted_at_maximum_speed(client: ManagerClient, picker: ActionClient) -> None:
    cube = [(0.0, 0.0, 1.0)]

    def see(message: TFMessage) -> None:
        for transform in message.transforms:
            if transform.child_frame_id == "cube":
                place = transform.transform.translation
                cube.append((place.x, place.y, place.z))

    client.node.create_subscription(TFMessage, "/tf", see, 10)
    with client.hearing(Clock, "/clock") as clock:
        pause(client, False)
        for grade in "ABC":
            client.spin_until(lambda: clock)
            begun_s = seconds(clock[-1].clock)
            (goal,) = client.wait(picker.send_goal_async(PickPlace.Goal(grade=grade)))
            (response,) = client.wait(goal.get_result_async())
            took_s = seconds(clock[-1].clock) - begun_s
            assert (response.status, response.result.success) == (SUCCEEDED, True), response.result.message
            assert response.result.message == f"gripper opened over bin {grade}; the arm is back at the ready pose"
            assert 8.0 < took_s < LONGEST_JOB_S
            client.spin_until(lambda: cube[-1][2] < TABLE_M)
            assert cube[-1][1] == pytest.approx(BINS_Y_M[grade], abs=0.058)
        pause(client, True)


def test_ctrl_c_ends_a_paused_stack_cleanly(ros_domain: int, tmp_path: Path) -> None:
    with running(tmp_path, "--hardware", "mock", "--step", "--namespace", "other") as stack:
        assert stack.end() == 0
    assert "0.0 s simulated in 0.0 s" in stack.words


@pytest.mark.slow
def test_client_that_waits_for_steps_is_answered_at_the_end(client: ManagerClient, stack: StackProcess) -> None:
    """This must be the last test of the file, because it ends the stack."""
    steps = client.client(StepSimulation, "/ros2_control_node/step_simulation")
    with stamps(client) as heard:
        left = steps.call_async(StepSimulation.Request(steps=2**32 - 1))
        first = heard()[-1]
        client.spin_until(lambda: heard()[-1] > first + 1.0)
        stack.process.send_signal(signal.SIGINT)
        (response,) = client.wait(left)
    assert (response.success, response.message) == (False, "the control loop has ended")
    assert stack.process.wait(PATIENCE_S) == 0


@pytest.mark.slow
@pytest.mark.runs(*UP)
@pytest.mark.parametrize("command", UP)
def test_commands_of_the_page_start_and_end(command: str, ros_domain: int, tmp_path: Path) -> None:
    stack = StackProcess(tmp_path / "log", *shlex.split(command)[1:])
    until(lambda: "ready: robot_arm" in stack.words, lambda: stack.process.poll() is not None and stack.words)
    assert stack.end() == 0
