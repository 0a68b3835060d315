"""Arms are found by name and by folder, also on the command line."""

import json
import re
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from hal.hal_errors import ArmFileError, RobotFileError
from servoloop import cli
from servoloop.stack.arm_folders import arms, find_arm, read_arm_files
from servoloop.stack.robot_files import read_files
from servoloop.stack.shipped_files import ARMS, CONFIG, OWN, URDF
from tests.complaint import complaint

RUNNER = CliRunner()


def test_included_arms() -> None:
    so101 = ["so101", "so101_12v", "so101_leader"]
    assert [arm.name for arm in arms()] == [
        "bimanual_so101",
        "koch",
        "robot_arm",
        "robot_arm_dynamixel",
        "so100",
        *so101,
    ]
    assert find_arm() == find_arm(OWN) == find_arm(str(ARMS / OWN))
    assert all(arm.file.description and arm.file.source and arm.file.license for arm in arms())


def test_every_file_of_every_arm_can_be_read() -> None:
    for arm in arms():
        files = read_arm_files(arm)
        assert files.scene == arm.scene and files.robot_path == arm.robot


def test_default_arm_has_the_default_files() -> None:
    assert read_arm_files(find_arm()).robot == read_files().robot


def test_single_files_override_the_files_of_the_arm(tmp_path: Path) -> None:
    so101 = find_arm("so101")
    twelve_volts = find_arm("so101_12v").robot
    assert read_arm_files(so101, robot=twelve_volts).robot_path == twelve_volts
    assert read_arm_files(so101, URDF, CONFIG / "arm_controllers.yaml").robot_path == CONFIG / "robot_arm.yaml"


@pytest.mark.parametrize("arm", ["so101", "so101_12v", "robot_arm_dynamixel", "bimanual_so101"])
def test_a_copy_of_the_urdf_in_another_folder_uses_the_robot_file_of_the_arm(tmp_path: Path, arm: str) -> None:
    urdf = Path(shutil.copy(find_arm(arm).urdf, tmp_path / "copy.urdf"))
    assert read_arm_files(find_arm(arm), urdf).robot_path.resolve() == find_arm(arm).robot


def test_a_robot_file_that_is_in_no_folder_is_reported_with_its_parameter(tmp_path: Path) -> None:
    urdf = tmp_path / "copy.urdf"
    urdf.write_text(find_arm("so101").urdf.read_text().replace(">robot.yaml<", ">rebot.yaml<"))
    with pytest.raises(RobotFileError, match=r'copy.urdf: <param name="robot"> is rebot.yaml, which is in none of'):
        read_arm_files(find_arm("so101"), urdf)


def test_any_folder_can_be_an_arm(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "arm.yaml").write_text(f"description: mine\nurdf: {URDF}\nsource: me\nlicense: MIT\n")
    arm = find_arm(str(folder))
    assert (arm.name, arm.urdf, arm.robot) == ("mine", URDF, folder / "robot.yaml")


def test_path_is_never_read_as_the_name_of_an_arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ArmFileError, match=r"there is no arm \./so101"):
        find_arm("./so101")
    shutil.copytree(ARMS / "so101", "so101")
    assert find_arm("./so101").folder == tmp_path / "so101" and find_arm("so101").folder == ARMS / "so101"


def test_arm_may_copy_values_of_another_arm(tmp_path: Path) -> None:
    low, high = find_arm("so101"), find_arm("so101_12v")
    assert (high.urdf, high.scene, high.pick_place) == (low.urdf, low.scene, low.pick_place)
    assert high.robot != low.robot and high.file.calibration == low.file.calibration != type(low.file.calibration)()
    assert (high.file.source, high.file.license) == (low.file.source, low.file.license)
    (tmp_path / "arm.yaml").write_text(f"description: mine\nlike: {high.folder}\n")
    with pytest.raises(ArmFileError, match=r"so101_12v, which itself copies \.\./so101: specify \.\./so101 instead"):
        find_arm(str(tmp_path))


def test_a_private_arm_needs_neither_source_nor_license(tmp_path: Path) -> None:
    (tmp_path / "arm.yaml").write_text("description: mine\n")
    assert (find_arm(str(tmp_path)).file.source, find_arm(str(tmp_path)).file.license) == ("", "")


@pytest.mark.parametrize("name", ["so102", "n" * 256, f"./{'n' * 256}"])
def test_error_for_unknown_arm_lists_the_known_arms(name: str) -> None:
    with pytest.raises(
        ArmFileError,
        match=rf"no arm {name}: choose one of bimanual_so101, koch, .*, so101_leader, or specify a folder",
    ):
        find_arm(name)


@pytest.mark.parametrize("verb", ["up", "emulate", "demo"])
def test_every_command_accepts_an_arm(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, verb: str
) -> None:
    more = [str(tmp_path / "bus")] if verb == "emulate" else []
    assert "there is no arm so102" in complaint(capsys, monkeypatch, verb, "--arm", "so102", *more)


def test_the_demo_has_the_grades_of_its_arm(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    said = complaint(capsys, monkeypatch, "demo", "--arm", "so101", "--grades", "A,D")
    assert "--grades: there is no bin for D;" in said and "so101/pick_place.yaml" in said


def test_list_as_text_and_as_json() -> None:
    words = RUNNER.invoke(cli.app, ["arms"])
    assert words.exit_code == 0 and "so101_12v" in words.output
    listed = json.loads(RUNNER.invoke(cli.app, ["arms", "--json"]).output)
    assert [arm["name"] for arm in listed] == [arm.name for arm in arms()]
    assert all(Path(arm[file]).is_file() for arm in listed for file in ("urdf", "robot", "scene", "pick_place"))


def test_the_check_on_the_command_line(tmp_path: Path) -> None:
    right = RUNNER.invoke(cli.app, ["arms", "check", "so101"])
    assert (right.exit_code, right.output) == (0, "so101: no problems found\n")
    (tmp_path / "arm.yaml").write_text("description: nothing\nsource: me\nlicense: MIT\n")
    wrong = RUNNER.invoke(cli.app, ["arms", "check", str(tmp_path), "--json"])
    assert wrong.exit_code == 1
    assert len(json.loads(wrong.output)["problems"]) >= 3


def test_dynamixel_arm_differs_only_in_its_efforts() -> None:
    effort = re.compile(r'effort="[^"]*"')
    one, other = (effort.sub("", path.read_text()) for path in (URDF, find_arm("robot_arm_dynamixel").urdf))
    changed = [pair for pair in zip(one.splitlines(), other.splitlines(), strict=True) if pair[0] != pair[1]]
    assert len(changed) == 2  # a comment, and the name of the robot file


def test_leader_differs_only_in_its_gears_and_has_no_camera() -> None:
    rest = re.compile(r'effort="[^"]*"|  <!-- The camera.*?(?=  <ros2_control)', re.DOTALL)
    one, other = (
        rest.sub("", find_arm(name).urdf.read_text().partition("-->")[2]) for name in ("so101", "so101_leader")
    )
    assert one == other
    gears = {joint.name: joint.model.name for joint in read_arm_files(find_arm("so101_leader")).robot.joints}
    assert gears == {
        "shoulder_pan": "sts3215_c044",
        "shoulder_lift": "sts3215_c001",
        "elbow_flex": "sts3215_c044",
        "wrist_flex": "sts3215_c046",
        "wrist_roll": "sts3215_c046",
        "gripper": "sts3215_c046",
    }


def test_both_so101_variants_are_mounted_alike() -> None:
    low, high = (read_arm_files(find_arm(name)).robot for name in ("so101", "so101_12v"))
    assert {joint.model.rated_voltage_v for joint in low.joints} == {7.4}
    assert {joint.model.rated_voltage_v for joint in high.joints} == {12.0}
    assert [(j.name, j.servo_id, j.sign, j.zero_counts) for j in low.joints] == [
        (j.name, j.servo_id, j.sign, j.zero_counts) for j in high.joints
    ]
    assert low.file.park == high.file.park and low.file.controller_defaults == high.file.controller_defaults
