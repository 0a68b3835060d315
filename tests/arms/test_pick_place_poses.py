"""The tool poses in the files of the arms match the joint positions, and can be reached from above."""

from typing import Any

import numpy as np
import pytest
import yaml

from hal.rotations import matrices
from pick_place.pose_settings import PickObject, PoseSettings, above
from planning.kinematics.chain import ToolPose
from planning.kinematics.goals import PoseGoal, PositionSphere
from planning.motion import MotionRequest, ToolGoal
from servoloop.api.options import ArmOptions
from servoloop.motion_planning.robot import planning_robot
from servoloop.stack.arm_folders import find_arm
from servoloop.stack.pick_place import NODE, load_pick_place

ARMS = ("robot_arm", "so101")


def parameters_of(arm: str) -> dict[str, Any]:
    content = yaml.safe_load(find_arm(arm).pick_place_poses.read_text())
    parameters: dict[str, Any] = content[f"/**/{NODE}"]["ros__parameters"]
    assert parameters["motion"] == "poses"
    return parameters


def test_file_of_robot_arm_has_the_defaults() -> None:
    parameters, default = parameters_of("robot_arm"), PoseSettings()
    assert (tuple(parameters["joints"]), tuple(parameters["poses"]["ready"])) == (default.joints, default.ready_rad)
    assert tuple(parameters["pick"]["pose"]) == default.pick
    assert {grade: tuple(parameters["bins"][grade]["pose"]) for grade in parameters["grades"]} == default.bins
    planning = parameters["planning"]
    assert planning.pop("time_s") == default.planning_time_s
    assert planning == {name: getattr(default, name) for name in ("frame", "group", "tool_link", "approach_m", "speed")}
    target = parameters["object"]
    lists = (tuple(target[name]) for name in ("size", "position", "touch_links"))
    assert PickObject(target["name"], *lists) == default.target
    assert parameters["hand_time_s"] == default.hand_time_s


@pytest.mark.parametrize("arm", ARMS)
def test_poses_are_those_of_the_joint_positions_and_reachable_from_above(arm: str) -> None:
    parameters, joints = parameters_of(arm), load_pick_place(find_arm(arm).pick_place)
    robot, link = planning_robot(ArmOptions(arm).files()), parameters["planning"]["tool_link"]
    group = robot.group(parameters["planning"].get("group", PoseSettings().group))
    ready = {**robot.rest, **dict(zip(joints.joints, joints.poses.ready, strict=True))}
    places = {"pick": (joints.poses.pick, parameters["pick"]["pose"])}
    places |= {grade: (joints.bins[grade], parameters["bins"][grade]["pose"]) for grade in joints.grades}
    for name, (positions, pose) in places.items():
        placed = robot.link_poses([link], {**robot.rest, **dict(zip(joints.joints, positions, strict=True))})[link]
        np.testing.assert_allclose(pose[:3], placed.position_m, atol=1e-4, err_msg=name)
        np.testing.assert_allclose(matrices(np.array(pose[3:])), placed.matrix, atol=2e-4, err_msg=name)
        x, y, z, *upright = above(tuple(pose), parameters["planning"]["approach_m"])
        goal = PoseGoal(ToolPose(np.array([x, y, z]), np.array(upright)), PositionSphere(1e-3), (1e-2,) * 3)
        scene = robot.scene.without("cube")
        request = MotionRequest(start=ready, goals=[ToolGoal(goal, link)], scene=scene, remaining_s=lambda: 5.0)
        assert group.plan(request).path.duration_s > 0.0
