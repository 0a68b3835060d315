"""Test when joints have settled, with limits on both sides of zero."""

from dataclasses import replace

import numpy as np
import pytest

from controller.settling import STILL_S, Settling
from hal.types import JointFault, JointLimits, JointState

LIMITS = JointLimits(-2.0, 1.0, velocity=1.0, acceleration=10.0, jerk=100.0)
PERIOD_S = 0.05


def state(position: float, velocity: float = 0.0) -> JointState:
    """Return a state of two joints, the second of which is observed."""
    return JointState(0.0, np.array([9.0, position]), np.array([9.0, velocity]), np.zeros(2))


def looked(command: float, *states: JointState) -> list[bool]:
    """Return whether the joint has settled after each cycle."""
    settling = Settling(["finger"], [LIMITS], [1])
    settling.command_changed()
    settled = []
    for seen in states:
        settling.update(np.array([command]), np.array([command]), seen, PERIOD_S)
        settled.append(settling.settled)
    return settled


@pytest.mark.parametrize(
    ("position", "there"), [(-1.5, True), (-1.559, True), (-1.441, True), (-1.57, False), (1.5, False)]
)
def test_a_joint_has_arrived_within_two_hundredths_of_its_range(position: float, there: bool) -> None:
    assert looked(-1.5, state(position, 0.5)) == [there]


@pytest.mark.parametrize(
    ("velocity", "stalls"), [(0.0, True), (0.029, True), (-0.029, True), (0.031, False), (-0.5, False)]
)
def test_a_joint_that_hardly_moves_has_stalled(velocity: float, stalls: bool) -> None:
    assert looked(0.5, *[state(0.0, velocity)] * 10)[-1] == stalls


def test_a_joint_settles_only_after_resting_for_some_time() -> None:
    settled = looked(0.5, *[state(0.0)] * 10)
    assert settled.index(True) * PERIOD_S > STILL_S
    assert settled == [False] * 4 + [True] * 6 or settled == [False] * 3 + [True] * 7


def test_an_unmeasured_joint_has_neither_stalled_nor_arrived() -> None:
    """While a finger is not measured, here for four cycles, it must not count as settled. Otherwise, the arm would
    start while its fingers are still open."""
    silent = replace(state(0.0), faults={"finger": JointFault("silent", "servo 7 does not respond")})
    moving, there = state(0.2, 0.9), state(0.5)
    assert looked(0.5, state(0.0), *[silent] * 4, moving, there) == [False] * 6 + [True]
    assert looked(0.5, *[replace(there, faults=silent.faults)] * 3, there) == [False] * 3 + [True]
    elsewhere = replace(there, faults={"elbow": JointFault("silent", "servo 2 does not respond")})
    assert looked(0.5, elsewhere) == [True]


def test_a_joint_that_passes_its_new_goal_before_it_reverses_has_not_arrived() -> None:
    settling = Settling(["finger"], [LIMITS], [1])
    settling.command_changed()
    seen = []
    for command, position in ((0.9, 0.3), (0.7, 0.5), (0.3, 0.6), (0.3, 0.4), (0.3, 0.31)):
        settling.update(np.array([0.3]), np.array([command]), state(position, 0.5), PERIOD_S)
        seen.append(settling.settled)
    assert seen == [False] * 4 + [True]


def test_a_joint_without_a_command_is_settled() -> None:
    settling = Settling(["finger"], [LIMITS], [1])
    settling.update(np.array([0.5]), np.array([0.5]), state(0.0, 0.5), PERIOD_S)
    assert settling.settled
