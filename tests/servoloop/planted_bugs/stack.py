"""Bugs in all parts of the stack, from goals to packets."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from controller import loop, shutdown
from controller.action_goals import GoalStatus
from controller.forward import approach
from controller.forward.forward_command_controller import ForwardCommandController
from controller.gripper import gripper_action_controller
from controller.gripper.goal import GripperHandle
from controller.gripper.gripper_action_controller import GripperActionController
from controller.loop import ControlLoop
from controller.motion import Kinematics, RuckigMotion, motion_to
from controller.stops import DecelerationStops, StopMotion
from controller.trajectory import active_goal, execution, goal_planner, goal_result, joint_trajectory_controller, paths
from controller.trajectory.active_goal import ActiveGoal, Cycle
from controller.trajectory.execution import GoalExecution
from controller.trajectory.goal import GoalHandle, TrajectoryGoal
from controller.trajectory.goal_result import GoalResult, result_at_end
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from controller.trajectory.paths import Joined
from controller.trajectory.relief import Relief
from controller.trajectory.sampler import TrajectorySampler
from controller.trajectory.standstill import Standstill
from controller.trajectory.tolerances import Tolerances, excess, resolve
from drivers.bus.bus import Bus
from drivers.bus.late_replies import LateReplyFilter
from drivers.driver_errors import PortLost
from drivers.protocol import v1
from drivers.types import ServoFault, ServoGoal
from hal import gate
from hal.compensation.joint_offset import JointOffset
from hal.components.component_lifecycle import deactivate_all
from hal.fault_timeout import FaultTimeout
from hal.gate import Gated, SafetyGate
from hal.hal_errors import ActivationError
from hal.joint import Joint
from hal.leaps import Plausibility
from hal.servos import activation, servo_goals, servo_setup, start_goal
from hal.servos.activation import Activation
from hal.servos.joint_buses import JointBuses
from hal.servos.servo_hardware import ServoHardware
from hal.servos.servo_setup import ServoSetup
from hal.servos.servo_states import ServoStates
from hal.servos.soft_torque import SoftTorque
from hal.servos.stall_watch import StallWatch
from hal.servos.supply_watch import SupplyWatch
from hal.types import FloatArray, JointFault, JointLimits, JointState
from servoloop.api.backend import ArmState
from servoloop.api.stack_backend import StackBackend
from servoloop.api.stream_gate import StreamGate
from servoloop.command_server import requests
from servoloop.command_server.arm_requests import ArmRequests
from servoloop.command_server.motions import Motions
from servoloop.command_server.ownership import Ownership
from servoloop.command_server.requests import StackRequests
from servoloop.command_server.session import Session
from tests.servoloop.planted_bugs.registry import calls, detected_by


@detected_by("goals mean commands", "success is true", "safe wire", "deviation ends a goal")
def sign_left_out_of_goals(patch: pytest.MonkeyPatch) -> None:
    counts = Joint.counts
    patch.setattr(Joint, "counts", lambda joint, position: counts(replace(joint, sign=1), position))


@detected_by("reported truly")
def sign_left_out_of_positions(patch: pytest.MonkeyPatch) -> None:
    def unit(joint: Joint) -> float:
        return joint.transmission * 2.0 * np.pi / joint.model.counts_per_turn

    patch.setattr(Joint, "units_per_count", property(unit))


@detected_by("safe commands")
def gate_allows_ten_percent_more(patch: pytest.MonkeyPatch) -> None:
    limit = SafetyGate.limit

    def wrong(gate: SafetyGate, wanted: FloatArray, last: FloatArray, period_s: float, *more: Any) -> Gated:
        return limit(gate, wanted, last, 1.1 * period_s, *more)

    patch.setattr(SafetyGate, "limit", wrong)


@detected_by("nan holds", "safe commands")
def gate_replaces_nan_by_zero(patch: pytest.MonkeyPatch) -> None:
    limit = SafetyGate.limit

    def wrong(gate: SafetyGate, wanted: FloatArray, last: FloatArray, period_s: float, *more: Any) -> Gated:
        return limit(gate, np.nan_to_num(wanted), last, period_s, *more)

    patch.setattr(SafetyGate, "limit", wrong)


@detected_by("success is true")
def goal_tolerance_is_ignored(patch: pytest.MonkeyPatch) -> None:
    def wrong(joints: Any, tolerances: Any, path: Any, after_end_s: float, error: FloatArray) -> GoalResult | None:
        return result_at_end(joints, tolerances, path, after_end_s, np.zeros_like(error))

    patch.setattr(execution, "result_at_end", wrong)


@detected_by("deviation ends a goal")
def path_tolerance_is_ignored(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(ActiveGoal, "off_path", lambda active, joints, now: None)


@detected_by("every goal ends")
def goal_time_never_elapses(patch: pytest.MonkeyPatch) -> None:
    def wrong(joints: Any, tolerances: Any, path: Any, after_end_s: float, error: FloatArray) -> GoalResult | None:
        return result_at_end(joints, tolerances, path, min(after_end_s, 1e-9), error)

    patch.setattr(execution, "result_at_end", wrong)


@detected_by("every goal ends")
def fault_timeout_never_elapses(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(FaultTimeout, "lasting", lambda timeout, faults, period_s: None)


@detected_by("cancels are followed")
def cancels_are_ignored(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(GoalExecution, "cancel", lambda execution, handle: None)


@detected_by("aborts are true")
def abort_names_the_previous_joint(patch: pytest.MonkeyPatch) -> None:
    def wrong(joints: Sequence[str], *more: Any) -> str:
        text = excess(joints, *more)
        for name, before in zip(joints, (joints[-1], *joints[:-1]), strict=True):
            if text.startswith(f"{name} "):
                return text.replace(name, before, 1)
        return text

    patch.setattr(active_goal, "excess", wrong)


@detected_by("smooth reference")
def stops_are_abrupt(patch: pytest.MonkeyPatch) -> None:
    def wrong(sampler: TrajectorySampler, reference: Any, parameters: Any, along: bool = False) -> None:
        sampler.hold(reference.position)

    patch.setattr(TrajectorySampler, "stop", wrong)


@detected_by("nothing travels after the end", "every goal ends", "cancels are followed")
def arm_moves_back_after_an_abort(patch: pytest.MonkeyPatch) -> None:
    def wrong(relief: Relief) -> None:
        relief.due = False
        sampler = relief._sampler
        here = sampler.reference()
        back = Kinematics.at_rest(sampler.inside(here.position - 0.15))
        sampler.follow(motion_to(here, back, sampler.limits, 0.0), here, on_goal=False)

    patch.setattr(Relief, "begin", wrong)


@detected_by("nothing presses after the end", "deviation ends a goal")
def no_joint_is_relieved(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Relief, "_relieve", lambda relief, held, now: None)


@detected_by("activated as configured")
def torque_limit_is_not_written(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(ServoSetup, "limit_torque", lambda setup, joint: None)


@detected_by("safe wire")
def torque_is_enabled_before_the_goal(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Activation, "_hold_goals", lambda activation: None)
    patch.setattr(Activation, "_confirm_goal", lambda activation, joint: None)


@detected_by("taken back", "every goal ends")
def silent_servo_never_returns(patch: pytest.MonkeyPatch) -> None:
    receive = Bus.receive
    silent: dict[int, dict[int, Any]] = {}

    def wrong(bus: Bus) -> Mapping[int, Any]:
        readings = receive(bus)
        lost = silent.setdefault(id(bus), {})
        lost.update({i: one for i, one in readings.items() if isinstance(one, ServoFault) and one.kind == "silent"})
        return {**readings, **{i: fault for i, fault in lost.items() if i in readings}}

    patch.setattr(Bus, "receive", wrong)


@detected_by("limp joints are found", "safe wire")
def lost_torque_is_not_detected(patch: pytest.MonkeyPatch) -> None:
    def wrong(bus: Bus, servo_ids: Sequence[int], deadline_s: float) -> dict[int, bool]:
        return dict.fromkeys(servo_ids, True)

    patch.setattr(Bus, "torque_states", wrong)


@detected_by("goals mean commands", "safe wire")
def gravity_offsets_are_eight_times_too_large(patch: pytest.MonkeyPatch) -> None:
    sag = JointOffset._sag
    patch.setattr(JointOffset, "_sag", lambda offset, torque: 8.0 * sag(offset, torque))


@detected_by("safe wire", "goals mean commands")
def goals_go_to_the_next_servo(patch: pytest.MonkeyPatch) -> None:
    write_goals = Bus.write_goals

    def wrong(bus: Bus, goals: Mapping[int, ServoGoal]) -> None:
        ids = list(goals)
        write_goals(bus, dict(zip(ids[1:] + ids[:1], goals.values(), strict=True)))

    patch.setattr(Bus, "write_goals", wrong)


@detected_by("feedback is true")
def feedback_is_one_cycle_old(patch: pytest.MonkeyPatch) -> None:
    update = JointTrajectoryController.update

    def wrong(controller: JointTrajectoryController, state: JointState, now_s: float, period_s: float) -> None:
        before = controller.tracking
        update(controller, state, now_s, period_s)
        if before is not None and controller.tracking is not None:
            old = before.feedback_position
            controller.tracking = replace(controller.tracking, feedback_position=old)

    patch.setattr(JointTrajectoryController, "update", wrong)


@detected_by("goals are judged")
def limits_of_goals_are_not_checked(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(goal_planner, "limits_reason", lambda *_: None)


@detected_by("ends as chosen")
def arm_is_not_parked(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(shutdown, "_park", lambda *_: True)


@detected_by("ends as chosen")
def arm_is_not_released(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(shutdown, "deactivate_all", lambda hardware, relax: deactivate_all(hardware, False))


@detected_by("smooth end")
def arm_stops_abruptly_at_the_end(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(shutdown, "_stop", lambda loop: None)


@detected_by("safe commands", "safe wire", "goals mean commands")
def arm_is_taken_over_at_zero(patch: pytest.MonkeyPatch) -> None:
    take_over = ControlLoop.take_over

    def wrong(loop: ControlLoop, *more: Any) -> None:
        take_over(loop, *more)
        loop.command = np.zeros_like(loop.command)

    patch.setattr(ControlLoop, "take_over", wrong)


@detected_by("safe commands")
def arm_is_taken_over_at_its_last_command(patch: pytest.MonkeyPatch) -> None:
    take_over = ControlLoop.take_over

    def wrong(loop: ControlLoop, *more: Any) -> None:
        before = loop.command
        take_over(loop, *more)
        loop.command = np.where(np.isnan(before), loop.command, before)

    patch.setattr(ControlLoop, "take_over", wrong)


@detected_by("motion is true")
def sign_left_out_of_velocities(patch: pytest.MonkeyPatch) -> None:
    update = ServoStates.update

    def wrong(states: ServoStates, *more: Any) -> JointState:
        state = update(states, *more)
        return replace(state, velocity=np.abs(state.velocity))

    patch.setattr(ServoStates, "update", wrong)


@detected_by("motion is true")
def efforts_are_zero(patch: pytest.MonkeyPatch) -> None:
    update = ServoStates.update

    def wrong(states: ServoStates, *more: Any) -> JointState:
        state = update(states, *more)
        return replace(state, effort=np.zeros_like(state.effort))

    patch.setattr(ServoStates, "update", wrong)


@detected_by("health is true")
def alarms_are_dropped(patch: pytest.MonkeyPatch) -> None:
    receive = Bus.receive

    def wrong(bus: Bus) -> Mapping[int, Any]:
        readings = receive(bus)
        return {i: one if isinstance(one, ServoFault) else one._replace(alarms=()) for i, one in readings.items()}

    patch.setattr(Bus, "receive", wrong)


@detected_by("path is as sent", "success is true")
def joint_order_of_goals_is_ignored(patch: pytest.MonkeyPatch) -> None:
    waypoints_of = goal_planner.waypoints_of

    def wrong(goal: TrajectoryGoal, joints: Sequence[str], rest: FloatArray) -> Any:
        return waypoints_of(replace(goal, joints=tuple(joints[: len(goal.joints)])), joints, rest)

    patch.setattr(goal_planner, "waypoints_of", wrong)


@detected_by("path is as sent")
def second_point_of_goals_is_skipped(patch: pytest.MonkeyPatch) -> None:
    waypoints_of = goal_planner.waypoints_of

    def wrong(goal: TrajectoryGoal, joints: Sequence[str], rest: FloatArray) -> Any:
        points = goal.points if len(goal.points) < 3 else (goal.points[0], *goal.points[2:])
        return waypoints_of(replace(goal, points=points), joints, rest)

    patch.setattr(goal_planner, "waypoints_of", wrong)


@detected_by("path is as sent")
def stamps_in_the_future_are_ignored(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(TrajectoryGoal, "starts_s", property(lambda goal: 0.0))


@detected_by("replaced goals end", "every goal ends")
def replaced_goals_continue(patch: pytest.MonkeyPatch) -> None:
    end = GoalExecution._end

    def wrong(execution: GoalExecution, active: ActiveGoal, result: GoalResult) -> None:
        if "preempted" in result.text.lower():
            execution.active = None
        else:
            end(execution, active, result)

    patch.setattr(GoalExecution, "_end", wrong)


@detected_by("forwarded values are followed")
def hand_stays_where_it_is(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(ForwardCommandController, "_go", lambda controller, wanted: None)


@detected_by("goals are judged")
def stale_commands_are_carried_out(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(requests, "STALE_S", 100.0)


@detected_by("every goal ends")
def silent_streams_continue(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(StreamGate, "update", lambda gate, now_s: None)


@detected_by("cancels are followed")
def motions_of_dead_programs_continue(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(StackRequests, "disconnect", lambda requests, client: None)


@detected_by("gripper goals are followed")
def gripper_goals_succeed_at_once(patch: pytest.MonkeyPatch) -> None:
    def wrong(controller: GripperActionController, handle: GripperHandle, *_: Any) -> None:
        controller._end(handle, GoalStatus.SUCCEEDED, "the goal is reached", reached_goal=True)

    patch.setattr(GripperActionController, "_check_goal", wrong)


@detected_by("gripper goals are followed")
def stalled_grippers_are_not_detected(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(GripperActionController, "_stalls", lambda *_: False)


@detected_by("gripper goals are followed")
def cancels_of_gripper_goals_are_ignored(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(GripperActionController, "cancel", lambda controller, handle: None)


@detected_by("safe wire")
def one_reading_becomes_a_goal(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Activation, "_confirmed", Activation._measure_all)


@detected_by("safe wire")
def two_readings_are_not_compared(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(activation, "_agree", lambda joint, before, last: True)


@detected_by("reported truly")
def leaps_are_believed(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Plausibility, "leap", lambda check, position, now_s, driven: None)


@detected_by("long presses are reduced")
def presses_are_not_reduced(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(StallWatch, "goal", lambda watch, joint, command, here, load, period_s: None)


@detected_by("success is true")
def violated_tolerances_count_as_success(patch: pytest.MonkeyPatch) -> None:
    decide = GoalHandle.decide

    def decided(handle: GoalHandle, status: GoalStatus, error_code: int, text: str) -> None:
        status = GoalStatus.SUCCEEDED if "tolerance" in text else status
        decide(handle, status, error_code, text)

    patch.setattr(GoalHandle, "decide", decided)


@detected_by("health is true")
def wrong_voltages_are_not_reported(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(SupplyWatch, "check", lambda watch, joint, voltage_v, label: None)


@detected_by("smooth reference")
def motions_exceed_the_velocity_limits(patch: pytest.MonkeyPatch) -> None:
    def faster(
        start: Kinematics, target: Kinematics, limits: Sequence[JointLimits], asked_s: float, names: Sequence[str] = ()
    ) -> RuckigMotion:
        allowed = [replace(limit, velocity=1.3 * limit.velocity) for limit in limits]
        return motion_to(start, target, allowed, asked_s, names)

    for module in (goal_planner, paths):
        patch.setattr(module, "motion_to", faster)


@detected_by("cancels are followed")
def results_do_not_wait_for_rest(patch: pytest.MonkeyPatch) -> None:
    def ended(execution: GoalExecution, active: ActiveGoal, ending: GoalResult, now: Any, fault: str | None) -> None:
        execution._end(active, ending)

    patch.setattr(GoalExecution, "_come_to_rest", ended)


@detected_by("deviation ends a goal", "success is true")
def tolerances_of_goals_are_ignored(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(
        GoalExecution,
        "_tolerances",
        lambda execution, asked, default: resolve(Tolerances(), default, execution._joints),
    )


@detected_by("goals mean commands", "nothing presses after the end")
def gravity_offsets_have_the_wrong_sign(patch: pytest.MonkeyPatch) -> None:
    sag = JointOffset._sag
    patch.setattr(JointOffset, "_sag", lambda offset, torque: -sag(offset, torque))


@detected_by("safe wire")
def goals_have_no_speed(patch: pytest.MonkeyPatch) -> None:
    write_goals = Bus.write_goals

    def wrong(bus: Bus, goals: Mapping[int, ServoGoal]) -> None:
        write_goals(bus, {servo_id: ServoGoal(goal.position_counts) for servo_id, goal in goals.items()})

    patch.setattr(Bus, "write_goals", wrong)


@detected_by("smooth end", "smooth reference")
def joints_without_a_controller_stop_at_once(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(DecelerationStops, "begin", lambda stops, index, command, velocity: None)


@detected_by("safe commands")
def joints_outside_their_limits_return_at_full_speed(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(gate, "RETURN_SHARE", 1.0)
    patch.setattr(servo_goals, "RETURN_SHARE", 1.0)


@detected_by("activated as configured")
def joints_far_outside_their_limits_are_activated(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(start_goal, "far_outside", lambda *_: "")
    patch.setattr(loop, "far_outside", lambda *_: "")


@detected_by("activated as configured")
def settings_are_not_written(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(servo_setup, "apply_settings", lambda joint, bus: None)


@detected_by("goals mean commands")
def goals_run_ahead_of_blocked_joints(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(servo_goals._Servo, "_within_pull", lambda servo, wanted, here, reach, period_s: wanted)


@detected_by("measured now", "reported truly")
def late_replies_are_taken_as_current(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(LateReplyFilter, "match", lambda *_, **__: None)


@detected_by("aborts are true")
def error_codes_are_zero(patch: pytest.MonkeyPatch) -> None:
    decide = GoalHandle.decide
    patch.setattr(GoalHandle, "decide", lambda handle, status, code, text: decide(handle, status, 0, text))


@detected_by("smooth end")
def arm_parks_at_full_speed(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(shutdown, "_slower", lambda limit, scale: limit)


@detected_by("reported truly")
def silent_joints_are_reported_at_zero(patch: pytest.MonkeyPatch) -> None:
    update = ServoStates.update

    def wrong(states: ServoStates, *more: Any) -> JointState:
        state = update(states, *more)
        silent = [joint.name in state.faults for joint in states._joints]
        return replace(state, position=np.where(silent, 0.0, state.position))

    patch.setattr(ServoStates, "update", wrong)


@detected_by("trajectories wait")
def trajectories_do_not_wait(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Standstill, "step", lambda standstill, faults, step_s, *_: step_s)


@detected_by("stops follow paths")
def stops_leave_the_path(patch: pytest.MonkeyPatch) -> None:
    stop = TrajectorySampler.stop

    def wrong(sampler: TrajectorySampler, reference: Any, parameters: Any, along: bool = False) -> None:
        stop(sampler, reference, parameters)

    patch.setattr(TrajectorySampler, "stop", wrong)


@detected_by("activated as configured")
def guided_arm_is_not_soft(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(SoftTorque, "reduce", lambda torque: [])


@detected_by("activated as configured", "ends as chosen")
def guided_arm_stays_soft(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(SoftTorque, "restore", lambda torque, silent=(): None)


@detected_by("cancels are followed")
def stops_over_the_socket_are_ignored(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(StackRequests, "_stop", lambda requests, client, message: {})


@detected_by("path is as sent")
def goals_take_twice_as_long(patch: pytest.MonkeyPatch) -> None:
    def slower(
        start: Kinematics, target: Kinematics, limits: Sequence[JointLimits], asked_s: float, names: Sequence[str] = ()
    ) -> RuckigMotion:
        return motion_to(start, target, limits, 2.0 * asked_s, names)

    for module in (goal_planner, paths):
        patch.setattr(module, "motion_to", slower)


@detected_by("goals mean commands")
def last_joint_receives_no_goals(patch: pytest.MonkeyPatch) -> None:
    write_goals = JointBuses.write_goals

    def wrong(buses: JointBuses, goals: Mapping[str, ServoGoal]) -> None:
        write_goals(buses, dict(list(goals.items())[: max(len(goals) - 1, 1)]))

    patch.setattr(JointBuses, "write_goals", wrong)


@detected_by("goals are judged")
def programs_without_control_may_move_the_arm(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Ownership, "moving", lambda ownership, client, move: move())


@detected_by("trajectories wait")
def arm_does_not_wait_for_the_hand(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(GoalExecution, "_ready", lambda execution, now: True)


@detected_by("programs are informed")
def programs_are_informed_that_motions_succeed(patch: pytest.MonkeyPatch) -> None:
    ended = ArmRequests.ended
    patch.setattr(
        ArmRequests, "ended", lambda requests, client: ({**event, "error": None} for event in ended(requests, client))
    )


@detected_by("programs are informed")
def results_of_goals_are_not_sent_to_programs(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Motions, "ended", lambda motions, client: iter(()))


@detected_by("programs are informed")
def programs_are_not_informed_that_they_lost_control(patch: pytest.MonkeyPatch) -> None:
    post = Session.post

    def silent(session: Session, message: dict[str, Any]) -> None:
        if message.get("event") != "lost":
            post(session, message)

    patch.setattr(Session, "post", silent)


@detected_by("programs are informed")
def programs_receive_the_state_of_another_joint(patch: pytest.MonkeyPatch) -> None:
    converted = StackBackend._converted

    def wrong(backend: StackBackend, state: JointState, command: FloatArray) -> ArmState:
        shown = converted(backend, state, command)
        first, *others = shown.position.values()
        return replace(shown, position=dict(zip(shown.position, (*others, first), strict=True)))

    patch.setattr(StackBackend, "_converted", wrong)


@detected_by("success is true")
def goals_succeed_before_the_joints_rest(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(ActiveGoal, "settles", lambda goal, now, still: True)


@detected_by("trajectories wait")
def trajectories_jump_after_a_stall(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(joint_trajectory_controller, "LONGEST_STEP", math.inf)


@detected_by("gripper goals are followed")
def speeds_of_gripper_goals_are_ignored(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(gripper_action_controller, "velocity_of", lambda goal, limits, parameters: limits.velocity)


@detected_by("gripper goals are followed")
def stalled_gripper_goals_are_reported_as_reached(patch: pytest.MonkeyPatch) -> None:
    end = GripperActionController._end

    def wrong(
        controller: GripperActionController, handle: GripperHandle, status: GoalStatus, text: str, **_: bool
    ) -> None:
        end(controller, handle, status, text, reached_goal=True)

    patch.setattr(GripperActionController, "_end", wrong)


@detected_by("forwarded values are followed")
def forwarded_commands_overshoot(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(approach, "_arriving", lambda room, change, period_s: room / period_s)


@detected_by("health is true")
def alarms_have_wrong_names(patch: pytest.MonkeyPatch) -> None:
    receive = Bus.receive

    def wrong(bus: Bus) -> Mapping[int, Any]:
        return {
            i: one if isinstance(one, ServoFault) or not one.alarms else one._replace(alarms=("overload",))
            for i, one in receive(bus).items()
        }

    patch.setattr(Bus, "receive", wrong)


@detected_by("programs are informed")
def messages_on_the_socket_are_not_answered(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Session, "serve", lambda session: 0.0)


@detected_by("programs are informed")
def states_are_not_sent_to_programs(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Session, "watch", lambda session, rate_hz: None)


@detected_by("cancels are followed")
def replaced_goals_end_as_canceled(patch: pytest.MonkeyPatch) -> None:
    activate = GoalExecution._activate

    def wrong(execution: GoalExecution, *entry: Any) -> ActiveGoal:
        if execution.active:
            execution.active.ending = GoalResult(GoalStatus.CANCELED, goal_result.ErrorCode.SUCCESSFUL, "")
        return activate(execution, *entry)

    patch.setattr(GoalExecution, "_activate", wrong)


@detected_by("safe commands")
def controllers_start_where_the_joints_were_still_moving(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(DecelerationStops, "ends", lambda stops, command: command)


@detected_by("replaced goals end", "cancels are followed")
def canceled_goals_do_not_replace_older_goals(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(GoalExecution, "_replace_by", lambda execution, handle, now: None)


@detected_by("aborts are true")
def isolated_faults_add_up(patch: pytest.MonkeyPatch) -> None:
    lasting = FaultTimeout.lasting

    def wrong(timeout: FaultTimeout, faults: Mapping[str, JointFault], period_s: float) -> str | None:
        before = timeout.cycles
        found = lasting(timeout, faults, period_s)
        timeout.cycles = before | timeout.cycles
        return found

    patch.setattr(FaultTimeout, "lasting", wrong)


@detected_by("path is as sent")
def time_spent_waiting_counts_as_time_on_the_path(patch: pytest.MonkeyPatch) -> None:
    begin = GoalExecution._begin

    def wrong(execution: GoalExecution, active: ActiveGoal, now: Cycle) -> None:
        join, waited_s = active.plan.join, active.waited_s
        active.plan = SimpleNamespace(join=lambda reference, _: join(reference, waited_s))
        begin(execution, active, now)

    patch.setattr(GoalExecution, "_begin", wrong)


@detected_by("path is as sent", "every goal ends")
def goals_sent_during_a_motion_take_longer(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Joined, "duration_s", property(lambda path: path.first.duration_s + path.rest.duration_s))


@detected_by("streams are followed")
def streams_move_joints_that_they_do_not_name(patch: pytest.MonkeyPatch) -> None:
    begin = StreamGate._begin

    def wrong(gate: StreamGate, max_age_s: float) -> None:
        begin(gate, max_age_s)
        gate._targets = {joint: 0.9 * at for joint, at in gate._targets.items()}

    patch.setattr(StreamGate, "_begin", wrong)


@detected_by("gripper goals are followed")
def gripper_goals_stall_at_once(patch: pytest.MonkeyPatch) -> None:
    start = GripperActionController._start

    def wrong(controller: GripperActionController, *more: Any) -> None:
        start(controller, *more)
        controller._still_s = controller.parameters.stall_timeout

    patch.setattr(GripperActionController, "_start", wrong)


@detected_by("controllers resume")
def controllers_stay_inactive_after_an_activation(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(ControlLoop, "_resume", lambda loop, controllers, state: None)


@detected_by("goals are judged")
def control_is_taken_without_force(patch: pytest.MonkeyPatch) -> None:
    take = Ownership.take
    patch.setattr(Ownership, "take", lambda ownership, client, force: take(ownership, client, True))


@detected_by("every goal ends")
def fault_timeout_is_twice_as_long(patch: pytest.MonkeyPatch) -> None:
    lasting = FaultTimeout.lasting
    patch.setattr(FaultTimeout, "lasting", lambda timeout, faults, period_s: lasting(timeout, faults, period_s / 2.0))


@detected_by("cancels are followed")
def freedrive_outlives_its_program(patch: pytest.MonkeyPatch) -> None:
    halt = ArmRequests.halt

    def wrong(served: ArmRequests, client: Any) -> None:
        served._guiding = None
        halt(served, client)

    patch.setattr(ArmRequests, "halt", wrong)


@detected_by("aborts are true")
def canceled_goals_end_as_aborted(patch: pytest.MonkeyPatch) -> None:
    result = GoalResult(GoalStatus.ABORTED, goal_result.ErrorCode.INVALID_GOAL, "canceled", at_rest=True)
    patch.setattr(execution, "CANCELED", result)


@detected_by("aborts are true")
def goals_are_aborted_without_a_reason(patch: pytest.MonkeyPatch) -> None:
    go_on, cycles = GoalExecution._go_on, calls()

    def wrong(execution: GoalExecution, active: ActiveGoal, now: Cycle) -> None:
        if active.begun and not active.ending and cycles(execution) % 100 == 0:
            result = GoalResult(GoalStatus.ABORTED, goal_result.ErrorCode.INVALID_GOAL, "Aborted", at_rest=True)
            execution._finish(active, result, now)
        else:
            go_on(execution, active, now)

    patch.setattr(GoalExecution, "_go_on", wrong)


@detected_by("goals are judged")
def goals_with_several_points_are_rejected(patch: pytest.MonkeyPatch) -> None:
    check = JointTrajectoryController.check

    def wrong(controller: JointTrajectoryController, goal: TrajectoryGoal) -> str | None:
        return check(controller, goal) or ("a goal has one point" if len(goal.points) > 1 else None)

    patch.setattr(JointTrajectoryController, "check", wrong)


@detected_by("activated as configured")
def the_second_activation_fails(patch: pytest.MonkeyPatch) -> None:
    activate, activations = ServoHardware.activate, calls()

    def wrong(hardware: ServoHardware) -> None:
        if activations(hardware) == 2:
            raise ActivationError(f"not activated: two readings of {hardware.joints[0]} differ")
        activate(hardware)

    patch.setattr(ServoHardware, "activate", wrong)


@detected_by("ends as chosen")
def arm_is_not_parked_while_a_joint_has_a_fault(patch: pytest.MonkeyPatch) -> None:
    park = shutdown._park

    def wrong(loop: ControlLoop, *more: Any) -> bool:
        seen = loop.manager.cycle.seen
        return bool(seen is not None and seen.faults) or park(loop, *more)

    patch.setattr(shutdown, "_park", wrong)


@detected_by("smooth end")
def arm_stops_hard_before_it_holds(patch: pytest.MonkeyPatch) -> None:
    def wrong(loop: ControlLoop) -> None:
        hard = [replace(one, acceleration=1.9 * one.acceleration, jerk=10.0 * one.jerk) for one in loop.limits]
        velocity = (loop.command - loop.previous_command) / loop.period_s
        stop = StopMotion(loop.command, velocity, hard, loop.kinds)
        shutdown._drive(loop, stop.sample, stop.duration_s, lambda: False)

    patch.setattr(shutdown, "_stop", wrong)


@detected_by("no crash")
def driver_has_an_internal_error(patch: pytest.MonkeyPatch) -> None:
    receive, cycles = Bus.receive, calls()

    def wrong(bus: Bus) -> Mapping[int, Any]:
        if cycles(bus) % 100 == 0:
            raise KeyError("servo")
        return receive(bus)

    patch.setattr(Bus, "receive", wrong)


@detected_by("silent servo is reported")
def components_are_lost_without_a_fault(patch: pytest.MonkeyPatch) -> None:
    receive, cycles = Bus.receive, calls()

    def wrong(bus: Bus) -> Mapping[int, Any]:
        if cycles(bus) % 100 == 0:
            raise PortLost("the port is lost")
        return receive(bus)

    patch.setattr(Bus, "receive", wrong)


@detected_by("safe wire", "goals mean commands")
def goals_are_broadcast(patch: pytest.MonkeyPatch) -> None:
    write, cycles = Bus.write_goals, calls()

    def wrong(bus: Bus, goals: Mapping[int, ServoGoal]) -> None:
        write(bus, goals)
        if cycles(bus) % 100 == 0:
            bus._port.write(
                v1.packet(v1.BROADCAST_ID, v1.WRITE, bytes((41, 0, *(3000).to_bytes(2, "little"), *bytes(4))))
            )

    patch.setattr(Bus, "write_goals", wrong)


@detected_by("safe wire")
def goals_leap_after_a_false_temperature(patch: pytest.MonkeyPatch) -> None:
    write, read, hot = JointBuses.write_goals, JointBuses.receive, set[str]()

    def receive(buses: JointBuses) -> dict[str, Any]:
        readings = read(buses)
        hot.update(name for name, one in readings.items() if getattr(one, "temperature_c", 0.0) > 60.0)
        return readings

    def wrong(buses: JointBuses, goals: Mapping[str, ServoGoal]) -> None:
        write(
            buses, {n: one._replace(position_counts=one.position_counts + 300 * (n in hot)) for n, one in goals.items()}
        )

    patch.setattr(JointBuses, "receive", receive)
    patch.setattr(JointBuses, "write_goals", wrong)
