"""Tests that `servoloop arms moveit` writes the files for any arm, and that MoveIt can plan from each of its poses."""

import re
import shutil
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
import yaml

from hal.hal_errors import ArmFileError
from servoloop import cli
from servoloop.motion_planning.collision_matrix import Pair, pair
from servoloop.moveit.files import MOVEIT, moveit_files
from servoloop.moveit.plannable import PaddedArm, rest_poses, working_poses
from servoloop.stack.arm_folders import ArmFolder, find_arm, read_arm, read_arm_files
from servoloop.stack.shipped_files import ARMS
from sim_backend.scene.world import World
from tests.arms.test_check import FILES, folder_with
from tests.config.arm import read_objects, read_padding_m

SAMPLES: Final = 2000
"""Number of random poses for the collision matrix. Pairs of links that matter touch in at least one of a hundred
poses."""
NAMES: Final = ("robot_arm", "so101", "so100", "koch")
SERVOS_LEAVE_RAD: Final = 0.006


@pytest.fixture(scope="module", params=NAMES)
def written(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[ArmFolder, Path]:
    arm = find_arm(request.param)
    folder = tmp_path_factory.mktemp(arm.name)
    for name, text in moveit_files(arm, SAMPLES).items():
        (folder / name).write_text(text)
    return arm, folder


def semantic(folder: Path) -> ElementTree.Element:
    (file,) = folder.glob("*.srdf")
    return ElementTree.parse(file).getroot()


def unchecked(root: ElementTree.Element) -> dict[Pair, str]:
    found = root.findall("disable_collisions")
    return {pair(one.attrib["link1"], one.attrib["link2"]): one.attrib["reason"] for one in found}


def states(root: ElementTree.Element) -> dict[tuple[str, str], dict[str, float]]:
    return {
        (state.attrib["group"], state.attrib["name"]): {
            joint.attrib["name"]: float(joint.attrib["value"]) for joint in state.findall("joint")
        }
        for state in root.findall("group_state")
    }


def read(file: Path) -> Any:
    return yaml.safe_load(file.read_text())


def padded(arm: ArmFolder, folder: Path) -> PaddedArm:
    objects = read_objects(read(folder / "planning_scene.yaml"))
    return PaddedArm(arm.scene, objects, read_padding_m(folder), unchecked(semantic(folder)))


def test_moveit_can_plan_in_every_usual_pose_of_the_arm(
    written: tuple[ArmFolder, Path],
) -> None:
    arm, folder = written
    model = padded(arm, folder)
    named = {name: state for (group, name), state in states(semantic(folder)).items() if group == "arm"}
    poses = {**rest_poses(arm), **working_poses(arm), **named}
    assert {"the start", "park, hand open, limp", "ready"} <= poses.keys()
    assert {name: pairs for name, pose in poses.items() if (pairs := model.collisions(pose))} == {}


def test_moveit_can_plan_with_the_files_of_the_launch() -> None:
    arm = find_arm("robot_arm")
    model = padded(arm, MOVEIT)
    poses = {**rest_poses(arm), **working_poses(arm)}
    assert {name: pairs for name, pose in poses.items() if (pairs := model.collisions(pose))} == {}


def test_the_files_of_robot_arm_equal_the_output_of_the_command(written: tuple[ArmFolder, Path]) -> None:
    """The state `upright` and the collision matrix are not compared; the matrix would need more samples."""
    arm, folder = written
    if arm.name != "robot_arm":
        pytest.skip("the files of other arms are not kept")
    for file in MOVEIT.iterdir():
        if file.suffix != ".srdf":
            assert (folder / file.name).read_text() == file.read_text(), file.name
    own, made = semantic(MOVEIT), semantic(folder)
    own_states = states(own)
    del own_states["arm", "upright"]
    assert states(made) == own_states
    for tag in ("group", "end_effector", "passive_joint"):
        assert list(map(plain, made.findall(tag))) == list(map(plain, own.findall(tag)))
    reasons = unchecked(own)
    assert {links: why for links, why in unchecked(made).items() if links in reasons} == reasons


def plain(element: ElementTree.Element) -> str:
    return re.sub(r"\s+", " ", ElementTree.tostring(element, encoding="unicode")).strip()


def test_the_padding_exceeds_the_sag_of_the_hand(written: tuple[ArmFolder, Path]) -> None:
    """Each joint has the position error of a servo at rest. The arm is stretched out at zero, or in its ready pose."""
    arm, folder = written
    world = World(arm.scene)
    for start in (np.zeros(len(world.joints)), world.ready):
        at = World(arm.scene, initial_position=start)
        tip = max(
            (at.data.body(i).xpos for i in range(at.model.nbody) if at.model.body_rootid[i] == 1), key=np.linalg.norm
        )
        levers = [float(np.linalg.norm(tip - at.data.joint(name).xanchor)) for name in at.joints[1:-2]]
        assert SERVOS_LEAVE_RAD * sum(levers) < read_padding_m(folder)


def test_the_files_name_the_joints_and_controllers_of_the_arm(written: tuple[ArmFolder, Path]) -> None:
    arm, folder = written
    files, root = read_arm_files(arm), semantic(folder)
    limits = read(folder / "joint_limits.yaml")["joint_limits"]
    assert list(limits) == [joint.name for joint in files.robot.joints]
    assert {type(value) for joint in limits.values() for key, value in joint.items() if "max" in key} == {float}
    manager = read(folder / "moveit_controllers.yaml")["moveit_simple_controller_manager"]
    assert manager["arm_controller"]["joints"] == list(states(root)["arm", "ready"])
    described = ElementTree.fromstring((folder / f"{arm.name}.urdf").read_text())
    assert root.get("name") == described.get("name")
    chains = [(chain.attrib["base_link"], chain.attrib["tip_link"]) for chain in root.iter("chain")]
    assert chains and {link for chain in chains for link in chain} <= {
        link.get("name") for link in described.iter("link")
    }
    assert set(read(folder / "kinematics.yaml")) == {"arm"}


def test_collisions_are_checked_with_the_shapes_of_the_urdf() -> None:
    """The scene has the boxes that MoveIt reads from the URDF."""
    for name in NAMES:
        arm = find_arm(name)
        in_urdf = sorted(shapes(ElementTree.parse(arm.urdf).getroot()))
        world = World(arm.scene)
        model = world.model
        own = [g for g in range(model.ngeom) if model.body_rootid[model.geom_bodyid[g]] == model.body("base_link").id]
        assert len(in_urdf) == len(own), name
        in_scene = sorted((model.body(model.geom_bodyid[g]).name, *np.round(2 * model.geom_size[g], 5)) for g in own)
        boxes = [shape for shape in in_urdf if len(shape) == 4]
        assert set(boxes) <= set(in_scene), name


def shapes(robot: ElementTree.Element) -> Iterator[tuple[Any, ...]]:
    for link in robot.findall("link"):
        for geometry in link.findall("collision/geometry"):
            box = geometry.find("box")
            size = [] if box is None else [round(float(value), 5) for value in box.attrib["size"].split()]
            yield (link.attrib["name"], *size)


@pytest.mark.runs("servoloop arms moveit so101 so101_moveit")
def test_the_command_writes_the_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    made = moveit_files(find_arm("so101"), 100)
    monkeypatch.setattr("servoloop.moveit.files.moveit_files", lambda arm: made)
    monkeypatch.chdir(tmp_path)
    folder = Path("so101_moveit")
    for _ in range(2):
        assert run(monkeypatch, "so101", folder) == 0
    assert str(folder / "so101.srdf") in capsys.readouterr().out
    assert {file.name for file in folder.iterdir()} == {*made, *(f"{name}.1" for name in made)}
    assert (folder / "so101.srdf").read_text() == made["so101.srdf"]
    assert run(monkeypatch, "so101", folder / "so101.srdf") == 1
    assert f"cannot write into {folder / 'so101.srdf'}" in " ".join(capsys.readouterr().err.split())


def run(monkeypatch: pytest.MonkeyPatch, arm: str, folder: Path) -> int:
    monkeypatch.setattr(sys, "argv", ["servoloop", "arms", "moveit", arm, str(folder)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    return int(end.value.code or 0)


def test_a_pose_in_which_moveit_could_not_plan_is_named(tmp_path: Path) -> None:
    """In this park pose, the open jaw is between the stand and bin C, 3 mm from the bin."""
    text = (ARMS / "so101" / "robot.yaml").read_text()
    (pose,) = re.findall(r"pose: \{.*\}", text)
    folded = "pose: {shoulder_pan: 0.0, shoulder_lift: -1.7, elbow_flex: 1.65, wrist_flex: 0.85, wrist_roll: -1.57}"
    folder = folder_with(tmp_path, FILES, ("robot.yaml", pose, folded))
    with pytest.raises(ArmFileError, match=r"park, hand open: .*moving_jaw_so101_v1_link - bin_C"):
        moveit_files(read_arm(folder), 100)


def test_the_state_park_contains_only_the_joints_of_the_park_pose(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, FILES, ("robot.yaml", "shoulder_pan: 0.287, ", ""))
    written = moveit_files(read_arm(folder), 100)
    state = states(ElementTree.fromstring(written[f"{folder.name}.srdf"]))["arm", "park"]
    assert state == {"shoulder_lift": -1.71, "elbow_flex": 1.614, "wrist_flex": 0.981, "wrist_roll": 0.0}


def test_the_root_link_of_the_arm_may_have_any_name(tmp_path: Path) -> None:
    folder = folder_with(tmp_path, FILES)
    for name in ("arm.urdf", "scene.xml"):
        (folder / name).write_text((folder / name).read_text().replace('"base_link"', '"foot"'))
    written = moveit_files(read_arm(folder), 100)
    assert "header: {frame_id: foot}" in written["planning_scene.yaml"]
    assert "Fixed Frame: foot\n" in written["moveit.rviz"]
    assert "base_link" not in written["planning_scene.yaml"] + written["moveit.rviz"]


def test_a_robot_with_several_arms_has_settings_for_each_group(tmp_path: Path) -> None:
    arm = find_arm("bimanual_so101")
    for name, text in moveit_files(arm).items():
        (tmp_path / name).write_text(text)
    model = padded(arm, tmp_path)
    poses = {**rest_poses(arm), **working_poses(arm)}
    assert {"park, hand closed, limp", "left bins.A, hand open", "right poses.pick, hand closed"} <= poses.keys()
    assert {name: pairs for name, pose in poses.items() if (pairs := model.collisions(pose))} == {}
    assert ElementTree.tostring(semantic(tmp_path)) == ElementTree.tostring(semantic(arm.folder))
    assert {*read(tmp_path / "kinematics.yaml")} == {"left_arm", "right_arm"}
    planners = read(tmp_path / "ompl_planning.yaml")
    assert {"left_arm", "right_arm", "both", "left_hand", "right_hand"} <= planners.keys() and "arm" not in planners
    assert planners["right_arm"]["planner_configs"] == planners["both"]["planner_configs"]
    manager = read(tmp_path / "moveit_controllers.yaml")["moveit_simple_controller_manager"]
    assert manager["controller_names"] == ["left_arm_controller", "right_arm_controller"]
    assert len(read(tmp_path / "joint_limits.yaml")["joint_limits"]) == 12
    assert "Planning Group: left_arm\n" in (tmp_path / "moveit.rviz").read_text()


def test_a_robot_with_several_arms_needs_an_srdf(tmp_path: Path) -> None:
    folder = shutil.copytree(ARMS / "bimanual_so101", tmp_path / "two", ignore=shutil.ignore_patterns("*.srdf"))
    with pytest.raises(ArmFileError, match=r"two has several trajectory controllers, but no SRDF .*: put two\.srdf"):
        moveit_files(read_arm(folder))
