"""The package ``moveit`` with a move_group that only records requests."""

from collections.abc import Callable
from copy import deepcopy
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("moveit_msgs")

from geometry_msgs.msg import PoseStamped
from moveit.core.robot_model import RobotModel
from moveit.core.robot_state import RobotState, robotStateToRobotStateMsg
from moveit.move_group import PlanningClient
from moveit.planning import MoveItPy, PlanningComponent, PlanRequestParameters
from moveit_msgs.msg import Constraints, JointConstraint, MoveItErrorCodes, RobotTrajectory
from moveit_msgs.msg import RobotState as RobotStateMsg
from rclpy.duration import Duration
from rclpy.task import Future
from trajectory_msgs.msg import JointTrajectoryPoint

from planning.planning_errors import PlanningError
from tests.pages import ROOT

READY = [0.0, -0.3643, -0.6419, -0.8154, -0.9541, -1.6828]
URDF = (ROOT / "urdf" / "robot_arm.urdf").read_text()
SRDF = (ROOT / "config" / "moveit" / "robot_arm.srdf").read_text()


class RecordingClient:
    """Client whose move_group plans a straight motion to joint1 = 0.5 and records all requests."""

    def __init__(self) -> None:
        self.requests: list[Any] = []
        self.executed: list[Any] = []
        self.errors: list[str] = []
        self.node = SimpleNamespace(get_logger=lambda: SimpleNamespace(error=self.errors.append))
        self.code = MoveItErrorCodes(val=MoveItErrorCodes.SUCCESS)

    def current_state(self) -> RobotStateMsg:
        state = RobotStateMsg()
        state.joint_state.name = ["joint1", "hand_right_joint", "hand_left_joint"]
        state.joint_state.position = [0.1, 0.02, 0.02]
        return state

    def plan(self, request: Any) -> Any:
        self.requests.append(request)
        trajectory = RobotTrajectory()
        trajectory.joint_trajectory.joint_names = ["joint1"]
        trajectory.joint_trajectory.points = [
            JointTrajectoryPoint(positions=[at], time_from_start=Duration(seconds=time_s).to_msg())
            for time_s, at in ((0.0, 0.1), (1.5, 0.3), (2.0, 0.5))
        ]
        return SimpleNamespace(
            trajectory_start=self.current_state(), trajectory=trajectory, planning_time=0.1, error_code=self.code
        )

    def execute(self, trajectory: Any, duration_s: float, controllers: list[str]) -> MoveItErrorCodes:
        self.executed.append((trajectory, duration_s, controllers))
        return self.code


class InterruptedResponse(Future):
    """Response to a goal. Ctrl-C interrupts the first wait, and the response arrives during the shutdown."""

    def __init__(self, response: Any) -> None:
        super().__init__()
        self.response = response
        self.waits = 0

    def add_done_callback(self, callback: Callable[[Future], None]) -> None:
        self.waits += 1
        if self.waits == 1:
            raise KeyboardInterrupt
        super().add_done_callback(callback)
        if self.waits == 3:
            self.set_result(self.response)


class InterruptedClient(PlanningClient):
    """Client without ROS, which is interrupted before its goal is accepted."""

    def __init__(self) -> None:
        self.events: list[str] = []
        handle = SimpleNamespace(accepted=True, cancel_goal_async=lambda: self.events.append("cancel"))
        self._executions: Any = SimpleNamespace(
            server_is_ready=lambda: True, send_goal_async=lambda _: InterruptedResponse(handle)
        )
        self._executor: Any = SimpleNamespace(shutdown=lambda **_: self.events.append("shutdown"))
        self._context: Any = SimpleNamespace(ok=lambda: True, try_shutdown=lambda: None)
        self._thread: Any = SimpleNamespace(join=lambda _: None)
        self.node = SimpleNamespace(resolve_service_name=str, destroy_node=lambda: None)


class Robot(MoveItPy):
    """A MoveItPy without ROS."""

    def __init__(self, config_dict: dict[str, Any] | None = None) -> None:
        self.config = config_dict or {}
        self.recorded = RecordingClient()
        self._client: Any = self.recorded
        self._model = RobotModel(URDF, SRDF, self.recorded)


@pytest.fixture
def robot() -> Robot:
    return Robot()


@pytest.fixture
def arm(robot: Robot) -> PlanningComponent:
    return robot.get_planning_component("arm")


def joints_of(goal: Constraints) -> dict[str, float]:
    return {constraint.joint_name: constraint.position for constraint in goal.joint_constraints}


def test_model_has_the_groups_and_named_states(robot: Robot) -> None:
    model = robot.get_robot_model()
    assert (model.name, model.model_frame) == ("robot_arm", "base_link")
    assert model.joint_model_group_names == ["arm", "hand"]
    assert model.get_joint_model_group("arm").joint_model_names == [f"joint{n}" for n in range(1, 7)]
    assert model.get_joint_model_group("hand").joint_model_names == ["hand_right_joint"]
    assert set(robot.get_planning_component("arm").named_target_states) >= {"ready", "upright"}
    with pytest.raises(PlanningError, match="no group leg: choose one of arm, hand"):
        robot.get_planning_component("leg")


def test_plan_goes_from_the_current_state_to_a_state(robot: Robot, arm: PlanningComponent) -> None:
    state = RobotState(robot.get_robot_model())
    state.set_joint_group_positions("arm", np.array(READY))
    arm.set_start_state_to_current_state()
    assert arm.set_goal_state(robot_state=state)
    response = arm.plan()
    assert response
    (request,) = robot.recorded.requests
    assert joints_of(request.goal_constraints[0]) == dict(zip([f"joint{n}" for n in range(1, 7)], READY, strict=True))
    assert request.start_state.is_diff
    assert not request.start_state.joint_state.name
    assert response.trajectory.duration == 2.0
    assert response.trajectory.get_waypoint_durations() == [0.0, 1.5, 0.5]
    assert [waypoint.joint_positions["joint1"] for waypoint in response.trajectory] == [0.1, 0.3, 0.5]
    assert response.trajectory[0].joint_positions["hand_right_joint"] == 0.02


def test_later_changes_of_a_state_do_not_change_the_start_of_a_plan(robot: Robot, arm: PlanningComponent) -> None:
    state = RobotState(robot.get_robot_model())
    state.set_joint_group_positions("arm", READY)
    arm.set_start_state(robot_state=state)
    state.set_joint_group_positions("arm", [0.5] * 6)
    arm.set_goal_state(robot_state=state)
    arm.plan()
    arm.get_start_state().set_joint_group_positions("arm", [0.2] * 6)
    arm.plan()
    arm.set_start_state(configuration_name="upright")
    assert state.get_joint_group_positions("arm").tolist() == [0.5] * 6
    for request in robot.recorded.requests:
        start = dict(zip(request.start_state.joint_state.name, request.start_state.joint_state.position, strict=True))
        assert [start[f"joint{n}"] for n in range(1, 7)] == READY
        assert set(joints_of(request.goal_constraints[0]).values()) == {0.5}


def test_later_changes_of_messages_do_not_change_a_plan_or_a_trajectory(robot: Robot, arm: PlanningComponent) -> None:
    goal = Constraints(joint_constraints=[JointConstraint(joint_name="joint1", position=0.5)])
    path = Constraints(joint_constraints=[JointConstraint(joint_name="joint2", position=-0.3)])
    arm.set_goal_state(motion_plan_constraints=[goal])
    arm.set_path_constraints(path)
    goal.joint_constraints[0].position = path.joint_constraints[0].position = 0.0
    trajectory = arm.plan().trajectory
    (request,) = robot.recorded.requests
    assert joints_of(request.goal_constraints[0]) == {"joint1": 0.5}
    assert joints_of(request.path_constraints) == {"joint2": -0.3}
    trajectory.get_robot_trajectory_msg().joint_trajectory.points.clear()
    message = trajectory.get_robot_trajectory_msg()
    trajectory.set_robot_trajectory_msg(trajectory[0], message)
    message.joint_trajectory.points.clear()
    assert len(trajectory) == 3


def test_trajectory_is_executed_with_the_named_controllers(robot: Robot, arm: PlanningComponent) -> None:
    arm.set_goal_state("ready")
    trajectory = arm.plan().trajectory
    assert robot.execute(trajectory, controllers=[])
    assert robot.execute(trajectory, controllers=["arm_controller"]).status == "SUCCEEDED"
    assert robot.recorded.executed == [
        (trajectory.get_robot_trajectory_msg(), 2.0, []),
        (trajectory.get_robot_trajectory_msg(), 2.0, ["arm_controller"]),
    ]


def test_named_states_are_starts_and_goals(robot: Robot) -> None:
    hand = robot.get_planning_component("hand")
    assert hand.set_goal_state("open")
    assert hand.set_start_state("close")
    hand.plan()
    (request,) = robot.recorded.requests
    assert joints_of(request.goal_constraints[0]) == hand.get_named_target_state_values("open")
    start = dict(zip(request.start_state.joint_state.name, request.start_state.joint_state.position, strict=True))
    assert start["hand_right_joint"] == hand.get_named_target_state_values("close")["hand_right_joint"]
    assert start["joint1"] == 0.1


def test_pose_goal_is_a_region_around_the_pose(robot: Robot, arm: PlanningComponent) -> None:
    pose = PoseStamped()
    pose.header.frame_id = "base_link"
    pose.pose.position.x, pose.pose.orientation.w = 0.3, 1.0
    assert arm.set_goal_state(pose_stamped_msg=pose, pose_link="gripper_base_link")
    arm.plan()
    (goal,) = robot.recorded.requests[0].goal_constraints
    (position,), (orientation,) = goal.position_constraints, goal.orientation_constraints
    assert (position.link_name, position.header.frame_id) == ("gripper_base_link", "base_link")
    assert position.constraint_region.primitive_poses[0].position.x == 0.3
    assert orientation.orientation.w == 1.0


def test_unknown_state_and_missing_goal_are_logged_and_false(robot: Robot, arm: PlanningComponent) -> None:
    assert not arm.set_goal_state("nowhere")
    response = arm.plan()
    assert not response
    assert response.error_code.val == MoveItErrorCodes.INVALID_GOAL_CONSTRAINTS
    assert not robot.execute(response.trajectory)
    assert "the group arm has no state named nowhere; its states: ready" in robot.recorded.errors[0]
    assert robot.recorded.executed == []


def test_goal_is_canceled_if_the_wait_for_its_response_is_interrupted() -> None:
    client = InterruptedClient()
    with pytest.raises(KeyboardInterrupt):
        client.execute(RobotTrajectory(), 2.0, [])
    client.shutdown()
    assert client.events == ["cancel", "shutdown"]


@pytest.mark.parametrize(
    ("goal", "words"),
    [
        ({}, "Must specify at least one argument for the goal"),
        ({"configuration_name": "ready", "motion_plan_constraints": []}, "Cannot specify both configuration_name and"),
        ({"pose_stamped_msg": PoseStamped()}, "Must specify both message and corresponding link"),
    ],
)
def test_ambiguous_goal_is_refused(arm: PlanningComponent, goal: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        arm.set_goal_state(**goal)


def test_state_refuses_wrong_numbers_and_unknown_joints(robot: Robot) -> None:
    state = RobotState(robot.get_robot_model())
    with pytest.raises(ValueError, match="Expected 6 values for joint model group 'arm', got 2"):
        state.set_joint_group_positions("arm", [0.0, 1.0])
    with pytest.raises(ValueError, match="there is no joint knee: choose from joint1"):
        state.joint_positions = {"knee": 0.0}
    other = deepcopy(state)
    other.set_joint_group_positions("arm", READY)
    assert state.get_joint_group_positions("arm").tolist() == [0.0] * 6
    assert robotStateToRobotStateMsg(other).joint_state.position[1] == READY[1]


def test_parameters_of_the_configuration_reach_the_planner() -> None:
    robot = Robot({"slow": {"plan_request_params": {"planner_id": "RRTstar", "max_velocity_scaling_factor": 0.2}}})
    arm = robot.get_planning_component("arm")
    arm.set_goal_state("ready")
    arm.plan(single_plan_parameters=PlanRequestParameters(robot, "slow"))
    (request,) = robot.recorded.requests
    assert (request.planner_id, request.max_velocity_scaling_factor) == ("RRTstar", 0.2)
    assert request.allowed_planning_time == 5.0
