"""A goal is given up after so many cycles with a fault, at each rate."""

import pytest

from controller.fault_timeout import FaultTimeout
from hal.types import JointFault

SILENT = {"elbow": JointFault("silent", "servo 2 does not answer")}
STALL_S = 0.2
"""A line may stall for so long."""


def cycles_until_given_up(period_s: float) -> int:
    timeout = FaultTimeout(("shoulder", "elbow"))
    return next(cycle for cycle in range(1, 1000) if timeout.lasting(SILENT, period_s))


@pytest.mark.parametrize(("rate_hz", "cycles"), [(5, 7), (20, 7), (50, 18), (100, 35), (400, 140)])
def test_seven_cycles_or_as_many_as_make_0_35_s_whichever_is_more(rate_hz: int, cycles: int) -> None:
    assert cycles_until_given_up(1.0 / rate_hz) == cycles
    assert cycles - 1 > STALL_S * rate_hz + 1  # those that a stall can take, and one for what it has left behind


def test_the_cycles_must_come_in_a_row() -> None:
    timeout = FaultTimeout(("shoulder", "elbow"))
    for faults in ([SILENT] * 6 + [{}]) * 3:
        assert timeout.lasting(faults, 0.05) is None


SHOULDER = {"shoulder": JointFault("silent", "servo 1 does not answer")}
FINGER = {"finger": JointFault("silent", "servo 7 does not answer")}


def test_each_joint_counts_for_itself_and_others_not_at_all() -> None:
    timeout = FaultTimeout(("shoulder", "elbow"))
    alternating = [
        {
            "shoulder": JointFault("silent", "servo 1 does not answer"),
            "finger": JointFault("silent", "servo 7 does not answer"),
        },
        SILENT,
    ]
    for cycle in range(20):
        assert timeout.lasting(alternating[cycle % 2] | FINGER, 0.05) is None
    both = SILENT | SHOULDER
    found = [timeout.lasting(both, 0.05) for _ in range(7)]
    assert found[-1] == "servo 1 does not answer; servo 2 does not answer"
