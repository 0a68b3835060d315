"""One robot plans for its arm and its hand, with goals for joints and for any link."""

from itertools import count

import numpy as np
import pytest

from hal.rotations import quaternions
from planning.kinematics.chain import ToolPose
from planning.kinematics.goals import PoseGoal, PositionSphere
from planning.motion import JointGoal, LineRequest, MotionRequest, State, ToolGoal
from planning.planning_errors import PlanningError
from planning.scene import Box, Pose, Scene, SceneObject, Sphere
from tests.planning.robots import robot_arm

ROBOT = robot_arm()
READY = {**ROBOT.rest, **ROBOT.groups.group("arm").states["ready"]}
SCENE = ROBOT.scene.without("cube")
FINGER = "hand_right_joint"


def request(start: State, *goals: JointGoal | ToolGoal, scene: Scene = SCENE) -> MotionRequest:
    ticks = count()
    return MotionRequest(start=start, goals=goals, scene=scene, remaining_s=lambda: 5.0 - 1e-5 * next(ticks))


def goal_at(state: State, link: str) -> PoseGoal:
    pose = ROBOT.link_poses([link], state)[link]
    tool = ToolPose(pose.position_m, quaternions(pose.matrix))
    return PoseGoal(tool, PositionSphere(0.005), (0.05, 0.05, 0.05))


def test_the_arm_moves_to_a_named_state_and_the_hand_stays() -> None:
    arm = ROBOT.group("arm")
    motion = arm.plan(request(READY, JointGoal(arm.group.state("upright"))))
    assert motion.end == pytest.approx({**READY, **arm.group.state("upright")})
    assert motion.search_s > 0.0


def test_the_hand_is_planned_as_a_group_of_one_joint() -> None:
    hand = ROBOT.group("hand")
    motion = hand.plan(request(READY, JointGoal(hand.group.state("close"))))
    assert motion.joints == (FINGER,)
    assert motion.end == pytest.approx({**READY, FINGER: 0.05})


@pytest.mark.parametrize("finger", ["hand_right_link", "hand_left_link"])
def test_a_finger_is_brought_to_a_pose_where_the_hand_is_now(finger: str) -> None:
    start = {**READY, FINGER: 0.03}
    wanted = {**start, "joint1": 0.4}
    motion = ROBOT.group("arm").plan(request(start, ToolGoal(goal_at(wanted, finger), finger)))
    reached = ROBOT.link_poses([finger], motion.end)[finger]
    asked = ROBOT.link_poses([finger], wanted)[finger]
    assert np.linalg.norm(reached.position_m - asked.position_m) <= 0.005
    assert motion.end[FINGER] == 0.03


def test_a_point_of_a_link_is_brought_to_a_position() -> None:
    offset_m = (0.0, 0.02, 0.05)
    pose = ROBOT.link_poses(["gripper_base_link"], READY)["gripper_base_link"]
    target = pose @ Pose(np.array([0.0, 0.03, 0.04]))
    goal = PoseGoal(ToolPose(target.position_m, np.array([0.0, 0, 0, 1])), PositionSphere(0.002), (4.0, 4.0, 4.0))
    end = ROBOT.group("arm").inverse(ToolGoal(goal, None, Pose(np.array(offset_m))), READY, SCENE)
    reached = ROBOT.link_poses(["gripper_base_link"], end)["gripper_base_link"] @ Pose(np.array(offset_m))
    assert np.linalg.norm(reached.position_m - target.position_m) <= 0.002


def test_goal_in_contact_names_the_link_and_the_object() -> None:
    wall = SceneObject("wall", ((Box(0.1, 0.1, 0.4), Pose()),), Pose(np.array([0.25, 0.0, 0.25])))
    goal = ToolGoal(goal_at(READY, "gripper_base_link"), "gripper_base_link")
    with pytest.raises(PlanningError, match=r"is in collision \(for example, (\w+ touches wall|wall touches \w+)"):
        ROBOT.group("arm").plan(request({**READY, "joint1": 1.5}, goal, scene=SCENE.with_object(wall)))


def test_tolerances_of_joints_are_used_if_the_goal_itself_is_outside_the_limits() -> None:
    highest = ROBOT.limits["joint1"].upper
    arm = ROBOT.group("arm")
    motion = arm.plan(request(READY, JointGoal({"joint1": highest + 0.01}, {"joint1": (0.02, 0.02)})))
    assert highest - 0.011 <= motion.end["joint1"] <= highest
    with pytest.raises(PlanningError, match="goal: joint1 is at"):
        arm.plan(request(READY, JointGoal({"joint1": highest + 0.01}, {"joint1": (0.001, 0.0)})))


def test_the_tool_moves_along_a_straight_line() -> None:
    begin = ROBOT.link_poses(["gripper_base_link"], READY)["gripper_base_link"]
    target = ToolPose(begin.position_m + np.array([0.0, 0.0, 0.04]), quaternions(begin.matrix))
    found = ROBOT.group("arm").straight(LineRequest(start=READY, waypoints=(target,), scene=SCENE))
    assert found.fraction == 1.0 and found.reason == "" and found.motion is not None
    positions = [
        ROBOT.link_poses(["gripper_base_link"], dict(zip(found.motion.joints, row, strict=True)) | {FINGER: 0.0})
        for row in found.motion.path.positions
    ]
    line = np.array([pose["gripper_base_link"].position_m for pose in positions]) - begin.position_m
    assert np.abs(line[:, :2]).max() < 1e-3
    assert line[-1] == pytest.approx([0.0, 0.0, 0.04], abs=1e-3)


def test_a_box_in_the_rest_of_a_motion_is_found_before_the_arm_reaches_it() -> None:
    arm = ROBOT.group("arm")
    motion = arm.plan(request(READY, JointGoal({"joint1": 1.2})))
    hand = ROBOT.link_poses(["gripper_base_link"], {**READY, "joint1": 0.8})["gripper_base_link"]
    box = SceneObject("box", ((Box(0.03, 0.03, 0.03), Pose()),), ROBOT.origin @ Pose(hand.position_m))
    blocked = SCENE.with_object(box)
    assert arm.future_contact(motion.path, 0.0, READY, SCENE) is None
    contact = arm.future_contact(motion.path, 0.0, READY, blocked)
    assert contact is not None and "box" in (contact.one, contact.other)
    before = dict(zip(motion.joints, motion.path.since(contact.time_s - 0.05)[1][0], strict=True))
    assert ROBOT.validity({**READY, **before}, blocked).is_valid
    assert arm.future_contact(motion.path, motion.path.duration_s, READY, blocked) is None


def test_a_state_is_checked_for_contacts_and_limits() -> None:
    assert ROBOT.validity(READY, SCENE).is_valid
    hand = ROBOT.link_poses(["gripper_base_link"], READY)["gripper_base_link"]
    box = SceneObject("box", ((Box(0.03, 0.03, 0.03), Pose()),), ROBOT.origin @ Pose(hand.position_m))
    found = ROBOT.validity({**READY, "joint6": 9.0}, SCENE.with_object(box))
    assert {touch.other for touch in found.touches} == {"box"} and found.clearance_m <= 0.0
    assert found.outside.startswith("joint6 is at 9.0000, outside its limits")


def test_the_hand_is_not_valid_if_its_mimic_finger_touches_an_object() -> None:
    state = {**READY, FINGER: 0.03}
    finger = ROBOT.link_poses(["hand_left_link"], state)["hand_left_link"]
    ball = SceneObject("ball", ((Sphere(0.002), Pose()),), ROBOT.origin @ finger)
    for group in ("hand", "arm", ""):
        touches = ROBOT.validity(state, SCENE.with_object(ball), group).touches
        assert [(touch.one, touch.other) for touch in touches] == [("hand_left_link", "ball")], group


def test_names_that_do_not_exist_are_refused_with_those_that_do() -> None:
    with pytest.raises(PlanningError, match="no joint elbow: choose from joint1"):
        ROBOT.state({**READY, "elbow": 0.0})
    with pytest.raises(PlanningError, match="no position for joint6: add the position"):
        ROBOT.state({name: 0.0 for name in READY if name != "joint6"})
    with pytest.raises(PlanningError, match="position of joint1 is nan"):
        ROBOT.state({**READY, "joint1": float("nan")})
    with pytest.raises(PlanningError, match='no frame "camera": choose one of base_link'):
        ROBOT.frame_pose("camera", READY)
    with pytest.raises(PlanningError, match="no group legs: choose one of arm, hand"):
        ROBOT.group("legs")
    with pytest.raises(PlanningError, match="group hand has no tip: specify a link"):
        ROBOT.group("hand").chain(None, READY)
    with pytest.raises(PlanningError, match="no joint of the group hand moves link3"):
        ROBOT.group("hand").chain("link3", READY)
