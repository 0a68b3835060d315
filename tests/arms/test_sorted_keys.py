"""The files of an arm keep their meaning if another program saves them with the keys in a different order."""

from collections.abc import Mapping
from pathlib import Path
from shutil import copytree
from typing import Any

import pytest
import yaml

from hal.hal_errors import ArmFileError
from servoloop.manual.poses import Poses
from servoloop.simulation.schedule import Schedule, read_schedule, schedule_text
from servoloop.simulation.stack_faults import inventory_of
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.pick_place import load_pick_place
from servoloop.stack.robot_files import read_files
from servoloop.stack.shipped_files import ARMS, CONFIG, URDF
from sim_backend.faults.draw import draw
from sim_backend.faults.servos import Silent


def sort_keys(folder: Path, backwards: bool = False) -> None:
    """Rewrite every YAML file in a folder with sorted keys."""

    def ordered(content: Any) -> Any:
        if isinstance(content, Mapping):
            return {key: ordered(content[key]) for key in sorted(content, key=str, reverse=backwards)}
        return [ordered(item) for item in content] if isinstance(content, list) else content

    for path in folder.rglob("*.yaml"):
        path.write_text(yaml.safe_dump(ordered(yaml.safe_load(path.read_text())), sort_keys=False))


@pytest.fixture(scope="module", params=[False, True], ids=["sorted", "backwards"])
def resaved(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder ``config`` with all included arms and sorted keys."""
    home = tmp_path_factory.mktemp("home")
    copytree(CONFIG, home / "config")
    copytree(URDF.parent, home / "urdf")
    sort_keys(home / "config", request.param)
    return home / "config"


@pytest.mark.parametrize("name", sorted(path.parent.name for path in ARMS.glob("*/arm.yaml")))
def test_arm_with_sorted_keys_is_equal(resaved: Path, name: str) -> None:
    before, after = find_arm(name), find_arm(str(resaved / "arms" / name))
    auto, auto_after = before.file.calibration.auto, after.file.calibration.auto
    assert after.file.calibration == before.file.calibration
    assert [*auto.clear.items()] == [*auto_after.clear.items()] and [*auto.stops.items()] == [*auto_after.stops.items()]
    files, sorted_files = read_arm_files(before), read_arm_files(after)
    assert [one.name for one in files.robot.joints] == [one.name for one in sorted_files.robot.joints]
    assert files.robot.file == sorted_files.robot.file and files.limits == sorted_files.limits
    specs = [{one.name: one for one in each.controllers.controllers} for each in (files, sorted_files)]
    assert specs[0] == specs[1]
    if before.pick_place.exists():
        assert load_pick_place(before.pick_place) == load_pick_place(after.pick_place)


def test_seed_draws_the_same_faults_with_sorted_keys(resaved: Path) -> None:
    name = "robot_arm_two_buses.yaml"
    there = [inventory_of(read_files(robot=folder / name)) for folder in (CONFIG, resaved)]
    assert draw(3, there[0], 10.0, 20) == draw(3, there[1], 10.0, 20)


def test_order_of_calibration_must_be_a_list(tmp_path: Path) -> None:
    text = (ARMS / "so101" / "arm.yaml").read_text()
    ordered = "stops: [{elbow_flex: -1.65}, {wrist_flex: 0.0}, {shoulder_lift: 0.0}]"
    assert ordered in text
    mapping = "stops: {elbow_flex: -1.65, shoulder_lift: 0.0, wrist_flex: 0.0}"
    (tmp_path / "arm.yaml").write_text(text.replace(ordered, mapping))
    with pytest.raises(ArmFileError, match=r"arm.yaml:\d+: calibration.auto.stops: is a mapping, .* Write a list"):
        find_arm(str(tmp_path))


def test_poses_and_schedules_are_equal_with_sorted_keys(tmp_path: Path) -> None:
    pose = {"wrist": 0.1, "elbow": -0.2, "base": 0.3}
    Poses(tmp_path).save("over", pose)
    schedule = Schedule(
        arm="so101", seed=3, job=("B", "A"), faults=(Silent(at_s=2.0, servo_id=3), Silent(at_s=1.0, servo_id=1))
    )
    (tmp_path / "schedule.yaml").write_text(schedule_text(schedule))
    sort_keys(tmp_path)
    assert Poses(tmp_path).get("over") == pose
    assert read_schedule(tmp_path / "schedule.yaml") == schedule
