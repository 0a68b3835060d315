"""Test that an implausible position is ignored until a second reading confirms it, on any hardware."""

import logging
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from controller.action_goals import GoalStatus
from hal.components.component_set import ComponentSet
from hal.hardware import Hardware
from hal.lifecycle import LifecycleState
from hal.mock_hardware import MockHardware
from hal.types import JointLimits, JointState
from servoloop.simulation.stack import SimulatedStack
from sim_backend.clock import SimulatedClock
from tests.controller.bench import ARM_LIMITS, PERIOD_S, Bench, to

ELBOW = 1
LEAP = 1.5
WORDS = "No joint moves that fast, so the position is ignored until a second reading confirms it"


def falsify(hardware: Hardware, number: Callable[[int], float], joint: int = ELBOW) -> None:
    """Add ``number(n)`` to the position of a joint in the n-th reading from now."""
    read, count = hardware.read, 0

    def falsified() -> JointState:
        nonlocal count
        state = read()
        position = state.position.copy()
        position[joint] += number(count)
        count += 1
        return replace(state, position=position)

    hardware.read = falsified  # type: ignore[method-assign]


def once(at: int, leap: float = LEAP) -> Callable[[int], float]:
    return lambda n: leap if n == at else 0.0


@pytest.mark.parametrize("leap", [LEAP, -LEAP, 0.7])
@pytest.mark.parametrize("at", [0, 6, 12, 20, 30])
def test_one_false_reading_does_not_end_a_goal_or_move_a_joint(at: int, leap: float) -> None:
    truth, bench = Bench().up(), Bench().up()
    falsify(bench.hardware, once(at, leap))
    states: list[JointState] = []
    bench.loop.on_cycle = states.append
    for one in (truth, bench):
        handle = one.send(to(0.4, 0.8, path={"elbow": 0.2}))
        one.cycle(40)
        assert handle.status is GoalStatus.SUCCEEDED, handle.error_text
    np.testing.assert_allclose(bench.path(), truth.path(), atol=1e-9)
    faults = {n: state.faults for n, state in enumerate(states) if state.faults}
    assert list(faults) == [at] and set(faults[at]) == {"elbow"} and faults[at]["elbow"].kind == "implausible"
    text = faults[at]["elbow"].text
    assert text.startswith("elbow is measured at ") and (" +" if leap > 0 else " -") in text and WORDS in text
    assert np.abs(np.diff([state.position[ELBOW] for state in states])).max() < 2 * ARM_LIMITS.velocity * PERIOD_S


def test_a_leap_is_accepted_when_a_second_reading_confirms_it(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench().up()
    falsify(bench.hardware, lambda n: LEAP if n >= 3 else 0.0)
    states: list[JointState] = []
    bench.loop.on_cycle = states.append
    with caplog.at_level(logging.WARNING, "servoloop"):
        bench.cycle(8)
    assert [bool(state.faults) for state in states] == [n == 3 for n in range(8)]
    assert [state.position[ELBOW] for state in states] == pytest.approx([0.0] * 4 + [LEAP] * 4)
    assert [message for message in caplog.messages if WORDS in message] == [
        "scripted: elbow is measured at 1.5000, +1.5000 from the previous reading. " + WORDS
    ]


def test_every_possible_motion_of_a_joint_is_accepted() -> None:
    bench = Bench().up()
    states: list[JointState] = []
    bench.loop.on_cycle = states.append
    for goal in (to(1.9, -1.9, after_s=0.1), to(-1.9, 1.9, after_s=0.1)):
        handle = bench.send(goal)
        bench.cycles_until(lambda handle=handle: handle.done)  # type: ignore[misc]
    assert not any(state.faults for state in states)


def test_a_reactivated_component_forgets_old_readings() -> None:
    bench = Bench().up()
    bench.cycle(3)
    for target in (LifecycleState.INACTIVE, LifecycleState.ACTIVE):
        change = bench.loop.component_transitions.ask("scripted", target)
        bench.cycles_until(lambda change=change: change.done)  # type: ignore[misc]
        bench.hardware._position[:2] += 0.9  # moved by hand between two cycles, faster than is plausible
    states: list[JointState] = []
    bench.loop.on_cycle = states.append
    bench.cycle(2)
    assert not states[-1].faults


def test_only_new_readings_confirm_a_leap() -> None:
    """If a component is read only in every third cycle, the other cycles do not confirm an implausible position."""
    clock = SimulatedClock(5.0)
    hardware = MockHardware("slow", ("a",), clock)
    components = ComponentSet([hardware, MockHardware("other", ("b",), clock)], clock, [3, 1])
    components.filter_leaps({"a": JointLimits(-3.0, 3.0, 1.0, 4.0, 40.0)})
    for one in components.components:
        one.hardware.configure()
        one.hardware.activate()
    falsify(hardware, lambda n: LEAP if n >= 1 else 0.0, joint=0)
    seen = []
    for _ in range(9):
        clock.sleep_until(clock.now() + PERIOD_S)
        state = components.read()
        seen.append((float(state.position[0]), "a" in state.faults))
    assert seen == [(0.0, False)] * 3 + [(0.0, True)] * 3 + [(LEAP, False)] * 3


def test_a_continuous_joint_does_not_leap_at_a_full_turn() -> None:
    clock = SimulatedClock(5.0)
    hardware = MockHardware("wheel", ("a",), clock)
    components = ComponentSet([hardware], clock)
    components.filter_leaps({"a": JointLimits(-np.inf, np.inf, 1.0, 4.0, 40.0)})
    hardware.configure()
    hardware.activate()
    for position in (3.13, -3.13, 3.12):
        hardware._position[:] = position
        clock.sleep_until(clock.now() + PERIOD_S)
        assert not components.read().faults


@pytest.mark.parametrize("at", [3, 10, 18])
def test_false_readings_do_not_move_the_arm_in_mujoco(at: int) -> None:
    paths = []
    for leap in (0.0, LEAP):
        stack = SimulatedStack(wire=False).up()
        falsify(stack.loop.hardware.components[0].hardware, once(at, leap), joint=2)
        start = stack.loop.command[:6].tolist()
        handle = stack.go([*start[:2], start[2] + 0.4, *start[3:]], 0.8)
        path: list[float] = []
        stack.after_cycle = lambda path=path, stack=stack: path.append(float(stack.loop.command[2]))  # type: ignore[misc]
        stack.run(2.0)
        assert handle.status is GoalStatus.SUCCEEDED, handle.error_text
        paths.append(path)
    assert paths[0] == pytest.approx(paths[1], abs=1e-6)
