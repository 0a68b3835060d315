import logging

import pytest

from controller.gate_log import log_gate

WIDE, NARROW = "-1.7453 to 1.7453", "-1.6900 to 1.6900"


def outside(value: str, limits: str) -> str:
    return f"position {value} is outside the limits {limits}: returning slowly"


def test_joints_with_different_limits_are_logged_separately(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    log_gate({"joint1/position": outside("-1.7457", WIDE), "joint2/position": outside("1.8438", NARROW)})
    assert caplog.messages == [
        f"safety gate: joint1: {outside('-1.7457', WIDE)}",
        f"safety gate: joint2: {outside('1.8438', NARROW)}",
    ]


def test_joints_with_equal_limits_share_a_line(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    log_gate({"joint1/position": outside("1.7457", WIDE), "joint2/position": outside("1.8438", WIDE)})
    assert caplog.messages == [f"safety gate: joint1, joint2: {outside('1.7457 to 1.8438', WIDE)}"]
