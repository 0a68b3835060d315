"""Test the numeric states of servos."""

from dataclasses import replace

import numpy as np
import pytest

from controller.broadcasters.servo_state_broadcaster import ServoStateBroadcaster, ServoStateParameters
from drivers.bus.counters import ServoCounters
from hal.types import JointFault, JointState, ServoHealth

NAN = float("nan")
JOINTS = ("base", "wrist")
COUNTERS = ServoCounters(
    replies=9, silent=1, corrupt=2, late=3, refused=8, reset=7, alarms=4, retries=5, skipped=6, implausible=10
)


def state() -> JointState:
    health = {"wrist": ServoHealth(11.5, 41.0, ("overload", "overheating"), COUNTERS, -0.25, 0.4)}
    return JointState(
        1.0, np.zeros(2), np.zeros(2), np.zeros(2), {"wrist": JointFault("silent", "wrist: no reply")}, health
    )


def broadcaster(**parameters: object) -> ServoStateBroadcaster:
    return ServoStateBroadcaster("servos", ServoStateParameters.model_validate(parameters), JOINTS)


def shown(controller: ServoStateBroadcaster, cycles: int, period_s: float = 0.05) -> int:
    """Return the number of different states published in a number of cycles."""
    seen = set()
    for number in range(cycles):
        controller.update(replace(state(), stamp_s=number * period_s), number * period_s, period_s)
        assert controller.state is not None
        seen.add(controller.state.stamp_s)
    return len(seen)


def test_each_servo_has_all_values_by_name() -> None:
    controller = broadcaster()
    base, wrist = controller.values(state())
    assert dict(zip(controller.interfaces["wrist"], wrist, strict=True)) == {
        "temperature": 41.0,
        "voltage": 11.5,
        "load": -0.25,
        "current": 0.4,
        "alarms": 2.0,
        "fault": 1.0,
        "replies": 9.0,
        "silent": 1.0,
        "corrupt": 2.0,
        "late": 3.0,
        "refused": 8.0,
        "reset": 7.0,
        "alarm_replies": 4.0,
        "retries": 5.0,
        "skipped": 6.0,
        "implausible": 10.0,
    }
    assert dict(zip(controller.interfaces["base"], base, strict=True))["fault"] == 0.0
    np.testing.assert_equal(np.delete(base, 5), [NAN] * 15)


def test_a_servo_without_bus_counters_reports_none() -> None:
    controller = broadcaster(joints=["base"], interfaces=["silent", "voltage", "load", "current"])
    standing = replace(state(), health={"base": ServoHealth(7.4, 30.0)})
    np.testing.assert_equal(controller.values(standing), [[NAN, 7.4, NAN, NAN]])


def test_joints_and_interfaces_can_be_chosen() -> None:
    controller = broadcaster(joints=["wrist"], interfaces=["voltage", "temperature"])
    assert dict(controller.interfaces) == {"wrist": ("voltage", "temperature")}
    assert controller.values(state()) == [[11.5, 41.0]]


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"joints": ["elbow"]}, "joints has unknown entries elbow: choose from base, wrist"),
        ({"interfaces": ["power"]}, "interfaces has unknown entries power: choose from temperature, voltage"),
    ],
)
def test_unknown_joints_and_interfaces_are_rejected(parameters: dict[str, list[str]], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        broadcaster(**parameters)


@pytest.mark.parametrize(
    ("rate", "period_s", "cycles", "states"),
    [(1.0, 0.05, 100, 5), (0.0, 0.05, 100, 100), (20.0, 0.05, 100, 100), (10.0, 0.01, 100, 10), (100.0, 0.05, 9, 9)],
)
def test_the_broadcaster_publishes_at_its_rate(rate: float, period_s: float, cycles: int, states: int) -> None:
    assert shown(broadcaster(rate=rate), cycles, period_s) == states


def test_the_default_rate_is_once_a_second() -> None:
    assert shown(broadcaster(), 100) == 5


def test_the_rate_can_be_set_while_the_broadcaster_runs() -> None:
    controller = broadcaster(rate=1.0)
    controller.reconfigure(ServoStateParameters(rate=0.0))
    assert shown(controller, 10) == 10


def test_the_broadcaster_claims_nothing_and_has_no_old_state() -> None:
    controller = broadcaster()
    assert controller.command_interfaces == ()
    assert controller.command.shape == (0,)
    assert controller.settled()
    shown(controller, 1)
    controller.deactivate()
    assert controller.state is None
    shown(controller, 1)
    controller.activate(state(), np.empty(0))
    assert controller.state is None
