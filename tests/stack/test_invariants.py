"""Each invariant falls where it is broken on purpose, and none does where nothing is."""

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
from servoloop.campaign.end_invariants import EndsAsChosen, GoalsEnd
from servoloop.campaign.invariants import Watch
from servoloop.campaign.run import RunReport, run_schedule
from servoloop.files import read_files
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.schedule import Schedule
from sim_backend.faults.text import parse
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
def test_none_falls_where_the_stack_is_whole(faults: tuple[str, ...]) -> None:
    assert run(*faults).violations == ()


def without_faults(stack: FaultyStack) -> None:
    """What is wrong with the joints is not reported."""
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


def test_a_silent_servo_that_nothing_names() -> None:
    assert "named, and it alone" in fallen(run("silent id=3 at=0.5s for=0.6s", prepare=without_faults))


def test_a_servo_that_is_named_for_another_one() -> None:
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


def test_a_limp_joint_that_nothing_names() -> None:
    report = run("brown_out id=2 at=0.5s", prepare=without_faults)
    assert "limp joints are found" in fallen(report)


def test_a_velocity_that_is_no_number() -> None:
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
def test_a_gate_that_lets_it_pass(
    monkeypatch: pytest.MonkeyPatch, broken: Callable[..., Gated], fault: str, text: str
) -> None:
    """Also where the layers below make it harmless."""
    monkeypatch.setattr(SafetyGate, "limit", broken)
    violations = run(fault).violations
    assert any(one.invariant == "safe commands" and text in one.text for one in violations), violations


@pytest.mark.parametrize(("off", "text"), [(300, "leaps"), (4000, "is outside")])
def test_a_driver_that_sends_another_goal(monkeypatch: pytest.MonkeyPatch, off: int, text: str) -> None:
    """Seen on the wire, whatever the layers above believe to have sent."""
    stacks: list[FaultyStack] = []
    write_goals = JointBuses.write_goals

    def wrong(buses: JointBuses, goals: Mapping[str, ServoGoal]) -> None:
        if stacks[0].loop.hardware.state is LifecycleState.ACTIVE:
            goal = goals["joint2"]
            goals = {**goals, "joint2": goal._replace(position_counts=goal.position_counts + off)}
        write_goals(buses, goals)

    monkeypatch.setattr(JointBuses, "write_goals", wrong)
    (violation,) = run(prepare=stacks.append).violations
    assert violation.invariant == "safe wire" and "joint2: goal" in violation.text and text in violation.text


def test_a_goal_without_an_end_and_torque_behind_the_end() -> None:
    robot = FILES.robot
    on_exit = robot.file.on_exit.model_copy(update={"virtual": "relax"})
    relaxing = replace(FILES, robot=replace(robot, file=robot.file.model_copy(update={"on_exit": on_exit})))
    stack = FaultyStack(files=relaxing)
    watch = Watch(stack, (GoalsEnd, EndsAsChosen))
    stack.up()
    stack.go(PICK)
    stack.run(0.2)
    watch.end()
    assert set(watch.violations) == {GoalsEnd.name, EndsAsChosen.name}
    assert watch.violations[GoalsEnd.name].text == "of 1 goals these have no end: 1"
