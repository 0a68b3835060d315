"""Test that a goal is aborted after the same duration of a fault at every rate."""

import pytest

from hal.fault_timeout import FaultTimeout
from hal.types import JointFault

SILENT = {"elbow": JointFault("silent", "servo 2 does not respond")}
STALL_S = 0.2
"""Duration of a bus stall that must not abort a goal, in seconds."""


def cycles_until_given_up(period_s: float) -> int:
    timeout = FaultTimeout(("shoulder", "elbow"))
    return next(cycle for cycle in range(1, 1000) if timeout.lasting(SILENT, period_s))


@pytest.mark.parametrize(("rate_hz", "cycles"), [(5, 7), (20, 7), (50, 18), (100, 35), (400, 140)])
def test_the_timeout_is_seven_cycles_or_0_35_s_whichever_is_longer(rate_hz: int, cycles: int) -> None:
    assert cycles_until_given_up(1.0 / rate_hz) == cycles
    assert cycles - 1 > STALL_S * rate_hz + 1  # cycles of a stall, plus one cycle with late replies


def test_only_consecutive_cycles_count() -> None:
    timeout = FaultTimeout(("shoulder", "elbow"))
    for faults in ([SILENT] * 6 + [{}]) * 3:
        assert timeout.lasting(faults, 0.05) is None


SHOULDER = {"shoulder": JointFault("silent", "servo 1 does not respond")}
FINGER = {"finger": JointFault("silent", "servo 7 does not respond")}


def test_joints_are_counted_separately_and_other_joints_are_ignored() -> None:
    timeout = FaultTimeout(("shoulder", "elbow"))
    alternating = [
        {
            "shoulder": JointFault("silent", "servo 1 does not respond"),
            "finger": JointFault("silent", "servo 7 does not respond"),
        },
        SILENT,
    ]
    for cycle in range(20):
        assert timeout.lasting(alternating[cycle % 2] | FINGER, 0.05) is None
    both = SILENT | SHOULDER
    found = [timeout.lasting(both, 0.05) for _ in range(7)]
    assert found[-1] == "servo 1 does not respond; servo 2 does not respond"
