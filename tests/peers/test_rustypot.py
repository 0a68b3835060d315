"""Tests of rustypot on virtual servos of both makes: single registers, groups and motions.

The tests in tests/drivers check the tables of rustypot.
"""

import importlib
from math import radians
from typing import Any

import pytest

from tests.peers.conftest import Serve
from tests.peers.waiting import eventually

pytestmark = pytest.mark.slow

# Import by name, because it is a compiled module.
rustypot: Any = importlib.import_module("rustypot")
IDS = [1, 2, 3]


@pytest.mark.parametrize(
    ("model", "controller"),
    [("sts3215", "Sts3215PyController"), ("xl330-m288", "Xl330PyController")],
)
def test_a_group_is_read_and_moved(serve: Serve, model: str, controller: str) -> None:
    arm = getattr(rustypot, controller)(serve(model, *IDS), 1_000_000, 0.2)
    try:
        start = arm.sync_read_present_position(IDS)
        assert start == pytest.approx([start[0]] * 3, abs=0.01)
        arm.sync_write_torque_enable(IDS, [True] * 3)
        goals = [position + radians(10 * i) for i, position in zip(IDS, start, strict=True)]
        arm.sync_write_goal_position(IDS, goals)
        eventually(lambda: arm.sync_read_present_position(IDS) == pytest.approx(goals, abs=0.05))
        assert [arm.ping(i) for i in (1, 3)] == [True, True]
    finally:
        arm.close()
