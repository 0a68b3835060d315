"""Tests of the planning server with a stack and a client that uses MoveIt's interfaces."""

import os
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

pytest.importorskip("moveit_msgs")
pytest.importorskip("ompl")

from geometry_msgs.msg import PoseStamped
from moveit_msgs.action import ExecuteTrajectory, MoveGroup
from moveit_msgs.msg import DisplayTrajectory, MoveItErrorCodes, PlanningSceneComponents, RobotState
from moveit_msgs.srv import (
    GetCartesianPath,
    GetMotionPlan,
    GetPlanningScene,
    GetPositionFK,
    GetPositionIK,
    GetStateValidity,
)
from rcl_interfaces.srv import GetParameters
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from nodes.publishing import LATCHED
from tests.ros.plan_client import READY, PlanClient, box, joint_constraints, joint_goal, planning_stack, remove
from tests.ros.stack_process import StackProcess, running, until

SUCCESS = MoveItErrorCodes.SUCCESS


@pytest.fixture(scope="module")
def client(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlanClient]:
    with planning_stack(tmp_path_factory.mktemp("plan")) as client:
        yield client


@pytest.fixture
def ready(client: PlanClient) -> PlanClient:
    """Provide the client, with the arm in the ready pose."""
    assert client.run(joint_goal(**READY)).error_code.val == SUCCESS
    return client


def slow_goal() -> MoveGroup.Goal:
    """Return a goal whose motion takes several seconds."""
    goal = joint_goal(**{**READY, "joint1": 1.5})
    goal.request.max_velocity_scaling_factor = goal.request.max_acceleration_scaling_factor = 0.1
    return goal


def tool(client: PlanClient) -> PoseStamped:
    request = GetPositionFK.Request(fk_link_names=["gripper_base_link"])
    answer = client.call(GetPositionFK, "/compute_fk", request)
    assert answer.error_code.val == SUCCESS
    return answer.pose_stamped[0]


def positions(client: PlanClient) -> dict[str, float]:
    parts = PlanningSceneComponents(components=PlanningSceneComponents.ROBOT_STATE)
    state = client.call(GetPlanningScene, "/get_planning_scene", GetPlanningScene.Request(components=parts))
    joints = state.scene.robot_state.joint_state
    return dict(zip(joints.name, joints.position, strict=True))


@pytest.mark.runs("servoloop plan-server")
def test_joint_goals_move_the_arm_and_the_plan_is_shown(ready: PlanClient) -> None:
    shown: list[DisplayTrajectory] = []
    ready.node.create_subscription(DisplayTrajectory, "/display_planned_path", shown.append, LATCHED)
    result = ready.run(joint_goal(**{**READY, "joint1": 0.4}))
    assert result.error_code.val == SUCCESS
    assert positions(ready)["joint1"] == pytest.approx(0.4, abs=0.01)
    ready.spin(0.3)
    assert shown[-1].trajectory[0].joint_trajectory.points[-1].positions[0] == pytest.approx(0.4, abs=2e-3)


def test_the_hand_is_a_group(ready: PlanClient) -> None:
    assert ready.run(joint_goal("hand", hand_right_joint=0.03)).error_code.val == SUCCESS
    assert positions(ready)["hand_right_joint"] == pytest.approx(0.03, abs=0.003)
    assert ready.run(joint_goal("hand", hand_right_joint=0.0)).error_code.val == SUCCESS


def test_kinematics_and_a_straight_path_lead_to_the_pose(ready: PlanClient) -> None:
    pose = tool(ready)
    pose.pose.position.z += 0.02
    inverse = GetPositionIK.Request()
    inverse.ik_request.group_name, inverse.ik_request.pose_stamped = "arm", pose
    inverse.ik_request.avoid_collisions = True
    assert ready.call(GetPositionIK, "/compute_ik", inverse).error_code.val == SUCCESS
    shown: list[DisplayTrajectory] = []
    ready.node.create_subscription(DisplayTrajectory, "/display_planned_path", shown.append, LATCHED)
    straight = GetCartesianPath.Request(group_name="arm", waypoints=[pose.pose], max_step=0.005, avoid_collisions=True)
    straight.start_state.is_diff = True
    found = ready.call(GetCartesianPath, "/compute_cartesian_path", straight)
    assert found.fraction == pytest.approx(1.0), found.error_code.message
    ready.spin(0.3)
    assert shown[-1].trajectory[0] == found.solution
    done = ready.run(ExecuteTrajectory.Goal(trajectory=found.solution))
    assert done.error_code.val == SUCCESS
    assert tool(ready).pose.position.z == pytest.approx(pose.pose.position.z, abs=0.002)


def test_an_object_in_the_way_is_avoided_and_one_at_the_goal_refuses_it(ready: PlanClient) -> None:
    goal = joint_goal(plan_only=True, **{**READY, "joint1": 0.6})
    assert ready.run(goal).error_code.val == SUCCESS
    place = tool(ready).pose.position
    turned = (place.x * 0.825, place.x * 0.565, place.z)
    assert ready.apply(box("wall", turned, (0.05, 0.05, 0.05)))
    refused = ready.run(goal)
    assert refused.error_code.val == MoveItErrorCodes.GOAL_IN_COLLISION
    assert "wall" in refused.error_code.message
    state = RobotState(joint_state=JointState(name=["joint1"], position=[0.6]), is_diff=True)
    check = ready.call(GetStateValidity, "/check_state_validity", GetStateValidity.Request(robot_state=state))
    assert not check.valid
    assert "wall" in {check.contacts[0].contact_body_1, check.contacts[0].contact_body_2}
    assert ready.apply(remove("wall"))
    assert ready.run(goal).error_code.val == SUCCESS


def test_the_scene_has_the_bench_and_refuses_invalid_objects_as_a_whole(ready: PlanClient) -> None:
    assert not ready.apply(box("good", (0.5, 0.5, 0.5), (0.1, 0.1, 0.1)), box("bad", (0.5, 0.0, 0.5), (0.0, 0.1, 0.1)))
    scene = ready.call(GetPlanningScene, "/get_planning_scene", GetPlanningScene.Request()).scene
    names = {item.id for item in scene.world.collision_objects}
    assert {"table", "stand"} <= names
    assert not {"good", "bad"} & names
    assert "link1" in scene.allowed_collision_matrix.entry_names


def test_invalid_goals_name_the_cause_and_move_nothing(ready: PlanClient) -> None:
    before = positions(ready)
    for goal, code, text in (
        (joint_goal(joint1=9.0), "INVALID_GOAL_CONSTRAINTS", "joint1 is at 9"),
        (joint_goal("leg", joint1=0.0), "INVALID_GROUP_NAME", "there is no group leg: choose one of arm, hand"),
        (joint_goal(joint1=float("nan")), "INVALID_GOAL_CONSTRAINTS", "nan"),
        (joint_goal(), "INVALID_GOAL_CONSTRAINTS", "no constraint"),
    ):
        result = ready.run(goal)
        assert result.error_code.val == getattr(MoveItErrorCodes, code), result.error_code.message
        assert text in result.error_code.message
    assert positions(ready) == pytest.approx(before, abs=1e-3)


def test_a_cancel_is_answered_at_once_and_stops_the_arm(ready: PlanClient) -> None:
    handle = ready.send(slow_goal())
    ready.spin(0.7)
    begun_s = time.monotonic()
    assert ready.cancel(handle)
    assert time.monotonic() - begun_s < 0.3
    assert ready.result(handle).error_code.val == MoveItErrorCodes.PREEMPTED
    assert 0.0 < positions(ready)["joint1"] < 1.4


def test_each_constraint_of_a_state_has_a_result(ready: PlanClient) -> None:
    request = GetStateValidity.Request(group_name="arm", constraints=joint_constraints(joint1=0.5, joint2=-0.3643))
    for one in request.constraints.joint_constraints:
        one.tolerance_above = one.tolerance_below = 0.1
    answer = ready.call(GetStateValidity, "/check_state_validity", request)
    assert not answer.valid and not answer.contacts
    assert [one.result for one in answer.constraint_result] == [False, True]
    assert answer.constraint_result[0].distance == pytest.approx(0.5, abs=0.02)


def test_the_event_stop_stops_the_arm(ready: PlanClient) -> None:
    stop = ready.node.create_publisher(String, "/trajectory_execution_event", 10)
    handle = ready.send(slow_goal())
    ready.spin(0.7)
    stop.publish(String(data="stop"))
    assert ready.result(handle).error_code.val == MoveItErrorCodes.PREEMPTED


def test_a_box_in_the_path_stops_the_motion_or_makes_it_plan_again(ready: PlanClient) -> None:
    place = tool(ready).pose.position
    wall = box("wall", (0.4 * place.x, 0.9 * place.x, place.z), (0.06, 0.06, 0.06))
    slow = slow_goal()
    handle = ready.send(slow)
    ready.spin(0.7)
    assert ready.apply(wall)
    result = ready.result(handle)
    assert result.error_code.val == MoveItErrorCodes.MOTION_PLAN_INVALIDATED_BY_ENVIRONMENT_CHANGE
    assert "wall" in result.error_code.message
    assert 0.0 < positions(ready)["joint1"] < 1.0
    assert ready.apply(remove("wall"))
    assert ready.run(joint_goal(**READY)).error_code.val == SUCCESS
    slow.planning_options.replan = True
    handle = ready.send(slow)
    ready.spin(0.7)
    assert ready.apply(wall)
    result = ready.result(handle)
    assert ready.apply(remove("wall"))
    assert result.error_code.val == SUCCESS, result.error_code.message
    assert positions(ready)["joint1"] == pytest.approx(1.5, abs=0.01)


def test_requests_are_answered_while_a_plan_is_searched_until_its_time_is_over(ready: PlanClient) -> None:
    walls = [box(f"wall{side}", (side * 0.396, side * 0.192, 0.55), (0.72, 0.01, 1.09)) for side in (1, -1)]
    for wall in walls:
        wall.pose.orientation.z, wall.pose.orientation.w = 0.2231, 0.9748
    assert ready.apply(*walls, box("ceiling", (0.0, 0.0, 0.42), (1.6, 1.6, 0.02)))
    request = GetMotionPlan.Request()
    request.motion_plan_request.group_name = "arm"
    request.motion_plan_request.allowed_planning_time = 2.0
    request.motion_plan_request.goal_constraints = [joint_constraints(**{**READY, "joint1": 0.9})]
    begun_s = time.monotonic()
    plan = ready.begin(GetMotionPlan, "/plan_kinematic_path", request)
    answers = []
    while not plan.done():
        asked_s = time.monotonic()
        tool(ready)
        answers.append(time.monotonic() - asked_s)
    took_s = time.monotonic() - begun_s
    assert ready.apply(*(remove(item) for item in ("wall1", "wall-1", "ceiling")))
    error = plan.result().motion_plan_response.error_code
    assert error.val == MoveItErrorCodes.TIMED_OUT, error.message
    assert 1.5 < took_s < 3.0
    assert len(answers) > 2
    assert max(answers) < 0.5


def test_parameters_and_groups_are_those_of_move_group(client: PlanClient) -> None:
    names = ["robot_description", "robot_description_semantic"]
    request = GetParameters.Request(names=names)
    urdf, srdf = client.call(GetParameters, "/move_group/get_parameters", request).values
    latched: list[String] = []
    client.node.create_subscription(String, "/robot_description_semantic", latched.append, LATCHED)
    client.spin(0.5)
    assert "<robot" in urdf.string_value
    assert srdf.string_value == latched[0].data
    assert '<chain base_link="base_link" tip_link="gripper_base_link"' in srdf.string_value


def test_a_second_server_does_not_start(client: PlanClient, tmp_path: Path) -> None:
    second = StackProcess(tmp_path / "second.log", "plan-server")
    assert second.process.wait(60.0) == 1
    assert "another node is named /move_group" in second.words
    assert "Traceback" not in second.words
    assert client.run(joint_goal(plan_only=True, **READY)).error_code.val == SUCCESS


@pytest.mark.slow
@pytest.mark.runs("servoloop up --plan")
def test_up_starts_the_server_and_both_end_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(int(os.environ.get("ROS_DOMAIN_ID", "0")) + 1))
    with running(tmp_path, "--hardware", "mock", "--plan") as stack:
        until(lambda: "planning for robot_arm as /move_group" in stack.words, lambda: stack.process.poll())
        child = psutil.Process(stack.process.pid).children()[0]
        assert "plan-server" in child.cmdline()
    assert stack.process.returncode == 0
    assert not child.is_running()
    assert "Traceback" not in stack.words
