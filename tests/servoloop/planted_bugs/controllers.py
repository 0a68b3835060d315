"""Bugs in controllers, goals and their results."""

from dataclasses import replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import pytest

from controller import diagnostics
from controller.broadcasters.joint_state_broadcaster import JointStateBroadcaster
from controller.forward.approach import Approach
from controller.gripper.goal import GripperHandle
from controller.gripper.gripper_action_controller import GripperActionController
from controller.manager import manager
from controller.manager.switch import Strictness, SwitchPlan, SwitchRequest, plan_switch
from controller.manager_errors import SwitchError
from controller.motion import Kinematics
from controller.teach.freedrive_controller import FreedriveController
from controller.trajectory import execution, goal_planner, joint_trajectory_controller
from controller.trajectory.active_goal import ActiveGoal, Cycle
from controller.trajectory.execution import GoalExecution
from controller.trajectory.goal import TrajectoryGoal
from controller.trajectory.goal_planner import GoalPlanner
from controller.trajectory.goal_result import GoalResult, result_at_end
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from controller.trajectory.parameters import TrajectoryParameters
from controller.trajectory.sampler import Tracking
from controller.trajectory.speed_scaling import SpeedScaling
from controller.trajectory.tolerances import Tolerances, resolve
from controller.trajectory.waypoints import Waypoints
from hal.types import FloatArray, JointState
from servoloop.api.stream_gate import StreamGate
from servoloop.command_server.motions import Motions
from tests.servoloop.planted_bugs.registry import detected_by


@detected_by("first reason decides", "aborts are true")
def the_last_reason_to_end_a_goal_is_its_result(patch: pytest.MonkeyPatch) -> None:
    def end(execution: GoalExecution, active: ActiveGoal, result: GoalResult) -> None:
        active.handle.decide(result.status, result.error_code, result.text)
        execution.active = None

    patch.setattr(GoalExecution, "_end", end)


@detected_by("first reason decides", "aborts are true")
def cancels_override_aborts(patch: pytest.MonkeyPatch) -> None:
    take_cancels = GoalExecution._take_cancels

    def take(execution: GoalExecution, now: Cycle) -> None:
        active = execution.active
        if active is not None and any(handle is active.handle for handle in execution._cancels):
            active.ending = None
        take_cancels(execution, now)

    patch.setattr(GoalExecution, "_take_cancels", take)


@detected_by("feedback is true")
def feedback_contains_the_velocity_of_the_reference(patch: pytest.MonkeyPatch) -> None:
    def tracking(stamp_s: float, reference: Any, position: FloatArray, velocity: FloatArray, *others: Any) -> Tracking:
        return Tracking(stamp_s, reference, position, reference.velocity, *others)

    patch.setattr(joint_trajectory_controller, "Tracking", tracking)


@detected_by("success is true")
def unmeasured_joints_count_as_arrived(patch: pytest.MonkeyPatch) -> None:
    result = GoalExecution._result

    def found(execution: GoalExecution, active: ActiveGoal, path: Any, now: Cycle) -> GoalResult | None:
        after_end_s = execution._sampler.elapsed_s - path.duration_s
        if now.waits or after_end_s < 0.0:
            return result(execution, active, path, now)
        ends = result_at_end(execution._joints, active.tolerances, path, after_end_s, now.error)
        return ends if ends is None or ends.stop or active.settles(now, execution._sampler.still) else None

    patch.setattr(GoalExecution, "_result", found)


@detected_by("every goal ends", "aborts are true")
def goal_time_tolerances_of_clients_are_ignored(patch: pytest.MonkeyPatch) -> None:
    def resolved(asked: Tolerances, default: Tolerances, joints: Any) -> Tolerances:
        return replace(resolve(asked, default, joints), goal_time_s=default.goal_time_s)

    patch.setattr(execution, "resolve", resolved)


@detected_by("success is true", "deviation ends a goal", "every goal ends", "aborts are true")
def changed_tolerances_are_ignored(patch: pytest.MonkeyPatch) -> None:
    def reconfigure(controller: JointTrajectoryController, parameters: TrajectoryParameters) -> None:
        controller._allowed = parameters.allowed()
        if not hasattr(controller, "_tolerances"):
            controller._tolerances = parameters.tolerances()
        controller.parameters = parameters

    patch.setattr(JointTrajectoryController, "reconfigure", reconfigure)


@detected_by("goals are judged")
def impossible_switches_are_carried_out_in_part(patch: pytest.MonkeyPatch) -> None:
    def plan(loaded: Any, request: SwitchRequest, hardware: Any) -> SwitchPlan:
        try:
            return plan_switch(loaded, request, hardware)
        except SwitchError:
            return plan_switch(loaded, replace(request, strictness=Strictness.BEST_EFFORT), hardware)

    patch.setattr(manager, "plan_switch", plan)


@detected_by("goals are judged")
def incomplete_goals_are_accepted(patch: pytest.MonkeyPatch) -> None:
    allowed = TrajectoryParameters.allowed
    patch.setattr(TrajectoryParameters, "allowed", lambda parameters: replace(allowed(parameters), partial=True))


@detected_by("path is as sent", "safe commands")
def joints_that_a_goal_omits_move_to_zero(patch: pytest.MonkeyPatch) -> None:
    waypoints_of = goal_planner.waypoints_of

    def waypoints(goal: TrajectoryGoal, joints: Any, rest: FloatArray) -> Waypoints:
        return waypoints_of(goal, joints, np.where(np.isin(joints, goal.joints), rest, 0.0))

    patch.setattr(goal_planner, "waypoints_of", waypoints)


@detected_by("gripper goals are followed")
def gripper_goals_that_replace_others_keep_their_speed(patch: pytest.MonkeyPatch) -> None:
    start, speeds = GripperActionController._start, WeakKeyDictionary[GripperActionController, float]()

    def started(controller: GripperActionController, handle: GripperHandle, reference: Kinematics) -> None:
        goal = handle.goal
        speed = speeds.setdefault(controller, goal.max_velocity) if reference.velocity[0] else goal.max_velocity
        speeds[controller] = speed
        handle.goal = replace(goal, max_velocity=speed)
        start(controller, handle, reference)
        handle.goal = goal

    patch.setattr(GripperActionController, "_start", started)


@detected_by("nothing presses after the end")
def controllers_do_not_relieve_joints_that_they_take_over(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(GoalExecution, "begin_relief", lambda execution: None)


@detected_by("published as measured")
def faults_are_missing_in_diagnostics(patch: pytest.MonkeyPatch) -> None:
    servo_status = diagnostics._servo_status
    patch.setattr(diagnostics, "_servo_status", lambda state, *more: servo_status(replace(state, faults={}), *more))


@detected_by("published as measured")
def published_states_are_one_cycle_old(patch: pytest.MonkeyPatch) -> None:
    update, latest = JointStateBroadcaster.update, WeakKeyDictionary[JointStateBroadcaster, JointState]()

    def wrong(broadcaster: JointStateBroadcaster, state: JointState, now_s: float, period_s: float) -> None:
        update(broadcaster, latest.get(broadcaster, state), now_s, period_s)
        latest[broadcaster] = state

    patch.setattr(JointStateBroadcaster, "update", wrong)


@detected_by("published as measured")
def published_positions_are_always_within_the_limits(patch: pytest.MonkeyPatch) -> None:
    def wrong(broadcaster: JointStateBroadcaster, position: FloatArray) -> FloatArray:
        return np.clip(position, broadcaster._lower, broadcaster._upper)

    patch.setattr(JointStateBroadcaster, "_at_limits", wrong)


@detected_by("speed scaling is followed")
def speed_scaling_is_ignored(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(SpeedScaling, "advance", lambda scaling, reference, step_s: None)


@detected_by("smooth reference")
def speeds_change_at_once(patch: pytest.MonkeyPatch) -> None:
    def advance(scaling: SpeedScaling, reference: Kinematics, step_s: float) -> None:
        scaling.factor = scaling.asked

    patch.setattr(SpeedScaling, "advance", advance)


@detected_by("guided joints yield")
def the_arm_stays_stiff_after_its_first_freedrive(patch: pytest.MonkeyPatch) -> None:
    activate = FreedriveController.activate

    def wrong(controller: FreedriveController, state: JointState, command: FloatArray) -> None:
        held = controller.held
        activate(controller, state, command)
        controller.held = held

    patch.setattr(FreedriveController, "activate", wrong)


@detected_by("cancels are followed")
def set_points_of_programs_that_have_died_continue(patch: pytest.MonkeyPatch) -> None:
    halt = Motions.halt

    def wrong(motions: Motions, client: object) -> None:
        if client in motions._clients:
            motions._clients[client].set_points.clear()
        halt(motions, client)

    patch.setattr(Motions, "halt", wrong)


@detected_by("trajectories wait")
def streams_wait_for_the_hand(patch: pytest.MonkeyPatch) -> None:
    take_goals = GoalExecution._take_goals

    def wrong(execution: GoalExecution, now: Cycle) -> None:
        ready = not execution._inbox or not now.parameters.wait_for or execution._ready(now)
        take_goals(execution, now)
        if not ready and execution.active is not None and execution.active.handle.goal.from_topic:
            execution.active.begun = False
            execution._sampler.stop(now.reference, now.parameters, along=True)

    patch.setattr(GoalExecution, "_take_goals", wrong)


@detected_by("path is as sent")
def moving_joints_that_a_goal_omits_turn_back(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(GoalPlanner, "rest", lambda planner, reference: reference.position)


@detected_by("streams are followed")
def streams_begin_with_the_targets_of_the_last_stream(patch: pytest.MonkeyPatch) -> None:
    begin = StreamGate._begin

    def wrong(gate: StreamGate, *more: Any) -> None:
        last = dict(gate._targets)
        begin(gate, *more)
        gate._targets = gate._targets | last

    patch.setattr(StreamGate, "_begin", wrong)


@detected_by("streams are followed", "safe commands", "forwarded values are followed")
def forward_controllers_start_with_their_last_velocity(patch: pytest.MonkeyPatch) -> None:
    begin = Approach.begin

    def wrong(approach: Approach, command: FloatArray) -> None:
        velocity = approach._velocity
        begin(approach, command)
        approach._velocity = velocity

    patch.setattr(Approach, "begin", wrong)
