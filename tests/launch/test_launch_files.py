"""Tests of the launch files without the package launch, for which no wheel exists.

tests/launch/recorders.py replaces this package. The files and programs that the launch files request are real: the
files are those of a workspace, and the programs are started.
"""

import signal
import subprocess
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from hal.hal_errors import ArmFileError
from servoloop.stack.arm_folders import ArmFolder, arms
from servoloop.stack.shipped_files import CONFIG
from tests.launch.conftest import ROOT
from tests.launch.reading import CONTROL, MOVEIT, actions, parse, words
from tests.ros.stack_process import until

pytestmark = pytest.mark.ros

PATIENCE_S = 60


def test_every_launch_file_is_covered_here() -> None:
    assert {path.name for path in (ROOT / "launch").iterdir() if path.is_file()} == {CONTROL, MOVEIT}


def test_without_arguments_servoloop_gets_the_shared_files_and_its_own_defaults(share: Path) -> None:
    (process,) = actions(share / "launch" / CONTROL)
    parsed = parse(process.cmd[1:])
    assert parsed["urdf"] == share / "urdf" / "robot_arm.urdf"
    assert parsed["controllers"] == share / "config" / "arm_controllers.yaml"
    assert not any(parsed[name] for name in ("robot", "hardware", "port", "ready_file"))


def test_every_argument_reaches_servoloop(share: Path) -> None:
    given = {"urdf": "/a.urdf", "controllers": "/b.yaml", "robot": "/c.yaml", "hardware": "mujoco"}
    (process,) = actions(share / "launch" / CONTROL, **given, port="arm=/dev/ttyACM0 hand=/dev/ttyUSB0")
    parsed = parse(process.cmd[1:])
    assert {name: str(parsed[name]) for name in given} == given
    assert list(parsed["port"]) == ["arm=/dev/ttyACM0", "hand=/dev/ttyUSB0"]


def test_another_arm_brings_its_own_files(share: Path) -> None:
    (process,) = actions(share / "launch" / CONTROL, arm="so101", hardware="mock")
    parsed = parse(process.cmd[1:])
    assert (parsed["arm"], parsed["hardware"]) == ("so101", "mock")
    assert not any(parsed[name] for name in ("urdf", "controllers", "robot"))
    (process,) = actions(share / "launch" / CONTROL, arm="so101", controllers="/b.yaml")
    assert str(parse(process.cmd[1:])["controllers"]) == "/b.yaml"


def test_a_namespace_reaches_servoloop_and_the_node(share: Path) -> None:
    process, node = actions(share / "launch" / CONTROL, namespace="left", pick_place="true")
    assert parse(process.cmd[1:])["namespace"] == "/left"
    assert node.namespace.name == "namespace"


@pytest.mark.parametrize("arm", [arm for arm in arms() if arm.pick_place.exists()], ids=lambda arm: arm.name)
def test_the_node_gets_the_poses_of_the_arm(share: Path, arm: ArmFolder) -> None:
    for name, config in ((arm.name, share / "config"), (str(arm.folder), CONFIG)):
        _, node = actions(share / "launch" / CONTROL, arm=name, pick_place="true")
        assert node.parameters == [str(config / arm.pick_place.relative_to(CONFIG))]


def test_the_node_does_not_move_an_arm_without_poses(share: Path, tmp_path: Path) -> None:
    (tmp_path / "arm.yaml").write_text("description: an arm\n")
    with pytest.raises(ArmFileError, match=rf"pick_place:=true requires {tmp_path}/pick_place.yaml: add this file"):
        actions(share / "launch" / CONTROL, arm=str(tmp_path), pick_place="true")


def test_the_node_does_not_move_an_unknown_arm(share: Path) -> None:
    with pytest.raises(ArmFileError, match=r"move the arm of /a.urdf to the poses of robot_arm: specify"):
        actions(share / "launch" / CONTROL, urdf="/a.urdf", pick_place="true")
    _, node = actions(share / "launch" / CONTROL, arm="robot_arm", urdf="/a.urdf", pick_place="true")
    assert node.parameters == [str(share / "config" / "vision_pick_place_controller.yaml")]


def test_there_is_time_to_park(share: Path) -> None:
    """After sigterm_timeout, launch sends a second signal, which releases the torque of a real arm in any pose."""
    from servoloop.stack.robot_files import read_files

    robot = read_files().robot
    park = robot.file.park
    assert park is not None
    slowest_s = max((joint.limits.upper - joint.limits.lower) / joint.limits.velocity for joint in robot.joints)
    (process,) = actions(share / "launch" / CONTROL)
    assert float(process.sigterm_timeout) >= 5 * slowest_s / park.velocity_scale


@pytest.mark.parametrize("hardware", ["mock", ""])
def test_the_stack_comes_up_and_ends(
    share: Path, workspace: Path, hardware: str, ros_domain: int, tmp_path: Path
) -> None:
    (process,) = actions(share / "launch" / CONTROL, hardware=hardware)
    assert_runs(words(process, workspace), "ready: robot_arm", tmp_path)


def test_the_node_comes_up_with_its_parameters(share: Path, workspace: Path, ros_domain: int, tmp_path: Path) -> None:
    _, node = actions(share / "launch" / CONTROL, pick_place="true")
    assert_runs(words(node, workspace), "ready for goals", tmp_path)


def assert_runs(command: list[str], ready: str, folder: Path) -> None:
    """Check that the program reports that it is ready, and that Ctrl-C ends it with status 0."""
    log = folder / "log"
    with log.open("w") as out:
        process = subprocess.Popen(command, cwd=folder, stdout=out, stderr=subprocess.STDOUT)
    try:
        until(lambda: ready in log.read_text(), lambda: process.poll() is not None and log.read_text())
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0, log.read_text()
    finally:
        process.kill()
