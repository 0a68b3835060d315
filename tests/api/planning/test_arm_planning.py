"""An arm plans around the objects of its scene, and refuses a plan that no longer fits its state or its scene."""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servoloop import Arm, ArmInputError, ArmPose, ArmSetupError, PlanFailedError

START = {"shoulder_pan": -0.9, "shoulder_lift": 0.3, "elbow_flex": 0.2, "wrist_flex": 0.4, "wrist_roll": 0.0}
HERE = (0.2, 0.1, 0.2)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def arm() -> Iterator[Arm]:
    with Arm.simulated("so101", seed=1) as arm:
        for name in ("cube", "stand", "bin_A", "bin_B", "bin_C"):
            arm.scene.remove(name)
        yield arm


@pytest.fixture
def ready(arm: Arm) -> Arm:
    """Return the arm at its start, on one side of a wall."""
    if "wall" in arm.scene.names:
        arm.scene.remove("wall")
    arm.move_to(START, duration=3.0)
    arm.scene.add_box("wall", (0.30, 0.02, 0.24), (0.30, 0.0, 0.12))
    return arm


def test_an_arm_moves_around_a_wall_and_back_to_a_pose(ready: Arm) -> None:
    begin = ready.pose()
    seen: list[float] = []
    stop = ready.on_state(lambda state: seen.append(ready.pose().position_m[2]))
    ready.follow(ready.plan({"shoulder_pan": 0.9}, speed=0.8))
    assert ready.state.position["shoulder_pan"] == pytest.approx(0.9, abs=0.05)
    assert max(seen) > begin.position_m[2] + 0.05  # over the wall
    ready.move_to(pose=ArmPose(begin.position_m), speed=0.8)
    stop()
    assert np.linalg.norm(np.subtract(ready.pose().position_m, begin.position_m)) < 0.02


def test_a_plan_is_refused_after_the_arm_has_moved(ready: Arm) -> None:
    plan = ready.plan({"shoulder_pan": -0.6})
    ready.move_to({"shoulder_lift": 0.1}, duration=1.0)
    before = ready.state.command
    with pytest.raises(PlanFailedError, match=r"shoulder_lift is at .*, but the plan begins at .*: plan again"):
        ready.follow(plan)
    assert ready.step(3).command == before


def test_a_plan_is_refused_after_an_object_came_into_its_way(ready: Arm) -> None:
    ready.scene.remove("wall")
    plan = ready.plan({"shoulder_pan": 0.9})
    ready.scene.add_box("wall", (0.30, 0.02, 0.24), (0.30, 0.0, 0.12))
    before = ready.state.command
    with pytest.raises(PlanFailedError, match=r"comes too close to wall after .* s: plan again"):
        ready.follow(plan)
    assert ready.step(3).command == before


def test_an_attached_object_moves_with_the_hand_and_stays_where_it_is_detached(ready: Arm) -> None:
    ready.scene.remove("wall")
    x, y, z = ready.pose().position_m
    ready.scene.add_sphere("ball", 0.01, (x, y, z))
    with pytest.raises(PlanFailedError, match="touches ball"):
        ready.plan({"shoulder_pan": -0.5})
    ready.attach("ball", touch_links=("wrist_link", "gripper_link", "moving_jaw_so101_v1_link"))
    assert ready.scene.attached == ("ball",) and "ball" not in ready.scene.names
    ready.follow(ready.plan({"shoulder_pan": -0.5}, speed=0.8))
    ready.detach("ball")
    assert "ball" in ready.scene.names
    with pytest.raises(PlanFailedError, match="touches ball"):
        ready.plan({"shoulder_pan": -0.7})
    ready.scene.remove("ball")
    ready.scene.add_box("wall", (0.30, 0.02, 0.24), (0.30, 0.0, 0.12))


def test_objects_come_from_a_file(ready: Arm, tmp_path: Path) -> None:
    file = tmp_path / "bench.yaml"
    file.write_text("objects:\n  lamp: {position_m: [0.0, 0.3, 0.2], cylinder: {height_m: 0.4, radius_m: 0.02}}\n")
    assert ready.scene.load(file) == ("lamp",)
    ready.scene.remove("lamp")
    with pytest.raises(PlanFailedError, match="there is no object lamp; the objects are: "):
        ready.scene.remove("lamp")


def test_bad_input_moves_nothing(ready: Arm) -> None:
    before = ready.state.command
    with pytest.raises(PlanFailedError, match="wall") as refused:
        ready.plan({"shoulder_pan": 0.0})
    assert refused.value.code == "GOAL_IN_COLLISION"
    with pytest.raises(PlanFailedError, match="cannot reach the goal: the nearest pose is"):
        ready.move_to(pose=ArmPose((2.0, 0.0, 0.1)))
    with pytest.raises(PlanFailedError, match="x of the goal's position is nan"):
        ready.plan(ArmPose((float("nan"), 0.0, 0.1)))
    with pytest.raises(PlanFailedError, match="has length 2"):
        ready.plan(ArmPose((0.2, 0.0, 0.1), (0.0, 0.0, 0.0, 2.0)))
    with pytest.raises(PlanFailedError, match="no body or site camera"):
        ready.plan(ArmPose((0.2, 0.0, 0.1), tool="camera"))
    with pytest.raises(PlanFailedError, match="every length must be positive"):
        ready.scene.add_box("flat", (0.1, 0.0, 0.1), (0.3, 0.3, 0.1))
    with pytest.raises(ArmInputError, match="no planning group moves joint gripper"):
        ready.plan({"gripper": 1.0})
    with pytest.raises(ArmInputError, match="either a target or a pose"):
        ready.move_to()
    assert ready.step(3).command == before


@pytest.mark.parametrize(
    ("add", "words"),
    [
        (lambda arm: arm.scene.add_box("box", (0.1, 0.1), (0.3, 0.3, 0.1)), "size_m must consist of 3 numbers, not"),
        (
            lambda arm: arm.scene.add_box("box", np.array(0.1), HERE),
            r"size_m must consist of 3 numbers, not array\(0.1",
        ),
        (lambda arm: arm.scene.add_mesh("mesh", None, HERE), "the file must be a path, not None"),
        (lambda arm: arm.scene.load(3), "the file must be a path, not 3"),
        (lambda arm: arm.attach("wall", touch_links=3), "touch_links must be a sequence of link names, not 3"),
        (lambda arm: arm.attach("wall", touch_links=[["base_link"]]), "touch_links must be a sequence of link names"),
        (lambda arm: arm.attach("wall", touch_links="base_link"), "touch_links must be a sequence of link names, not"),
        (lambda arm: arm.follow("motion"), "the trajectory must be an ArmTrajectory, not 'motion'"),
        (lambda arm: arm.scene.add_sphere("ball", "0.1", (0.3, 0.3, 0.1)), "radius_m must be a number, not '0.1'"),
        (lambda arm: arm.scene.add_cylinder("rod", None, 0.1, (0.3, 0.3, 0.1)), "height_m must be a number, not None"),
        (lambda arm: arm.plan(ArmPose(HERE, UPRIGHT, tolerance_rad=(0.1, 0.2))), "tolerance_rad must consist of 3 num"),
        (lambda arm: arm.plan(ArmPose(HERE, tolerance_m="1")), "tolerance_m must be a number, not '1'"),
    ],
)
def test_arguments_of_a_wrong_type_are_refused(ready: Arm, add: Callable[[Arm], object], words: str) -> None:
    with pytest.raises(ArmInputError, match=words):
        add(ready)


@pytest.mark.parametrize(
    ("add", "words"),
    [
        (lambda arm: arm.scene.add_sphere("ball", 0.1, (0.3, 0.3)), r"a position needs 3 numbers, not \(0.3, 0.3\)"),
        (lambda arm: arm.scene.add_box("box", (1, 1, 1), None), "a position needs 3 numbers, not None"),
        (lambda arm: arm.scene.add_box("box", (1, 1, 1), "123"), "a position needs 3 numbers, not '123'"),
        (lambda arm: arm.scene.add_box("box", (1, 1, 1), np.array(0.1)), r"a position needs 3 numbers, not array\(0.1"),
        (
            lambda arm: arm.scene.add_box("box", (1, 1, 1), (10**400, 0, 0)),
            r"pose \[inf, 0.0, 0.0\], .* must be finite",
        ),
        (lambda arm: arm.scene.add_box("box", (1, 1, 1), HERE, None), "a quaternion needs 4 numbers, not None"),
        (lambda arm: arm.scene.add_box(5, (1, 1, 1), HERE), "the name of an object is 5: use a string"),
        (lambda arm: arm.scene.add_sphere(None, 0.1, HERE), "the name of an object is None: use a string"),
        (lambda arm: arm.plan(ArmPose(None)), "the goal's position must consist of numbers, not None"),
        (lambda arm: arm.plan(ArmPose((10**400, 0, 0))), "x of the goal's position is inf: send a finite number"),
        (lambda arm: arm.plan(ArmPose(HERE, tool=3)), "the model has no body or site 3: choose one of"),
        (lambda arm: arm.plan(ArmPose(HERE, tool=["gripper_link"])), r"no body or site \['gripper_link'\]: choose one"),
        (lambda arm: arm.pose(3), "the model has no body or site 3: choose one of"),
        (lambda arm: arm.scene.remove(5), "there is no object 5; the objects are: "),
        (lambda arm: arm.scene.allow(5, "wall"), "there is no link or object 5: choose from"),
        (lambda arm: arm.attach(["wall"]), r"there is no object \['wall'\]; the objects are: "),
        (lambda arm: arm.detach(["wall"]), r"\"\['wall'\]\" is not attached; attached objects: none"),
        (lambda arm: arm.attach("wall", 3), 'the arm has no link "3": choose one of'),
        (lambda arm: arm.scene.add_box("box", (1, 1, 1), HERE, (0, 0, 1)), "a quaternion needs 4 numbers, not"),
        (lambda arm: arm.scene.add_sphere("ball", 0.1, ("a", "b", "c")), "a position needs 3 numbers, not"),
        (lambda arm: arm.plan(ArmPose(("a", "b", "c"))), "the goal's position must consist of numbers, not"),
        (lambda arm: arm.attach("table"), "table cannot be attached, because it contains a plane, a capsule or"),
        (lambda arm: arm.attach("sphere"), "there is no object sphere; the objects are: "),
    ],
)
def test_impossible_objects_are_refused(ready: Arm, add: Callable[[Arm], object], words: str) -> None:
    with pytest.raises(PlanFailedError, match=words):
        add(ready)


@pytest.mark.parametrize("limit", [float("nan"), float("inf"), 0.0, "5", True])
def test_a_search_needs_a_finite_time_limit(ready: Arm, limit: Any) -> None:
    with pytest.raises(ArmInputError, match="time_limit_s must be a"):
        ready.plan({"shoulder_pan": 0.9}, time_limit_s=limit)


def test_without_the_extra_a_plan_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ompl", None)
    with Arm.simulated("so101") as arm, pytest.raises(ArmSetupError, match=r"motion planning needs .*planning"):
        arm.plan({"shoulder_pan": 0.1})
