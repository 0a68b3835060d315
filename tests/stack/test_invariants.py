"""Each invariant is violated by its own defect, and none without a defect."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest

from drivers.bus.types import ServoGoal
from hal.gate import Gated, SafetyGate
from hal.lifecycle import LifecycleState
from hal.servos.joint_buses import JointBuses
from hal.types import FloatArray, JointState
from nodes.pick_place.settings import Settings
from servoloop.campaign.invariants.end import EndsAsChosen
from servoloop.campaign.invariants.goals import GoalsEnd
from servoloop.campaign.invariants.watch import Watch
from servoloop.campaign.run import RunReport, run_schedule
from servoloop.simulation.acts import Act, Cancel, Move
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.schedule import Schedule
from servoloop.stack.robot_files import read_files
from sim_backend.faults.text import parse
from tests.servoloop.planted_bugs import BUGS
from tests.stack.rig import PICK

FILES = read_files()


def run(*faults: str, prepare: Callable[[FaultyStack], None] = lambda stack: None) -> RunReport:
    schedule = Schedule(seed=3, seconds=2.0, faults=tuple(map(parse, faults)))
    return run_schedule(FILES, Settings(), schedule, prepare=prepare)


def fallen(report: RunReport) -> set[str]:
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
def test_no_invariant_is_violated_without_defects(faults: tuple[str, ...]) -> None:
    assert run(*faults).violations == ()


def without_faults(stack: FaultyStack) -> None:
    """Suppress the faults of the joints."""
    read = stack.hardware.read

    def blind() -> JointState:
        return replace(read(), faults={})

    stack.hardware.read = blind  # type: ignore[method-assign]


def with_nan(stack: FaultyStack) -> None:
    read = stack.hardware.read

    def wrong() -> JointState:
        state = read()
        return replace(state, velocity=np.where(state.stamp_s > 1.0, np.nan, state.velocity))

    stack.hardware.read = wrong  # type: ignore[method-assign]


def test_detects_silent_servo_that_is_not_reported() -> None:
    assert "named, and it alone" in fallen(run("silent id=3 at=0.5s for=0.6s", prepare=without_faults))


def test_detects_servo_reported_in_place_of_another() -> None:
    def blames(stack: FaultyStack) -> None:
        read = stack.hardware.read

        def wrong() -> JointState:
            state = read()
            return replace(
                state, faults=dict.fromkeys(("joint3", "joint5"), one) if (one := state.faults.get("joint3")) else {}
            )

        stack.hardware.read = wrong  # type: ignore[method-assign]

    (violation,) = run("silent id=3 at=0.5s for=0.6s", prepare=blames).violations
    assert violation.text.startswith("joint5 is named, and well")


def test_detects_limp_joint_that_is_not_reported() -> None:
    report = run("brown_out id=2 at=0.5s", prepare=without_faults)
    assert "limp joints are found" in fallen(report)


def test_detects_nan_velocity() -> None:
    assert "safe commands" in fallen(run(prepare=with_nan))


def no_limits(gate: SafetyGate, wanted: FloatArray, last: FloatArray, *_: object) -> Gated:
    return Gated(wanted, {})


def no_nan(gate: SafetyGate, wanted: FloatArray, last: FloatArray, *_: object) -> Gated:
    return Gated(np.where(np.isfinite(wanted), np.clip(wanted, last - 0.1, last + 0.1), np.nan), {})


@pytest.mark.parametrize(
    ("broken", "fault", "text"),
    [
        (no_limits, "controller_jumps by=0.8 at=0.3s for=0.5s", "leap within a cycle"),
        (no_nan, "controller_jumps by=6 at=0.3s for=1.5s", "beyond the limits"),
        (no_nan, "controller_nan at=0.3s for=0.5s", "no number"),
    ],
)
def test_detects_safety_gate_that_passes_bad_commands(
    monkeypatch: pytest.MonkeyPatch, broken: Callable[..., Gated], fault: str, text: str
) -> None:
    """This holds even if lower layers make the command harmless."""
    monkeypatch.setattr(SafetyGate, "limit", broken)
    violations = run(fault).violations
    assert any(one.invariant == "safe commands" and text in one.text for one in violations), violations


@pytest.mark.parametrize(("off", "text"), [(300, "leaps"), (4000, "is outside")])
def test_detects_driver_that_sends_a_wrong_goal(monkeypatch: pytest.MonkeyPatch, off: int, text: str) -> None:
    """The bytes on the wire count, whatever the upper layers report."""
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


def test_detects_goal_without_result_and_torque_after_shutdown() -> None:
    stack = FaultyStack(files=FILES)
    stack.relaxes = True
    watch = Watch(stack, (GoalsEnd, EndsAsChosen))
    stack.up()
    stack.go(PICK)
    stack.run(0.2)
    watch.end()
    assert set(watch.violations) == {GoalsEnd.name, EndsAsChosen.name}
    assert watch.violations[GoalsEnd.name].text == "1 of 1 goals have no end"


MOVES = (
    Move(at_s=0.1, positions={"joint1": 0.4, "joint2": -0.3}, seconds=1.0),
    Cancel(at_s=0.6),
    Move(at_s=1.6, positions={"joint1": -0.2, "joint2": 0.2}, seconds=0.8),
)
JAMMED = (Move(at_s=0.1, positions={"joint1": 1.2}, seconds=3.0),)


@pytest.mark.parametrize(
    ("bug", "invariant", "clients", "faults"),
    [
        ("sign_left_out_of_goals", "goals mean commands", MOVES, ()),
        ("sign_left_out_of_positions", "reported truly", MOVES, ()),
        ("cancels_are_ignored", "cancels are followed", MOVES, ()),
        ("stops_are_dead", "smooth reference", (Move(positions={"joint1": 1.5}, seconds=0.5), Cancel(at_s=0.4)), ()),
        ("feedback_is_a_cycle_old", "feedback is true", MOVES, ()),
        ("arm_goes_back_after_an_abort", "nothing travels after the end", MOVES, ()),
        ("limits_of_goals_are_not_looked_at", "goals are judged", (Move(positions={"joint1": 9.0}),), ()),
        ("goal_tolerance_is_not_looked_at", "success is true", JAMMED, ("jammed id=1 at=2.8s",)),
        ("path_tolerance_is_not_looked_at", "deviation ends a goal", JAMMED, ("jammed id=1",)),
        ("abort_blames_the_joint_before", "aborts are true", JAMMED, ("jammed id=1",)),
        ("no_joint_is_relieved", "nothing presses after the end", JAMMED, ("jammed id=1",)),
        ("silent_servo_is_never_taken_back", "taken back", (), ("silent id=3 for=0.3s",)),
        ("gate_takes_zero_for_nan", "nan holds", MOVES, ("controller_nan at=0.5s for=0.3s",)),
    ],
)
def test_planted_bug_is_reported_and_its_schedule_passes_without_it(
    monkeypatch: pytest.MonkeyPatch, bug: str, invariant: str, clients: tuple[Act, ...], faults: tuple[str, ...]
) -> None:
    schedule = Schedule(seconds=6.0, clients=clients, faults=tuple(map(parse, faults)))
    assert run_schedule(FILES, Settings(), schedule).violations == ()
    BUGS[bug][0](monkeypatch)
    assert invariant in fallen(run_schedule(FILES, Settings(), schedule))
