"""Messages of other programs are sorted by joint, or are refused with the reason."""

import math

import numpy as np
import pytest

from controller.host.joint_commands import JointCommands, RefusedCommandError

ARM = JointCommands(["a", "b"], {"mimic"})
NAN = math.nan


@pytest.mark.parametrize(
    ("names", "positions", "expected"),
    [
        (["a", "b"], [1.0, 2.0], [1.0, 2.0]),
        (["b", "a"], [2.0, 1.0], [1.0, 2.0]),
        (["b"], [2.0], [NAN, 2.0]),
        (["a", "b"], [NAN, 2.0], [NAN, 2.0]),
        (["wheel", "a", "b"], [1.0, 2.0], [1.0, 2.0]),
        (["a", "mimic", "b"], [1.0, 3.0, 2.0], [1.0, 2.0]),
    ],
    ids=["all", "other order", "some", "not commanded", "without command interface", "with a mimic joint"],
)
def test_a_command_is_sorted_by_joint(names: list[str], positions: list[float], expected: list[float]) -> None:
    assert np.array_equal(ARM.sorted(names, positions), expected, equal_nan=True)


@pytest.mark.parametrize(
    ("names", "positions", "reason"),
    [
        (["a", "b"], [], "the command has no positions: in <ros2_control>, declare a position command interface"),
        (["a", "b"], [1.0], "1 positions for 2 joints, and this arm moves 2 of these joints: send one position for"),
        (["a", "c"], [1.0, 2.0], "the command contains c, but this arm moves a, b: use the same joint names"),
        (["a", "a"], [1.0, 2.0], "the command contains a twice"),
        (["a", "b"], [1.0, -math.inf], "the command for b is infinite"),
        ([], [1.0], "1 positions for 0 joints"),
    ],
)
def test_a_message_that_is_no_command_is_refused(names: list[str], positions: list[float], reason: str) -> None:
    with pytest.raises(RefusedCommandError, match=reason):
        ARM.sorted(names, positions)
