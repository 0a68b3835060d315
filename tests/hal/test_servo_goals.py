"""Tests of the goals that are sent to servos in each cycle."""

from hypothesis import given
from hypothesis import strategies as st

from drivers.servos import sts
from hal.joint import Joint
from hal.servos.servo_goals import ServoGoals
from hal.types import JointLimits

PERIOD_S = 0.05
CYCLES = 100
WRIST = Joint("wrist", 6, sts.STS3215, JointLimits(-3.05, 3.05, 4.0, 12.0, 120.0), zero_counts=2048)


@given(command=st.floats(-3.05, 3.05), measured=st.integers(0, 4095), held=st.integers(60, 4036))
def test_a_goal_ends_between_the_command_and_the_joint(command: float, measured: int, held: int) -> None:
    """This also applies to a joint more than half a turn away: its servo does not take the shorter way around."""
    goals = ServoGoals([WRIST])
    goals.hold({"wrist": held})
    for _ in range(CYCLES):
        goal = goals.towards([command], PERIOD_S, {"wrist": measured}, {}, ())["wrist"].position_counts
    wanted = WRIST.counts(command)
    lower, upper = WRIST.counts_range()
    ends = (wanted, min(max(measured, lower), upper))
    assert min(ends) <= goal <= max(ends)
