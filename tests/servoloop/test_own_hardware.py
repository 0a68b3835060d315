"""Tests that the example class in docs/hardware.md works, from its package up to the control loop."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from controller.loop import ControlLoop
from controller.manager.manager import ControllerManager
from hal.components.component_lifecycle import configure_all
from hal.lifecycle import LifecycleState
from hal.robot_description.description import parse_urdf
from hal.robot_file.robot_file import load_robot_file
from servoloop.stack.hardware import build
from servoloop.stack.robot_files import read_files
from sim_backend.clock import SimulatedClock
from tests.complaint import complaint
from tests.controller.test_loop import Puppet
from tests.pages import code

PAGE = "hardware.md"
URDF = """
<robot name="r">
  <link name="frame"/><link name="top"/>
  <joint name="belt" type="prismatic">
    <parent link="frame"/><child link="top"/><limit lower="0" upper="100" velocity="0.5" effort="10"/>
  </joint>
  <ros2_control name="conveyor" type="actuator">
    <hardware><plugin>factory/Belt</plugin></hardware>
    <joint name="belt"><command_interface name="velocity"/><state_interface name="velocity"/></joint>
  </ros2_control>
</robot>
"""
CONTROLLERS = "controller_manager: {ros__parameters: {update_rate: 20}}\n"


class Driver(Puppet):
    """Example hardware that needs a speed."""

    command_interfaces = ("belt/velocity",)
    state_interfaces = ("belt/velocity",)


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """Install the package as pip does, and write the files of the user."""
    (entry,) = tomllib.loads(code(PAGE, "toml"))["project"]["entry-points"]["servoloop.hardware"].items()
    info = tmp_path / "belt-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: belt\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[servoloop.hardware]\n{entry[0]} = {entry[1]}\n")
    (tmp_path / "belt.py").write_text(code(PAGE, "python"))
    monkeypatch.syspath_prepend(str(tmp_path))
    urdf, controllers = tmp_path / "belt.urdf", tmp_path / "controllers.yaml"
    urdf.write_text(URDF)
    controllers.write_text(CONTROLLERS)
    return urdf, controllers


@pytest.mark.runs(f"{PAGE} python 1", f"{PAGE} toml 1")
def test_the_class_of_the_page_runs_in_the_loop(files: tuple[Path, Path]) -> None:
    read, clock = read_files(*files), SimulatedClock()
    hardware = build(None, read, {}, clock).hardware
    manager = ControllerManager(hardware, read.limits)
    driver = Driver()
    manager.registry.add(driver)
    loop = ControlLoop(hardware, manager, read.limits, clock, 0.05)
    configure_all(hardware)
    loop.activate()
    driver.command = np.array([0.3])
    for _ in range(20):
        clock.sleep_until(clock.now() + 0.05)
        state = loop.step()
    assert state.velocity[0] == pytest.approx(0.3)
    assert 0.2 < state.position[0] < 0.3
    change = loop.component_transitions.ask("conveyor", LifecycleState.INACTIVE)
    for _ in range(10):
        loop.step()
    assert change.done and change.result() is None
    assert loop.step().velocity[0] == 0.0


@pytest.mark.runs(f"{PAGE} xml 1")
def test_each_block_of_the_description_is_a_component() -> None:
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="base"/><child link="{name}_link"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        f'<link name="{name}_link"/>'
        for name in ("joint1", "hand_right_joint")
    )
    interfaces = '<command_interface name="position"/><state_interface name="position"/>'
    said = parse_urdf(
        f'<robot name="r"><link name="base"/>{joints}{code(PAGE, "xml").replace("…", interfaces)}</robot>'
    )
    arm, hand = said.components
    assert (arm.name, arm.joints, arm.parameters["robot"]) == ("arm", ("joint1",), "arm.yaml")
    assert (hand.name, hand.joints, hand.rw_rate) == ("hand", ("hand_right_joint",), 10)


@pytest.mark.runs(f"{PAGE} yaml 1")
def test_settings_of_a_joint_are_read(tmp_path: Path) -> None:
    own = read_files().robot_path.read_text()
    line = "  " + code(PAGE, "yaml").rstrip()
    (tmp_path / "robot.yaml").write_text(re.sub(r"^  joint2: .*$", line, own, flags=re.MULTILINE))
    joint = load_robot_file(tmp_path / "robot.yaml").joints["joint2"]
    assert joint.settings == {"position_p": 16, "position_d": 32, "cw_dead_zone": 1}


def test_user_hardware_is_refused_in_simulated_time(
    files: tuple[Path, Path], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    urdf, controllers = map(str, files)
    words = complaint(capsys, monkeypatch, "up", "--rtf", "2", "--urdf", urdf, "--controllers", controllers)
    assert "factory/Belt may not support simulated time: omit --rtf and --step, or set --hardware" in words
