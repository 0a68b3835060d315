"""Tests of the goals that are sent to servos in each cycle."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from drivers.servos import sts
from drivers.types import ServoGoal
from hal.joint import Joint
from hal.servos.servo_goals import ServoGoals
from hal.types import JointLimits

PERIOD_S = 0.05
CYCLES = 100
WRIST = Joint("wrist", 6, sts.STS3215, JointLimits(-3.05, 3.05, 4.0, 12.0, 120.0), zero_counts=2048)


@given(command=st.floats(-3.05, 3.05), measured=st.integers(0, 4095), held=st.integers(60, 4036))
def test_a_goal_ends_between_the_command_and_the_joint(command: float, measured: int, held: int) -> None:
    """The joint may be more than half a turn away from its goal: its servo does not take the shorter way around."""
    goals = ServoGoals([WRIST])
    goals.hold({"wrist": held})
    for _ in range(CYCLES):
        goal = goals.towards([command], PERIOD_S, {"wrist": measured}, {}, ())["wrist"].position_counts
    wanted = WRIST.counts(command)
    lower, upper = WRIST.counts_range()
    ends = (wanted, min(max(measured, lower), upper))
    assert min(ends) <= goal <= max(ends)


FREE = replace(
    WRIST, limits=replace(WRIST.limits, lower=-30.0, upper=30.0), zero_counts=0, torque_limit=0.5, seam_inside=True
)
"""A joint during its automatic calibration. The servo counts turns, but reports its position within one turn."""
TURN = FREE.model.counts_per_turn


def goals_ahead(blocked: int, way: int) -> list[ServoGoal]:
    """Return the goals of a joint that is blocked at these counts, relative to the counts."""
    goals = ServoGoals([FREE])
    goals.hold({"wrist": blocked})
    found: list[ServoGoal] = []
    for cycle in range(CYCLES):
        command = FREE.position(blocked + way * min(25 * cycle, 1500))  # then at rest, which counts as a stall
        goal = goals.towards([command], PERIOD_S, {"wrist": blocked % TURN}, {"wrist": way * 0.5}, ())["wrist"]
        found.append(goal._replace(position_counts=goal.position_counts - blocked))
    return found


@given(blocked=st.integers(-2 * TURN, 2 * TURN), way=st.sampled_from((-1, 1)))
def test_the_seam_does_not_change_the_goals_of_a_blocked_joint(blocked: int, way: int) -> None:
    assert goals_ahead(blocked, way) == goals_ahead(TURN // 2, way)
