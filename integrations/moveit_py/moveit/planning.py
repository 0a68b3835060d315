"""Plan and execute motions with a running move_group."""

from collections.abc import Mapping, Sequence
from copy import copy, deepcopy
from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from moveit_msgs.msg import Constraints, MotionPlanRequest, MoveItErrorCodes
from moveit_msgs.msg import RobotState as RobotStateMsg

from moveit.core.controller_manager import ExecutionStatus
from moveit.core.kinematic_constraints import construct_joint_constraint, pose_constraints
from moveit.core.planning_interface import MotionPlanResponse
from moveit.core.robot_model import RobotModel
from moveit.core.robot_state import RobotState
from moveit.core.robot_trajectory import RobotTrajectory
from moveit.move_group import PlanningClient

PLANNING_TIME_S: Final = 5.0


class MoveItPy:
    """Connection to a running move_group."""

    def __init__(
        self,
        node_name: str = "moveit_py",
        launch_params_filepath: str = "",
        config_dict: Mapping[str, Any] | None = None,
        provide_planning_service: bool = True,
    ) -> None:
        """Connect to move_group.

        Args:
            node_name: Name of this client's node.
            launch_params_filepath: Ignored, because the planner's parameters belong to move_group.
            config_dict: Parameters, of which only the ``plan_request_params`` are used.
            provide_planning_service: Ignored, because move_group provides the planning scene.

        Raises:
            RuntimeError: No move_group is running.
        """
        self.config = dict(config_dict or {})
        self._client = PlanningClient(node_name)
        try:
            self._model = RobotModel(*self._client.descriptions(), self._client)
        except BaseException:
            self._client.shutdown()
            raise

    @property
    def client(self) -> PlanningClient:
        """Client of move_group."""
        return self._client

    def get_robot_model(self) -> RobotModel:
        """Return the model of the robot."""
        return self._model

    def get_planning_component(self, planning_component_name: str) -> "PlanningComponent":
        """Return the component that plans for a group. Raises PlanningError if the group does not exist."""
        return PlanningComponent(planning_component_name, self)

    def execute(self, robot_trajectory: RobotTrajectory, controllers: Sequence[str] = ()) -> ExecutionStatus:
        """Execute a trajectory and wait for its end.

        Args:
            robot_trajectory: Trajectory of a plan.
            controllers: Names of controllers. If empty, move_group selects them.

        Raises:
            RuntimeError: No node executes trajectories, or no result arrives in time.
        """
        if not len(robot_trajectory):
            code = MoveItErrorCodes(val=MoveItErrorCodes.INVALID_MOTION_PLAN, message="the trajectory has no points")
        else:
            message = robot_trajectory.get_robot_trajectory_msg()
            code = self._client.execute(message, robot_trajectory.duration, list(controllers))
        if code.val != MoveItErrorCodes.SUCCESS:
            self._client.node.get_logger().error(f"execution failed ({code.val}): {code.message}")
        return ExecutionStatus(code)

    def shutdown(self) -> None:
        """Close the connection."""
        self._client.shutdown()


class PlanRequestParameters:
    """Parameters of a plan, from ``plan_request_params`` of the configuration."""

    def __init__(self, moveit_py: MoveItPy, ns: str = "") -> None:
        within = moveit_py.config.get(ns, {}) if ns else moveit_py.config
        given = within.get("plan_request_params", {})
        self.planner_id: str = given.get("planner_id", "")
        self.planning_pipeline: str = given.get("planning_pipeline", "")
        self.planning_attempts: int = given.get("planning_attempts", 1)
        self.planning_time: float = given.get("planning_time", PLANNING_TIME_S)
        self.max_velocity_scaling_factor: float = given.get("max_velocity_scaling_factor", 1.0)
        self.max_acceleration_scaling_factor: float = given.get("max_acceleration_scaling_factor", 1.0)


class PlanningComponent:
    """Start, goal and constraints of the next plan of one group."""

    def __init__(self, joint_model_group_name: str, moveit_py_instance: MoveItPy) -> None:
        self._moveit = moveit_py_instance
        self._model = moveit_py_instance.get_robot_model()
        self._group = self._model.get_joint_model_group(joint_model_group_name)
        self._start: RobotState | None = None
        self._goals: list[Constraints] = []
        self._path_constraints = Constraints()
        self._workspace: tuple[float, ...] = ()

    @property
    def planning_group_name(self) -> str:
        """Name of the group."""
        return self._group.name

    @property
    def named_target_states(self) -> list[str]:
        """Names of the states that can be goals."""
        return list(self._group.states)

    def get_named_target_state_values(self, name: str) -> dict[str, float]:
        """Return the positions of a named state (rad or m), keyed by joint name. The result is empty if the state does
        not exist."""
        return dict(self._group.states.get(name, {}))

    def set_start_state_to_current_state(self) -> None:
        """Start the next plan at the current state of the robot."""
        self._start = None

    def set_start_state(self, configuration_name: str | None = None, robot_state: RobotState | None = None) -> bool:
        """Start the next plan at a named state or at a given state. Return whether the state exists."""
        _require_one("start state", configuration_name=configuration_name, robot_state=robot_state)
        if robot_state is None:
            robot_state = self.get_start_state()
            if not robot_state.set_to_default_values(self._group.name, configuration_name):
                return self._unknown(configuration_name)
        self._start = copy(robot_state)
        return True

    def get_start_state(self) -> RobotState:
        """Return the state at which the next plan starts. Raises RuntimeError if move_group does not respond."""
        if self._start is not None:
            return copy(self._start)
        return RobotState.from_message(self._model, self._moveit.client.current_state())

    def set_goal_state(
        self,
        configuration_name: str | None = None,
        robot_state: RobotState | None = None,
        pose_stamped_msg: PoseStamped | None = None,
        pose_link: str | None = None,
        motion_plan_constraints: Sequence[Constraints] | None = None,
    ) -> bool:
        """Set the goal of the next plan, and return whether the goal exists.

        Args:
            configuration_name: Name of one of the group's states.
            robot_state: State in which the group's positions are the goal.
            pose_stamped_msg: Pose of the link ``pose_link``.
            pose_link: Link that moves to the pose.
            motion_plan_constraints: Alternative goals.

        Raises:
            ValueError: No goal or more than one goal is given, or only one of ``pose_stamped_msg`` and ``pose_link`` is
                given.
        """
        _require_one(
            "goal",
            configuration_name=configuration_name,
            robot_state=robot_state,
            pose_stamped_msg=pose_stamped_msg,
            motion_plan_constraints=motion_plan_constraints,
        )
        if (pose_stamped_msg is None) != (pose_link is None):
            raise ValueError("Must specify both message and corresponding link")
        if configuration_name is not None:
            robot_state = RobotState(self._model)
            if not robot_state.set_to_default_values(self._group.name, configuration_name):
                return self._unknown(configuration_name)
        if robot_state is not None:
            self._goals = [construct_joint_constraint(robot_state, self._group)]
        elif pose_stamped_msg is not None:
            self._goals = [pose_constraints(pose_stamped_msg, str(pose_link))]
        else:
            self._goals = [deepcopy(goal) for goal in motion_plan_constraints or ()]
        return True

    def set_path_constraints(self, path_constraints: Constraints) -> bool:
        """Set the constraints that apply during the whole motion."""
        self._path_constraints = deepcopy(path_constraints)
        return True

    def set_workspace(self, min_x: float, min_y: float, min_z: float, max_x: float, max_y: float, max_z: float) -> None:
        """Limit the workspace of the next plans, in m in the frame of the model."""
        self._workspace = (min_x, min_y, min_z, max_x, max_y, max_z)

    def unset_workspace(self) -> None:
        """Remove the limits of the workspace."""
        self._workspace = ()

    def plan(
        self, single_plan_parameters: PlanRequestParameters | None = None, planning_scene: None = None
    ) -> MotionPlanResponse:
        """Plan a motion from the start to the goal.

        Args:
            single_plan_parameters: Parameters of the plan.
            planning_scene: Must be None, because the scene belongs to move_group.

        Returns:
            The response, which counts as False if there is no plan. The reason for a failure is in the error code of
            the response and in the log.

        Raises:
            RuntimeError: move_group does not respond.
        """
        if planning_scene is not None:
            raise ValueError("plan() does not accept a planning scene: change the scene of move_group instead")
        request = self._request(single_plan_parameters or PlanRequestParameters(self._moveit))
        if not self._goals:
            code = MoveItErrorCodes(
                val=MoveItErrorCodes.INVALID_GOAL_CONSTRAINTS, message="no goal is set: call set_goal_state() first"
            )
            return self._response(RobotTrajectory(self._model), 0.0, code)
        answer = self._moveit.client.plan(request)
        trajectory = RobotTrajectory(self._model)
        trajectory.set_response(answer.trajectory_start, answer.trajectory, self._group.name)
        return self._response(trajectory, answer.planning_time, answer.error_code)

    def _response(self, trajectory: RobotTrajectory, time_s: float, code: MoveItErrorCodes) -> MotionPlanResponse:
        if code.val != MoveItErrorCodes.SUCCESS:
            self._log().error(f"no plan ({code.val}): {code.message}")
        return MotionPlanResponse(trajectory, time_s, code)

    def _request(self, parameters: PlanRequestParameters) -> MotionPlanRequest:
        request = MotionPlanRequest(
            group_name=self._group.name,
            goal_constraints=self._goals,
            path_constraints=self._path_constraints,
            planner_id=parameters.planner_id,
            pipeline_id=parameters.planning_pipeline,
            num_planning_attempts=parameters.planning_attempts,
            allowed_planning_time=parameters.planning_time,
            max_velocity_scaling_factor=parameters.max_velocity_scaling_factor,
            max_acceleration_scaling_factor=parameters.max_acceleration_scaling_factor,
        )
        request.start_state = RobotStateMsg(is_diff=True) if self._start is None else self._start.message()
        if self._workspace:
            box = request.workspace_parameters
            box.header.frame_id = self._model.model_frame
            low, high = self._workspace[:3], self._workspace[3:]
            box.min_corner.x, box.min_corner.y, box.min_corner.z = low
            box.max_corner.x, box.max_corner.y, box.max_corner.z = high
        return request

    def _unknown(self, name: str | None) -> bool:
        known = ", ".join(self._group.states) or "none"
        self._log().error(f"the group {self._group.name} has no state named {name}; its states: {known}")
        return False

    def _log(self) -> Any:
        return self._moveit.client.node.get_logger()


def _require_one(what: str, **given: object) -> None:
    names = [name for name, value in given.items() if value is not None]
    if len(names) > 1:
        raise ValueError(f"Cannot specify both {names[0]} and {names[1]}")
    if not names:
        raise ValueError(f"Must specify at least one argument for the {what}: {', '.join(given)}")
