"""Tests of the invariants: each one detects its planted bug, and none is violated without a bug."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from controller.motion import Kinematics, RuckigMotion
from drivers.driver_errors import PortLost
from drivers.types import ServoGoal
from hal.gate import Gated, SafetyGate
from hal.joint import Joint
from hal.lifecycle import LifecycleState
from hal.servos.activation import Activation
from hal.servos.joint_buses import JointBuses
from hal.types import FloatArray, JointState
from pick_place.settings import JobSettings
from servoloop.campaign.invariants.goals.ends import GoalsEnd
from servoloop.campaign.invariants.lifecycle.end import EndsAsChosen
from servoloop.campaign.invariants.watch import Watch
from servoloop.campaign.run import RunReport, run_schedule, with_exit_policy
from servoloop.simulation.acts import Act, Cancel, Move, Reactivate
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.schedule import Schedule
from servoloop.stack.robot_files import read_files
from sim_backend.faults.text import parse
from tests.ros.two_components import write_servos
from tests.servoloop.planted_bugs import BUGS
from tests.stack.rig import PICK

FILES = read_files()


def run(*faults: str, prepare: Callable[[FaultyStack], None] = lambda stack: None) -> RunReport:
    schedule = Schedule(seed=3, seconds=2.0, faults=tuple(map(parse, faults)))
    return run_schedule(FILES, {"": JobSettings()}, schedule, prepare=prepare)


def violated(report: RunReport) -> set[str]:
    return {violation.invariant for violation in report.violations}


@pytest.mark.parametrize(
    "faults",
    [
        (),
        ("silent id=3 at=0.5s for=0.3s",),
        ("brown_out id=2 at=0.5s",),
        ("controller_jumps by=0.8 at=0.5s for=0.2s",),
        ("controller_nan at=0.5s for=0.2s", "stall for=0.3s at=1s"),
        ("adapter_unplugged at=0.5s for=0.5s",),
    ],
    ids=" and ".join,
)
def test_no_invariant_is_violated_without_a_bug(faults: tuple[str, ...]) -> None:
    assert run(*faults).violations == ()


def without_faults(stack: FaultyStack) -> None:
    """Plant a bug: the faults of joints are not reported."""
    read = stack.hardware.read

    def blind() -> JointState:
        return replace(read(), faults={})

    stack.hardware.read = blind  # type: ignore[method-assign]


def with_nan(stack: FaultyStack) -> None:
    """Plant a bug: measured velocities become NaN."""
    read = stack.hardware.read

    def wrong() -> JointState:
        state = read()
        return replace(state, velocity=np.where(state.stamp_s > 1.0, np.nan, state.velocity))

    stack.hardware.read = wrong  # type: ignore[method-assign]


def test_a_silent_servo_that_is_not_reported() -> None:
    assert "silent servo is reported" in violated(run("silent id=3 at=0.5s for=0.6s", prepare=without_faults))


def test_a_working_servo_that_is_reported_with_a_silent_one() -> None:
    def reports_joint5(stack: FaultyStack) -> None:
        read = stack.hardware.read

        def wrong() -> JointState:
            state = read()
            return replace(
                state, faults=dict.fromkeys(("joint3", "joint5"), one) if (one := state.faults.get("joint3")) else {}
            )

        stack.hardware.read = wrong  # type: ignore[method-assign]

    violations = {
        one.invariant: one.text for one in run("silent id=3 at=0.5s for=0.6s", prepare=reports_joint5).violations
    }
    assert violations["silent servo is reported"].startswith("joint5 works but is reported")
    assert violations["reported truly"].startswith("joint5 is not measured, but its reported position changes")


def test_a_joint_without_torque_that_is_not_reported() -> None:
    report = run("brown_out id=2 at=0.5s", prepare=without_faults)
    assert "limp joints are found" in violated(report)


def test_a_velocity_that_is_nan() -> None:
    assert "safe commands" in violated(run(prepare=with_nan))


def no_limits(gate: SafetyGate, wanted: FloatArray, last: FloatArray, *_: object) -> Gated:
    return Gated(wanted, {})


def no_nan(gate: SafetyGate, wanted: FloatArray, last: FloatArray, *_: object) -> Gated:
    return Gated(np.where(np.isfinite(wanted), np.clip(wanted, last - 0.1, last + 0.1), np.nan), {})


@pytest.mark.parametrize(
    ("broken", "fault", "text"),
    [
        (no_limits, "controller_jumps by=0.8 at=0.3s for=0.5s", "jump in one cycle"),
        (no_nan, "controller_jumps by=6 at=0.3s for=1.5s", "beyond the limits"),
        (no_nan, "controller_nan at=0.3s for=0.5s", "become NaN"),
    ],
)
def test_a_gate_that_passes_a_wrong_command(
    monkeypatch: pytest.MonkeyPatch, broken: Callable[..., Gated], fault: str, text: str
) -> None:
    """The violation is found even if the layers below make the command harmless."""
    monkeypatch.setattr(SafetyGate, "limit", broken)
    violations = run(fault).violations
    assert any(one.invariant == "safe commands" and text in one.text for one in violations), violations


@pytest.mark.parametrize(("off", "text"), [(300, "jumps"), (4000, "is outside")])
def test_a_driver_that_sends_a_wrong_goal(monkeypatch: pytest.MonkeyPatch, off: int, text: str) -> None:
    """The violation is found in the bytes on the bus."""
    stacks: list[FaultyStack] = []
    write_goals = JointBuses.write_goals

    def wrong(buses: JointBuses, goals: Mapping[str, ServoGoal]) -> None:
        if stacks[0].loop.hardware.state is LifecycleState.ACTIVE:
            goal = goals["joint2"]
            goals = {**goals, "joint2": goal._replace(position_counts=goal.position_counts + off)}
        write_goals(buses, goals)

    monkeypatch.setattr(JointBuses, "write_goals", wrong)
    violations = {violation.invariant: violation.text for violation in run(prepare=stacks.append).violations}
    assert "joint2: goal" in violations["safe wire"] and text in violations["safe wire"]
    assert "joint2: goal" in violations["goals mean commands"]


@pytest.mark.parametrize(("kick", "seen"), [(6.0, set()), (40.0, {"no joint too fast"})])
@pytest.mark.parametrize("fault", ["", "jammed id=1 at=0.8s for=0.1s"])
def test_a_joint_that_turns_faster_than_its_limit(kick: float, seen: set[str], fault: str) -> None:
    """The speed of a jammed joint does not count, because the joint may spring back. The speed after a hard blow of 20
    ms counts."""

    def with_a_blow(stack: FaultyStack) -> None:
        def strike(time_s: float) -> None:
            if 1.0 < time_s <= 1.0 + 0.02:
                stack.world.data.joint("joint1").qvel[:] = kick

        stack.on_step = strike

    report = run(*[fault] * bool(fault), prepare=with_a_blow)
    assert violated(report) & {"no joint too fast"} == (seen if not fault else set())


def test_a_goal_that_does_not_end_and_torque_after_the_end() -> None:
    stack = FaultyStack(files=with_exit_policy(FILES, "relax"))
    watch = Watch(stack, (GoalsEnd, EndsAsChosen))
    stack.up()
    stack.go(PICK)
    stack.run(0.2)
    watch.end()
    assert set(watch.violations) == {GoalsEnd.name, EndsAsChosen.name}
    assert watch.violations[GoalsEnd.name].text == "1 of 1 goals did not end"


def test_a_path_that_makes_a_detour(monkeypatch: pytest.MonkeyPatch) -> None:
    sample = RuckigMotion.sample

    def sway(motion: RuckigMotion, time_s: float) -> Kinematics:
        state, share = sample(motion, time_s), min(time_s / max(motion.duration_s, 0.1), 1.0)
        return replace(state, position=state.position + 0.05 * (1.0 - math.cos(math.tau * share)))

    clients = (Move(positions={"joint1": 0.4}, seconds=3.0),)
    schedule = Schedule(seconds=5.0, clients=clients)
    assert run_schedule(FILES, {"": JobSettings()}, schedule).violations == ()
    monkeypatch.setattr(RuckigMotion, "sample", sway)
    texts = {one.invariant: one.text for one in run_schedule(FILES, {"": JobSettings()}, schedule).violations}
    assert "but its path extends from" in texts["path is as sent"], texts


MOVES = (
    Move(at_s=0.1, positions={"joint1": 0.4, "joint2": -0.3}, seconds=1.0),
    Cancel(at_s=0.6),
    Move(at_s=1.6, positions={"joint1": -0.2, "joint2": 0.2}, seconds=0.8),
)
CANCELED = (Move(positions={"joint1": 1.2, "joint2": -0.3}, seconds=2.0), Cancel(at_s=1.0))
JAMMED = (Move(at_s=0.1, positions={"joint1": 1.2}, seconds=3.0),)


@pytest.mark.parametrize(
    ("bug", "invariant", "clients", "faults"),
    [
        ("sign_left_out_of_goals", "goals mean commands", MOVES, ()),
        ("sign_left_out_of_positions", "reported truly", MOVES, ()),
        ("cancels_are_ignored", "cancels are followed", MOVES, ()),
        ("stops_are_abrupt", "smooth reference", (Move(positions={"joint1": 1.5}, seconds=0.5), Cancel(at_s=0.4)), ()),
        ("stops_leave_the_path", "stops follow paths", CANCELED, ()),
        ("feedback_is_one_cycle_old", "feedback is true", MOVES, ()),
        ("arm_moves_back_after_an_abort", "nothing travels after the end", MOVES, ()),
        ("limits_of_goals_are_not_checked", "goals are judged", (Move(positions={"joint1": 9.0}),), ()),
        ("goal_tolerance_is_ignored", "success is true", JAMMED, ("jammed id=1 at=2.8s",)),
        ("path_tolerance_is_ignored", "deviation ends a goal", JAMMED, ("jammed id=1",)),
        ("abort_names_the_previous_joint", "aborts are true", JAMMED, ("jammed id=1",)),
        ("no_joint_is_relieved", "nothing presses after the end", JAMMED, ("jammed id=1",)),
        ("silent_servo_never_returns", "taken back", (), ("silent id=3 for=0.3s",)),
        ("gate_replaces_nan_by_zero", "nan holds", MOVES, ("controller_nan at=0.5s for=0.3s",)),
        ("goals_take_twice_as_long", "path is as sent", (Move(positions={"joint1": 0.3}, seconds=2.0),), ()),
        ("error_codes_are_zero", "aborts are true", JAMMED, ("jammed id=1",)),
        ("silent_joints_are_reported_at_zero", "reported truly", MOVES, ("silent id=2 at=0.8s for=0.5s",)),
        ("trajectories_do_not_wait", "trajectories wait", MOVES, ("lost_replies at=1.8s for=0.3s",)),
    ],
)
def test_a_planted_bug_is_detected_and_its_schedule_passes_without_the_bug(
    monkeypatch: pytest.MonkeyPatch, bug: str, invariant: str, clients: tuple[Act, ...], faults: tuple[str, ...]
) -> None:
    schedule = Schedule(seconds=6.0, clients=clients, faults=tuple(map(parse, faults)))
    assert run_schedule(FILES, {"": JobSettings()}, schedule).violations == ()
    BUGS[bug][0](monkeypatch)
    assert invariant in violated(run_schedule(FILES, {"": JobSettings()}, schedule))


def test_a_failed_activation_that_releases_driven_joints(monkeypatch: pytest.MonkeyPatch) -> None:
    """Servo 3 becomes silent while the driven arm is being activated."""
    fault, clients = parse("silent id=3 at=1.34s for=1.5s"), (Reactivate(at_s=0.2, for_s=0.5),)
    schedule = Schedule(seed=3, seconds=2.0, clients=clients, faults=(fault,))
    assert run_schedule(FILES, {"": JobSettings()}, schedule).violations == ()
    monkeypatch.setattr(Activation, "undo", lambda activation: activation._setup.torque_off(activation._joints))
    texts = {one.invariant: one.text for one in run_schedule(FILES, {"": JobSettings()}, schedule).violations}
    assert "a failed activation has released it" in texts["activated as configured"]


def test_a_robot_with_two_components_is_examined_as_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The hand is a component of its own and receives a goal in every second cycle."""
    files = read_files(write_servos(tmp_path))
    schedule = Schedule(seconds=2.0, clients=(Move(at_s=0.2, positions={"joint1": 0.5}, seconds=1.0),))
    report = run_schedule(files, {"": JobSettings()}, schedule)
    assert report.violations == () and report.examined["goals mean commands"] > 300
    counts = Joint.counts
    monkeypatch.setattr(Joint, "counts", lambda joint, position: counts(replace(joint, sign=1), position))
    assert "goals mean commands" in violated(run_schedule(files, {"": JobSettings()}, schedule))


@pytest.mark.parametrize(
    ("error", "invariant", "text"),
    [
        (PortLost("the port is lost"), "silent servo is reported", "was never unplugged"),
        (KeyError("joint"), "no crash", "KeyError('joint')"),
    ],
)
def test_an_error_that_the_stack_survives_is_reported(error: Exception, invariant: str, text: str) -> None:
    """A component is lost without a fault, or because of an internal error."""

    def failing(stack: FaultyStack) -> None:
        read, cycles = stack.hardware.read, count()

        def wrong() -> JointState:
            if next(cycles) > 20:
                raise error
            return read()

        stack.hardware.read = wrong  # type: ignore[method-assign]

    texts = {one.invariant: one.text for one in run(prepare=failing).violations}
    assert text in texts[invariant]


@pytest.mark.parametrize(
    "fault",
    [
        "false_value id=3 register=present_temperature value=33 at=0.2s for=0.1s",
        "wrong_setting id=3 register=led_alarm_condition value=3 at=0.2s for=0.1s",
    ],
)
def test_a_fault_that_leaves_the_position_right_excuses_no_wrong_goal(
    fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, cycles = JointBuses.write_goals, count()

    def wrong(buses: JointBuses, goals: Mapping[str, ServoGoal]) -> None:
        if next(cycles) > 20 and "joint3" in goals:
            goal = goals["joint3"]
            goals = {**goals, "joint3": goal._replace(position_counts=goal.position_counts + 300)}
        write(buses, goals)

    monkeypatch.setattr(JointBuses, "write_goals", wrong)
    assert {"safe wire", "goals mean commands"} <= violated(run(fault))
