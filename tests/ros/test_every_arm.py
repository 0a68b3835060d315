"""Run every command with every arm of ``servoloop arms``, on virtual servos in separate processes."""

import json
import math
import os
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState
from typer.testing import CliRunner

from drivers.clock import MonotonicClock
from drivers.driver_errors import DriverError
from nodes.clients.client_node import client_node
from servoloop.cli import app, main
from servoloop.dashboard.browser import show
from servoloop.dashboard.move_panel import MovePanel, Mover
from servoloop.dashboard.page import Page
from servoloop.dashboard.server import PageServer
from servoloop.recording.sources import LiveSource
from servoloop.stack.arm_folders import arms, find_arm, read_arm_files
from servoloop.stack.processes import Processes
from servoloop.testing.processes import RosStack, VirtualBusProcess
from tests.live.rig import runtime_folder
from tests.ros.stack_process import until
from tests.servoloop.test_emulator_process import given, read_again
from tests.view.view_process import viewing

QUICK = "koch"
"""Arm of the quick tests. The joints and servos of this arm differ from those of the default arm."""


def row(arm: str) -> object:
    """Return the arm that the fixtures of servoloop.testing also use."""
    marks = [pytest.mark.virtual_arm(arm), *(() if arm == QUICK else (pytest.mark.slow,))]
    return pytest.param(arm, marks=marks)


ONE_BUS = [arm.name for arm in arms() if len(read_arm_files(arm).robot.file.lines()) == 1]
"""Arms with one bus. tests/ros/test_several_arms.py has the robot with two arms on two buses."""
every_arm = pytest.mark.parametrize("arm", [row(name) for name in ONE_BUS])


@pytest.fixture(autouse=True)
def runtime(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Isolate the test from other stacks."""
    with runtime_folder(monkeypatch):
        yield


def servo_ids(arm: str) -> dict[str, int]:
    return {joint.name: joint.servo_id for joint in read_arm_files(find_arm(arm)).robot.joints}


@every_arm
def test_up_without_a_port_and_view(arm: str, ros_stack: RosStack) -> None:
    assert set(servo_ids(arm)) <= set(measured_joints())
    if arm == QUICK:
        with viewing("--arm", arm) as address, urllib.request.urlopen(address, timeout=20.0) as page:
            assert page.status == 200
    else:
        assert shown_joints(arm) >= set(servo_ids(arm))


def measured_joints() -> dict[str, float]:
    """Return every joint published by the stack, with its measured position."""
    states: list[JointState] = []
    with client_node("every_arm") as (node, executor):
        assert isinstance(executor, SingleThreadedExecutor)
        node.create_subscription(JointState, "/joint_states", states.append, 10)

        def complete() -> bool:
            executor.spin_once(timeout_sec=0.1)
            return bool(states) and all(map(math.isfinite, states[-1].position))

        until(complete)
    return dict(zip(states[-1].name, states[-1].position, strict=True))


def shown_joints(arm: str) -> set[str]:
    """Return the joints that a page in this process has shown, and its buttons."""
    clock = MonotonicClock()
    source, server = LiveSource(arm, clock), PageServer("127.0.0.1", 0)
    page, mover = Page(server), Mover(source, clock)
    shown: list[tuple[str, ...]] = []

    def stop() -> bool:
        shown.append(source.robot.state.snapshot.joints)
        return len([joints for joints in shown if joints]) > 10

    try:
        panel = MovePanel(server, mover, page.above_arm)
        show(page, source, clock, stop, [lambda _: panel.show()])
    finally:
        mover.close()
        source.close()
        server.stop()
    return set(shown[-1])


@every_arm
def test_emulate_doctor_scan_and_calibrate(
    arm: str, virtual_bus: VirtualBusProcess, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    line = ("--arm", arm, "--port", virtual_bus.port)
    report = json.loads(called("doctor", *line, "--json"))
    (bus,) = report["buses"]
    assert {one["joint"]: one["servo_id"] for one in bus["servos"]} == servo_ids(arm)
    assert {one["heard"] for one in bus["servos"]} == {"well"}
    found = json.loads(called("scan", virtual_bus.port, "--arm", arm, "--json"))
    assert sorted(one["servo_id"] for one in found["servos"]) == sorted(servo_ids(arm).values())
    with Path(os.devnull).open() as nothing:  # no person answers
        monkeypatch.setattr(sys, "stdin", nothing)
        monkeypatch.setattr(sys, "argv", ["servoloop", "calibrate", *line])
        with pytest.raises(SystemExit):
            main()
    said = capsys.readouterr().err
    assert "Move every joint" in said and "the input has ended" in said and "nothing was stored" in said


@every_arm
def test_simulate(arm: str) -> None:
    figures = json.loads(called("simulate", "--arm", arm, "--seconds", "0.5", "--json"))
    assert figures["success"] and figures["cycles"] > 10 and figures["faulty_cycles"] == {}


def called(*arguments: str) -> str:
    """Return the output of a command that runs in this process and must succeed."""
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.mark.slow
def test_doctor_starts_the_virtual_servos_of_its_arm() -> None:
    result = CliRunner().invoke(app, ["doctor", "--arm", "so101_leader", "--port", "virtual", "--json"])
    assert result.exit_code == 0, result.output
    (bus,) = json.loads(result.stdout)["buses"]
    assert {one["joint"] for one in bus["servos"] if one["heard"] == "well"} == set(servo_ids("so101_leader"))
    assert f"virtual servos at {bus['port']}" in result.stderr and not os.path.lexists(bus["port"])


@pytest.mark.parametrize("arm", [arm.name for arm in arms()])
def test_demo_starts_processes_with_the_files_of_its_arm(
    arm: str, ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only tests/ros/test_arms.py and test_readme.py run the whole demo."""
    started: list[tuple[str, ...]] = []

    def start(processes: Processes, name: str, *command: str) -> int:
        started.append(command)
        if name.startswith("pick_place"):
            raise DriverError("the last one")
        return 0

    monkeypatch.setattr(Processes, "start", start)
    monkeypatch.setattr(Processes, "wait_until", lambda *what: None)
    result = CliRunner().invoke(app, ["demo", "--arm", arm, "--out", str(tmp_path)])
    assert str(result.exception) == "the last one", result.output
    (_, *emulator), (_, *stack), (_, *node) = started
    chosen = find_arm(arm)
    files = read_arm_files(chosen)
    served, *_ = given(monkeypatch, "servoloop.stack.emulator.emulate", *emulator)
    _, _, run, *_ = given(monkeypatch, "servoloop.up.up", *stack)
    assert read_again(served) == read_again(run) == read_again(files)
    assert node[:3] == ["--ros-args", "--params-file", str(chosen.pick_place)]
    assert node[3:5] == (["-r", "__node:=left_vision_pick_place_controller"] if arm == "bimanual_so101" else [])
