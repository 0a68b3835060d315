"""``servoloop up`` reports why a robot cannot be started and ends."""

import re
from pathlib import Path

import pytest

from servoloop.stack.shipped_files import CONTROLLERS
from tests.complaint import complaint
from tests.ros.hardware_plugin import DEFECT, GONE, Orders, install
from tests.ros.stack_process import PATIENCE_S, StackProcess
from tests.ros.two_components import MOCK, write_urdf

HARDWARE = f"<hardware>{MOCK}</hardware>"
COMMAND = '<command_interface name="position"/>'
ARM_JOINT = '<joint name="joint1">'
BROKEN = {
    # Text to replace, its replacement, and the expected message.
    "an unknown tag": (HARDWARE, f"{HARDWARE}<wheel/>", "<ros2_control name='arm'> has the unknown tag <wheel>"),
    "a sensor element that takes commands": (
        HARDWARE,
        f'{HARDWARE}<sensor name="scale">{COMMAND}</sensor>',
        "<sensor name='scale'> has a <command_interface>",
    ),
    "a joint that is not in the URDF": (
        ARM_JOINT,
        '<joint name="wheel">',
        "<ros2_control name='arm'> has joint 'wheel', which is not in the URDF",
    ),
    "a fixed joint": (
        '<joint name="joint1" type="revolute">',
        '<joint name="joint1" type="fixed">',
        "<ros2_control name='arm'> has joint 'joint1', which is fixed in the URDF",
    ),
    "no name": ('<ros2_control name="arm"', "<ros2_control", "a <ros2_control> block of the URDF has no name"),
    "no type": ('"arm" type="system"', '"arm"', "<ros2_control name='arm'> of the URDF has no type"),
    "a sensor that takes commands": (
        '"arm" type="system"',
        '"arm" type="sensor"',
        "<ros2_control name='arm'> is a sensor, but joint 'joint1' has a <command_interface>",
    ),
    "no plugin": (MOCK, "", "<ros2_control name='arm'> has no <hardware><plugin>"),
    "one name for two": (
        'name="hand" type',
        'name="arm" type',
        "two <ros2_control> blocks are named 'arm'",
    ),
    "commands to a mimic joint": (
        '<joint name="hand_left_joint">',
        f'<joint name="hand_left_joint">{COMMAND}',
        "<ros2_control name='hand'>: joint 'hand_left_joint' has a <command_interface> but mimics 'hand_right_joint'",
    ),
}


def refusal(folder: Path, *arguments: str) -> str:
    """Run ``servoloop up``, which must exit with status 1 on its own, and return its output."""
    stack = StackProcess(folder / "up.log", "up", "--ready-file", str(folder / "ready"), *arguments)
    try:
        assert stack.process.wait(PATIENCE_S) == 1
    finally:
        stack.end()
    assert not (folder / "ready").exists()
    return stack.words


def plugged(folder: Path, monkeypatch: pytest.MonkeyPatch, call: str, order: str) -> Path:
    """Write a URDF with a plugin as the arm. One of its calls fails."""
    arm = Orders(folder / "arm")
    arm.give(call, order)
    monkeypatch.setenv("PYTHONPATH", install(folder))
    return write_urdf(folder, arm=arm.hardware)


@pytest.mark.row("cm-urdf-errors")
@pytest.mark.parametrize("kind", [*BROKEN])
def test_mistake_in_the_blocks_is_reported_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """The mistakes are found before a node is created, so the command can run in this process."""
    what, by_what, says = BROKEN[kind]
    urdf = write_urdf(tmp_path)
    text = urdf.read_text()
    assert what in text
    urdf.write_text(text.replace(what, by_what, 1))
    (line,) = complaint(capsys, monkeypatch, "up", "--urdf", str(urdf)).splitlines()
    assert line.startswith("servoloop: ") and says in line


@pytest.mark.row("cm-no-hang", "cm-urdf-errors")
def test_urdf_without_hardware_is_refused(ros_domain: int, tmp_path: Path) -> None:
    urdf = write_urdf(tmp_path)
    urdf.write_text(re.sub("<ros2_control.*</ros2_control>", "", urdf.read_text(), flags=re.DOTALL))
    (line,) = refusal(tmp_path, "--urdf", str(urdf)).splitlines()
    assert line.startswith(f"servoloop: {urdf}: the URDF has no <ros2_control> block: add a block")


@pytest.mark.row("cm-no-hang")
@pytest.mark.parametrize("call", ["configure", "activate"])
@pytest.mark.parametrize(("order", "says"), [("lost", f"servoloop: {GONE}"), ("defect", f"RuntimeError: {DEFECT}")])
def test_hardware_that_cannot_start_is_reported(
    ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str, order: str, says: str
) -> None:
    words = refusal(tmp_path, "--urdf", str(plugged(tmp_path, monkeypatch, call, order)))
    assert words.splitlines()[-1] == says


@pytest.mark.row("cm-no-hang")
def test_missing_port_is_reported(ros_domain: int, tmp_path: Path) -> None:
    words = refusal(tmp_path, "--port", str(tmp_path / "no_such_port"))
    assert words.splitlines()[-1].startswith(f"servoloop: {tmp_path / 'no_such_port'} does not exist")


@pytest.mark.row("cm-no-hang")
def test_controllers_of_missing_interfaces_are_refused(ros_domain: int, tmp_path: Path) -> None:
    controllers = tmp_path / "controllers.yaml"
    controllers.write_text(
        CONTROLLERS.read_text().replace("command_interfaces: [position]", "command_interfaces: [velocity]")
    )
    (line,) = refusal(tmp_path, "--urdf", str(write_urdf(tmp_path)), "--controllers", str(controllers)).splitlines()
    assert line.startswith(f"servoloop: {controllers}")
    assert "arm_controller" in line
