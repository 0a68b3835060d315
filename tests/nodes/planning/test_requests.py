"""Tests of states, goals and trajectories as messages."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, Quaternion, Vector3
from moveit_msgs.msg import (
    AttachedCollisionObject,
    Constraints,
    JointConstraint,
    MotionPlanRequest,
    MoveItErrorCodes,
    OrientationConstraint,
    PositionConstraint,
    PositionIKRequest,
    RobotState,
    VisibilityConstraint,
)
from moveit_msgs.srv import GetStateValidity
from sensor_msgs.msg import JointState
from shape_msgs.msg import SolidPrimitive
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from nodes.planning.conversion.constraints import ConstraintReader
from nodes.planning.conversion.frames import Frames
from nodes.planning.conversion.poses import pose_message
from nodes.planning.conversion.semantic import srdf_text
from nodes.planning.conversion.trajectories import checked_points, duration, part, timed_path
from nodes.planning.edits import WorldEdit
from nodes.planning.request_errors import REFUSALS, error_code
from nodes.planning.requests import Requests, Snapshot
from nodes.planning.states import state_message, state_of, world_of
from nodes.planning.world import first_world
from planning.kinematics.goals import PositionBox, PositionSphere
from planning.motion import JointGoal, ToolGoal
from planning.srdf_file import read_srdf
from tests.nodes.planning.robots import READY, at, box, robot_arm


def reader() -> ConstraintReader:
    robot = robot_arm()
    return ConstraintReader(robot, Frames(robot, READY, robot.scene), "gripper_base_link")


def joint(name: str, position: float, tolerance: float = 0.01) -> Constraints:
    one = JointConstraint(joint_name=name, position=position, tolerance_above=tolerance, tolerance_below=tolerance)
    return Constraints(joint_constraints=[one])


def position(x: float, y: float, z: float, frame: str = "base_link", **region: float) -> PositionConstraint:
    sphere = SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[region.get("radius", 0.005)])
    message = PositionConstraint(header=Header(frame_id=frame), link_name="gripper_base_link", weight=1.0)
    message.constraint_region.primitives = [sphere]
    message.constraint_region.primitive_poses = [at(x, y, z)]
    return message


def orientation(w: float = 1.0, tolerance: float = 0.05, **fields: object) -> OrientationConstraint:
    x, y, z = [tolerance] * 3
    return OrientationConstraint(
        header=Header(frame_id="base_link"),
        link_name=fields.get("link_name", "gripper_base_link"),
        orientation=Quaternion(w=w),
        absolute_x_axis_tolerance=x,
        absolute_y_axis_tolerance=y,
        absolute_z_axis_tolerance=z,
        parameterization=fields.get("parameterization", 0),
    )


def test_joint_positions_are_a_goal() -> None:
    (goal,) = reader().goals(joint("joint2", -0.5, 0.02))
    assert isinstance(goal, JointGoal)
    assert (goal.positions, goal.tolerances) == ({"joint2": -0.5}, {"joint2": (0.02, 0.02)})


def test_a_pose_is_a_goal() -> None:
    pose = Constraints(position_constraints=[position(0.2, 0.0, 0.3)], orientation_constraints=[orientation()])
    (goal,) = reader().goals(pose)
    assert isinstance(goal, ToolGoal)
    assert goal.goal.pose.position_m.tolist() == [0.2, 0.0, 0.3]
    assert goal.goal.region == PositionSphere(0.005)
    assert (goal.goal.orientation_tolerance_rad, goal.goal.angles) == ((0.05, 0.05, 0.05), "xyz_euler")


def test_a_position_alone_leaves_the_orientation_free() -> None:
    (goal,) = reader().goals(Constraints(position_constraints=[position(0.2, 0.0, 0.3)]))
    assert goal.goal.orientation_tolerance_rad == (math.pi,) * 3


def test_an_orientation_alone_leaves_the_position_free() -> None:
    (goal,) = reader().goals(Constraints(orientation_constraints=[orientation(parameterization=1)]))
    assert goal.goal.region.radius_m > 100.0
    assert goal.goal.angles == "rotation_vector"


def test_a_goal_in_the_frame_of_a_link_is_converted() -> None:
    frames = Frames(robot_arm(), READY, robot_arm().scene)
    (goal,) = reader().goals(Constraints(position_constraints=[position(0.0, 0.0, 0.01, "gripper_base_link")]))
    tool = frames.in_base("gripper_base_link")
    assert goal.goal.pose.position_m == pytest.approx(tool.position_m + tool.matrix @ [0.0, 0.0, 0.01])


def test_each_shape_of_a_region_is_a_goal() -> None:
    message = position(0.2, 0.0, 0.3)
    message.constraint_region.primitives.append(SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[0.1, 0.2, 0.3]))
    message.constraint_region.primitive_poses.append(at(0.0, 0.2, 0.3))
    message.target_point_offset = Vector3(z=0.1)
    goals = reader().goals(Constraints(position_constraints=[message]))
    assert [type(goal.goal.region) for goal in goals] == [PositionSphere, PositionBox]
    assert goals[1].goal.region.size_m == (0.1, 0.2, 0.3)
    assert goals[1].offset.position_m.tolist() == [0.0, 0.0, 0.1]


def test_constraints_of_a_path() -> None:
    message = joint("joint2", -0.5, 0.2)
    message.orientation_constraints = [orientation(tolerance=0.3)]
    found = reader().path(message)
    assert found.joints == {"joint2": (-0.7, -0.3)}
    assert found.regions[0].link == "gripper_base_link"
    assert reader().path(Constraints()).joints == {}


BAD = [
    (Constraints(), "INVALID_GOAL_CONSTRAINTS", "no constraint"),
    (joint("joint9", 0.0), "INVALID_GOAL_CONSTRAINTS", 'no joint "joint9": choose one of joint1, joint2'),
    (joint("joint1", math.nan), "INVALID_GOAL_CONSTRAINTS", "the position of joint1 is nan"),
    (joint("joint1", 0.0, -1.0), "INVALID_GOAL_CONSTRAINTS", "tolerance_below of joint1 is -1"),
    (Constraints(position_constraints=[position(math.nan, 0.0, 0.3)]), "INVALID_GOAL_CONSTRAINTS", "must be finite"),
    (Constraints(position_constraints=[position(0.2, 0.0, 0.3, "moon")]), "FRAME_TRANSFORM_FAILURE", '"moon"'),
    (Constraints(position_constraints=[position(0.2, 0.0, 0.3, radius=-1.0)]), "INVALID_GOAL_CONSTRAINTS", "is -1.0"),
    (Constraints(orientation_constraints=[orientation(0.0)]), "INVALID_GOAL_CONSTRAINTS", "has length 0"),
    (Constraints(orientation_constraints=[orientation(2.0)]), "INVALID_GOAL_CONSTRAINTS", "has length 2"),
    (Constraints(orientation_constraints=[orientation(link_name="l")]), "INVALID_LINK_NAME", 'no link "l": choose one'),
    (Constraints(visibility_constraints=[VisibilityConstraint()]), "UNRECOGNIZED_GOAL_TYPE", "visibility"),
]


@pytest.mark.parametrize(("message", "code", "text"), BAD)
def test_invalid_goals_are_refused(message: Constraints, code: str, text: str) -> None:
    with pytest.raises(REFUSALS, match=text) as caught:
        reader().goals(message)
    assert error_code(caught.value).val == getattr(MoveItErrorCodes, code)


def test_a_state_keeps_the_joints_that_it_does_not_name() -> None:
    message = RobotState(joint_state=JointState(name=["joint1"], position=[0.3]))
    assert state_of(robot_arm(), message, READY) == {**READY, "joint1": 0.3}
    assert state_of(robot_arm(), RobotState(), READY) == READY


def test_the_message_of_a_state_has_mimic_joints_and_can_be_read() -> None:
    message = state_message(robot_arm(), {**READY, "hand_right_joint": 0.02})
    assert dict(zip(message.joint_state.name, message.joint_state.position, strict=True))["hand_left_joint"] == 0.02
    assert state_of(robot_arm(), message, READY)["hand_right_joint"] == 0.02


@pytest.mark.parametrize(
    ("names", "positions", "text"),
    [
        (["joint1"], [], "1 joints and 0 positions"),
        (["elbow"], [0.0], "there is no joint elbow: choose from joint1"),
        (["joint1"], [math.inf], "the position of joint1 is inf"),
    ],
)
def test_invalid_states_are_refused(names: list[str], positions: list[float], text: str) -> None:
    message = RobotState(joint_state=JointState(name=names, position=positions))
    with pytest.raises(REFUSALS, match=text) as caught:
        state_of(robot_arm(), message, READY)
    assert error_code(caught.value).val == MoveItErrorCodes.INVALID_ROBOT_STATE


def test_the_objects_of_a_start_state_are_attached() -> None:
    hold = AttachedCollisionObject(link_name="gripper_base_link", object=box("crate", at(0.0, 0.0, 0.1)))
    world = first_world(robot_arm())
    changed = world_of(robot_arm(), RobotState(attached_collision_objects=[hold]), world, READY)
    assert "crate" in changed.scene.attached
    assert "crate" not in world.scene.attached


def trajectory(*positions: float, step_s: float = 0.5) -> JointTrajectory:
    points = [
        JointTrajectoryPoint(positions=[at_rad, -at_rad], time_from_start=duration(number * step_s))
        for number, at_rad in enumerate(positions)
    ]
    return JointTrajectory(joint_names=["joint2", "joint1"], points=points)


def test_a_clients_trajectory_becomes_a_path() -> None:
    path = timed_path(trajectory(0.0, 0.5, 1.0), ["joint1", "joint2", "joint3"], [0.0, 0.0, 0.7])
    assert path.times_s.tolist() == [0.0, 0.5, 1.0]
    assert path.positions.tolist() == [[0.0, 0.0, 0.7], [-0.5, 0.5, 0.7], [-1.0, 1.0, 0.7]]
    times_s, _ = path.since(0.6)
    assert times_s.tolist() == [0.6, 1.0]
    single = timed_path(trajectory(1.0), ["joint1", "joint2"], [0.0, 0.0])
    assert np.all(np.diff(single.times_s) > 0.0)


def test_a_part_of_a_trajectory() -> None:
    own = part(trajectory(0.0, 0.5), ["joint1"])
    assert [list(point.positions) for point in own.points] == [[0.0], [-0.5]]


@pytest.mark.parametrize(
    ("message", "text"),
    [
        (JointTrajectory(joint_names=["joint1"]), "no points"),
        (trajectory(0.0, math.nan), "point 1: the position of joint2 is nan"),
        (trajectory(0.0, 0.5, step_s=0.0), "point 1 is at 0 s"),
        (JointTrajectory(joint_names=["joint1"] * 2, points=trajectory(0.0).points), "names a joint twice"),
        (
            JointTrajectory(
                joint_names=["joint1"], points=[JointTrajectoryPoint(positions=[0.0], velocities=[0.0] * 2)]
            ),
            "point 0 has invalid velocities",
        ),
    ],
)
def test_invalid_trajectories_are_refused(message: JointTrajectory, text: str) -> None:
    with pytest.raises(REFUSALS, match=text):
        checked_points(message)


def test_the_semantic_description_has_the_groups_of_the_robot(tmp_path) -> None:
    robot = robot_arm()
    path = tmp_path / "robot.srdf"
    path.write_text(srdf_text(robot))
    read = read_srdf(path, robot.description)
    assert read.groups == robot.groups.groups
    assert read.end_effectors == robot.groups.end_effectors


@pytest.mark.parametrize(
    ("constraints", "text"),
    [
        (Constraints(), ""),
        (joint("joint2", -0.36, 0.01), ""),
        (joint("joint2", 0.5), "joint2 is at -0.3643, outside"),
        (Constraints(position_constraints=[position(0.25, 0.0, 0.23, radius=0.1)]), ""),
        (
            Constraints(position_constraints=[position(0.25, 0.2, 0.23, radius=0.1)]),
            "gripper_base_link is outside its path constraint, 0.2",
        ),
    ],
)
def test_a_state_is_checked_against_constraints(constraints: Constraints, text: str) -> None:
    now = Snapshot(first_world(robot_arm()), READY)
    found, results, _ = Requests(robot_arm()).validity(GetStateValidity.Request(constraints=constraints), now)
    assert found.is_valid
    broken = next((one.text for one in results if one.text), "")
    assert broken.startswith(text)
    assert bool(broken) == bool(text)


def test_each_constraint_of_a_state_has_a_result() -> None:
    constraints = joint("joint2", -0.36, 0.01)
    constraints.joint_constraints += [*joint("joint1", 0.015, 0.01).joint_constraints]
    constraints.position_constraints = [position(0.25, 0.2, 0.23, radius=0.1)]
    constraints.orientation_constraints = [orientation(tolerance=3.2, link_name="hand_left_link")]
    now = Snapshot(first_world(robot_arm()), READY)
    request = GetStateValidity.Request(constraints=constraints, group_name="arm")
    _, results, _ = Requests(robot_arm()).validity(request, now)
    assert [not one.text for one in results] == [True, False, False, True]
    assert [one.distance for one in results[:3]] == pytest.approx([0.0043, 0.015, 0.2], abs=2e-3)


def test_a_state_of_a_group_is_checked_only_for_contacts_of_the_group() -> None:
    change = WorldEdit(robot_arm(), first_world(robot_arm()), lambda: READY)
    place = Frames(robot_arm(), READY, robot_arm().scene).in_base("link3").position_m
    change.apply_object(box("crate", at(*place)))
    now = Snapshot(change.world, READY)
    valid = {
        group: Requests(robot_arm()).validity(GetStateValidity.Request(group_name=group), now)[0].is_valid
        for group in ("", "arm", "hand")
    }
    assert valid == {"": False, "arm": False, "hand": True}


def test_inverse_kinematics_looks_for_a_solution_within_the_constraints() -> None:
    robot, now = robot_arm(), Snapshot(first_world(robot_arm()), READY)
    pose = pose_message(Frames(robot, READY, robot.scene).in_base("gripper_base_link"))
    request = PositionIKRequest(group_name="arm", pose_stamped=PoseStamped(pose=pose))
    request.constraints = joint("joint2", -1.4, 0.01)
    assert Requests(robot).inverse(request, now)["joint2"] == pytest.approx(-1.4, abs=0.011)
    turned = orientation(link_name="link3", tolerance=0.2)
    bent = Frames(robot, {**READY, "joint2": -0.04, "joint3": -1.37}, robot.scene).in_base("link3")
    turned.orientation = pose_message(bent).orientation
    request.constraints = Constraints(orientation_constraints=[turned])
    assert Requests(robot).inverse(request, now)["joint3"] < -1.0
    request.constraints.orientation_constraints[0].link_name = "link1"
    with pytest.raises(REFUSALS, match="link1 is outside its path constraint") as caught:
        Requests(robot).inverse(request, now)
    assert error_code(caught.value).val == MoveItErrorCodes.NO_IK_SOLUTION


def test_a_pose_in_contact_has_no_inverse_kinematics() -> None:
    change = WorldEdit(robot_arm(), first_world(robot_arm()), lambda: READY)
    pose = pose_message(Frames(robot_arm(), READY, robot_arm().scene).in_base("gripper_base_link"))
    change.apply_object(box("crate", pose))
    request = PositionIKRequest(group_name="arm", pose_stamped=PoseStamped(pose=pose))
    Requests(robot_arm()).inverse(request, Snapshot(change.world, READY))
    request.avoid_collisions = True
    with pytest.raises(REFUSALS, match="touches crate") as caught:
        Requests(robot_arm()).inverse(request, Snapshot(change.world, READY))
    assert error_code(caught.value).val == MoveItErrorCodes.NO_IK_SOLUTION


def test_a_slower_tool_takes_longer_along_the_same_path() -> None:
    now = Snapshot(first_world(robot_arm()), READY)
    request = MotionPlanRequest(group_name="arm", goal_constraints=[joint("joint1", 0.8)])
    fast = Requests(robot_arm()).motion(request, now, lambda: 5.0).motion
    request.max_cartesian_speed = 0.05
    slow = Requests(robot_arm()).motion(request, now, lambda: 5.0).motion
    assert slow.path.positions == pytest.approx(fast.path.positions)
    length_m = 0.25 * 0.8
    assert slow.path.duration_s > length_m / 0.05 > fast.path.duration_s


@pytest.mark.parametrize("factor", [math.nan, 1e-300])
def test_invalid_scaling_factors_are_refused(factor: float) -> None:
    now = Snapshot(first_world(robot_arm()), READY)
    request = MotionPlanRequest(group_name="arm", goal_constraints=[joint("joint1", 0.8)])
    request.max_velocity_scaling_factor = factor
    with pytest.raises(REFUSALS, match="the velocity scaling factor is"):
        Requests(robot_arm()).motion(request, now, lambda: 5.0)
