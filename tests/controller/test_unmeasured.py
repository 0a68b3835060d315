"""A goal goes on for one cycle without a measurement of its joints, and then waits."""

import pytest

from controller.unmeasured import Unmeasured
from hal.types import JointFault

STEP_S = 0.05
SILENT, LIMP = JointFault("silent", ""), JointFault("no_torque", "")


@pytest.mark.parametrize(
    ("cycles", "steps"),
    [
        ([{"a": SILENT, "b": SILENT}, {}], [1, 1]),
        ([{"a": SILENT, "b": SILENT}] * 3 + [{}, {}], [1, 0, 0, 1, 1]),
        ([{"a": SILENT}] * 3, [1, 1, 1]),
        ([{"a": SILENT, "b": LIMP}] * 3, [1, 1, 1]),
        ([{"a": SILENT, "b": SILENT, "c": LIMP}] * 2, [1, 0]),
    ],
    ids=["one lost answer", "a stall", "one silent joint", "a limp one is measured", "others count for nothing"],
)
def test_how_far_a_goal_goes_on(cycles: list[dict[str, JointFault]], steps: list[int]) -> None:
    unmeasured = Unmeasured(("a", "b"))
    assert [unmeasured.step_s(faults, STEP_S) for faults in cycles] == [STEP_S * step for step in steps]
