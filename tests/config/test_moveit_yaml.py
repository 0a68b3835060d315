"""Tests that the YAML files in config/moveit use existing names, and the documented shares of the limits."""

from typing import Final

import mujoco
import numpy as np
import pytest

from hal.robot_file.robot_file import load_robot_file
from sim_backend.scene.world import World
from tests.config.arm import ARM, CONFIG, DESCRIPTION, LINKS, MOVEIT, controllers, groups, read

VELOCITY_SHARE: Final = 0.9
ACCELERATION_SHARE: Final = 0.8
"""Share of the stack's acceleration limits with which MoveIt plans, as in joint_limits.yaml."""


@pytest.mark.parametrize("name", ["robot_arm", "robot_arm_dynamixel", "robot_arm_two_buses"])
def test_limits_are_shares_of_those_in_the_urdf_and_every_robot_file(name: str) -> None:
    limits = read(MOVEIT / "joint_limits.yaml")
    robot = load_robot_file(CONFIG / f"{name}.yaml")
    assert list(limits["joint_limits"]) == list(robot.joints)
    for joint, file in robot.joints.items():
        assert limits["joint_limits"][joint] == {
            "has_velocity_limits": True,
            "max_velocity": pytest.approx(VELOCITY_SHARE * DESCRIPTION.joints[joint].velocity),
            "has_acceleration_limits": True,
            "max_acceleration": pytest.approx(ACCELERATION_SHARE * file.acceleration),
            "has_jerk_limits": True,
            "max_jerk": file.jerk,
        }
    assert 0 < limits["default_velocity_scaling_factor"] <= 1
    assert 0 < limits["default_acceleration_scaling_factor"] <= 1


def test_numbers_are_written_as_floating_point_numbers() -> None:
    """ROS parameters are typed, so MoveIt rejects or ignores an integer here."""
    limits = read(MOVEIT / "joint_limits.yaml")
    numbers = [value for joint in limits["joint_limits"].values() for key, value in joint.items() if "max" in key]
    numbers += [value for name, value in limits.items() if name.startswith("default_")]
    numbers += [read(MOVEIT / "kinematics.yaml")["arm"]["epsilon"]]
    ompl = read(MOVEIT / "ompl_planning.yaml")
    numbers += [ompl[group]["longest_valid_segment_fraction"] for group in groups()]
    assert {type(number) for number in numbers} == {float}


def test_paths_are_checked_more_closely_than_links_are_padded() -> None:
    """Between two checks, the hand of the stretched arm moves no further than the padding extends.

    OMPL computes the size of the space, and a step in it, as the sum over all joints.
    """
    limits = read(MOVEIT / "joint_limits.yaml")
    size = sum(DESCRIPTION.joints[joint].upper - DESCRIPTION.joints[joint].lower for joint in ARM)
    step = size * read(MOVEIT / "ompl_planning.yaml")["arm"]["longest_valid_segment_fraction"]
    assert step == pytest.approx(0.0564, abs=1e-4)
    reach = 0.52  # m, from the shoulder to the fingertips
    assert step * reach / 2 < limits["default_robot_padding"]  # from the middle of a step to its two ends


def test_moveit_uses_the_controllers_of_the_stack() -> None:
    file = read(MOVEIT / "moveit_controllers.yaml")
    assert file["moveit_controller_manager"] == "moveit_simple_controller_manager/MoveItSimpleControllerManager"
    manager = file["moveit_simple_controller_manager"]
    assert manager["controller_names"] == [name for name in manager if name != "controller_names"]
    types = controllers()["controller_manager"]["ros__parameters"]
    wanted = {"type": "joint_trajectory_controller/JointTrajectoryController"}
    trajectory = [name for name, entry in types.items() if entry == wanted]
    assert manager["controller_names"] == trajectory
    for name in trajectory:
        entry = manager[name]
        assert (entry["type"], entry["action_ns"]) == ("FollowJointTrajectory", "follow_joint_trajectory")
        assert entry["default"] is True
        assert entry["joints"] == controllers()[name]["ros__parameters"]["joints"]


def test_moveit_waits_for_the_longest_wait_of_the_arm_for_the_hand() -> None:
    execution = read(MOVEIT / "moveit_controllers.yaml")["trajectory_execution"]
    defaults = load_robot_file(CONFIG / "robot_arm.yaml").controller_defaults["arm_controller"]
    assert execution["allowed_goal_duration_margin"] >= defaults["wait_for_timeout"] + 0.5
    assert execution["allowed_start_tolerance"] <= 0.01


def test_kinematics_and_planners_are_for_groups_that_exist() -> None:
    assert set(read(MOVEIT / "kinematics.yaml")) == {"arm"}
    ompl = read(MOVEIT / "ompl_planning.yaml")
    known = ompl["planner_configs"]
    for group in groups():
        assert set(ompl[group]["planner_configs"]) <= set(known)
        assert ompl[group]["default_planner_config"] in known
    for name, planner in known.items():
        assert planner["type"] == f"geometric::{name}"


def test_rviz_shows_this_arm() -> None:
    manager = read(MOVEIT / "moveit.rviz")["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] in LINKS
    (planning,) = [display for display in manager["Displays"] if "MotionPlanning" in display["Class"]]
    assert planning["Planning Request"]["Planning Group"] in groups()
    scale = read(MOVEIT / "joint_limits.yaml")["default_velocity_scaling_factor"]
    assert planning["Velocity_Scaling_Factor"] == scale


def test_the_arm_reaches_five_dimensions_as_stated_in_kinematics_yaml() -> None:
    random = np.random.default_rng(3)
    ranks = set()
    for _ in range(50):
        world = World(initial_position=[*random.uniform(-1.5, 1.5, 6), 0.0])
        position, rotation = np.zeros((3, world.model.nv)), np.zeros((3, world.model.nv))
        body = world.model.body("gripper_base_link").id
        mujoco.mj_jacBody(world.model, world.data, position, rotation, body)
        columns = [int(world.model.joint(name).dofadr[0]) for name in ARM]
        ranks.add(int(np.linalg.matrix_rank(np.vstack((position, rotation))[:, columns], tol=1e-6)))
    assert ranks == {5}
