"""Tests of requests for frames that move with a link: attached objects, their subframes and fixed links."""

from collections.abc import Sequence

import numpy as np
import pytest
from geometry_msgs.msg import Pose, PoseStamped
from moveit_msgs.msg import (
    AttachedCollisionObject,
    Constraints,
    MotionPlanRequest,
    OrientationConstraint,
    PositionConstraint,
    PositionIKRequest,
)
from moveit_msgs.srv import GetCartesianPath
from shape_msgs.msg import SolidPrimitive
from std_msgs.msg import Header

from nodes.planning.conversion.frames import Frames
from nodes.planning.conversion.poses import pose_message
from nodes.planning.edits import WorldEdit
from nodes.planning.request_errors import REFUSALS
from nodes.planning.requests import Requests, Snapshot
from nodes.planning.world import PlanningWorld, first_world
from planning.motion import State
from planning.scene import Pose as FramePose
from tests.nodes.planning.robots import READY, at, box, robot_arm

TIP = "gripper_base_link"
HELD = ["cup", "cup/handle"]
"""An attached object, and a subframe that is turned and 0.05 m beside it."""
THERE = {**READY, "joint1": 0.4, "joint2": -0.2, "joint5": -0.7}

TURNED = {**READY, "joint2": -0.25, "joint4": -0.9, "joint6": -1.2}


def holding() -> PlanningWorld:
    """Return a world in which the gripper holds a cup."""
    cup = box("cup", at(0.0, 0.02, 0.08), 0.03, frame=TIP)
    cup.subframe_names, cup.subframe_poses = ["handle"], [at(0.05, 0.0, 0.0, (0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)))]
    change = WorldEdit(robot_arm(), first_world(robot_arm()), lambda: READY)
    links = [TIP, "hand_right_link", "hand_left_link"]
    change.apply_attached(AttachedCollisionObject(link_name=TIP, object=cup, touch_links=links))
    return change.world


def pose_in(state: State, frame: str) -> FramePose:
    world = holding()
    return Frames(robot_arm(), state, world.scene, world.items).in_base(frame)


def pose_goal(link: str, pose: Pose) -> Constraints:
    header = Header(frame_id="base_link")
    position = PositionConstraint(header=header, link_name=link)
    position.constraint_region.primitives = [SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[1e-3])]
    position.constraint_region.primitive_poses = [Pose(position=pose.position)]
    turned = OrientationConstraint(header=header, link_name=link, orientation=pose.orientation)
    turned.absolute_x_axis_tolerance = turned.absolute_y_axis_tolerance = turned.absolute_z_axis_tolerance = 0.01
    return Constraints(position_constraints=[position], orientation_constraints=[turned])


def assert_near(frame: str, state: State, goal: FramePose, within_m: float = 2e-3) -> None:
    found = pose_in(state, frame)
    assert found.position_m == pytest.approx(goal.position_m, abs=within_m)
    assert found.matrix == pytest.approx(goal.matrix, abs=0.02)


@pytest.mark.parametrize("frame", HELD)
def test_an_attached_object_is_brought_to_a_pose(frame: str) -> None:
    goal, now = pose_in(THERE, frame), Snapshot(holding(), READY)
    request = MotionPlanRequest(group_name="arm", goal_constraints=[pose_goal(frame, pose_message(goal))])
    assert_near(frame, Requests(robot_arm()).motion(request, now, lambda: 5.0).motion.end, goal)
    stamped = PoseStamped(header=Header(frame_id="base_link"), pose=pose_message(goal))
    asked = PositionIKRequest(group_name="arm", ik_link_name=frame, pose_stamped=stamped, avoid_collisions=True)
    assert_near(frame, Requests(robot_arm()).inverse(asked, now), goal)


def test_frames_that_do_not_move_with_a_link_are_refused() -> None:
    for frame in ("cup/lid", "table"):
        request = MotionPlanRequest(group_name="arm", goal_constraints=[pose_goal(frame, at(0.2, 0.0, 0.2))])
        with pytest.raises(REFUSALS, match=f'there is no link "{frame}": choose one of .*, cup'):
            Requests(robot_arm()).motion(request, Snapshot(holding(), READY), lambda: 5.0)


def line(link: str, frame: str, waypoints: Sequence[Pose]) -> tuple[float, str, list[State]]:
    """Return the completed fraction of a straight path, the reason for its early end, and its states."""
    request = GetCartesianPath.Request(group_name="arm", link_name=link, max_step=0.005, waypoints=list(waypoints))
    request.header.frame_id = frame
    _, found = Requests(robot_arm()).straight(request, Snapshot(holding(), READY))
    assert found.motion is not None, found.reason
    joints = found.motion.joints
    return (
        found.fraction,
        found.reason,
        [{**READY, **dict(zip(joints, row, strict=True))} for row in found.motion.path.positions.tolist()],
    )


@pytest.mark.parametrize("frame", HELD)
def test_an_attached_object_moves_straight_while_it_turns(frame: str) -> None:
    start, goal = pose_in(READY, frame), pose_in(TURNED, frame)
    fraction, reason, states = line(frame, "base_link", [pose_message(goal)])
    assert fraction == pytest.approx(1.0), reason
    assert_near(frame, states[-1], goal)
    along = (goal.position_m - start.position_m) / np.linalg.norm(goal.position_m - start.position_m)
    for state in states[:: max(1, len(states) // 8)]:
        offset_m = pose_in(state, frame).position_m - start.position_m
        assert offset_m == pytest.approx(along * (along @ offset_m), abs=1.5e-3)


def test_waypoints_in_the_frame_of_the_link_follow_each_other() -> None:
    step = at(0.0, 0.0, 0.015)
    _, _, states = line(TIP, TIP, [step, step])
    start, end = pose_in(READY, TIP), pose_in(states[-1], TIP)
    assert end.position_m == pytest.approx(start.position_m + start.matrix @ [0.0, 0.0, 0.03], abs=2e-3)
