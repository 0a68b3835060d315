"""What /joint_states is made of."""

import numpy as np

from controller.joint_state_broadcaster import JointStateBroadcaster
from hal.description import Mimic
from hal.types import JointState

ALL = ("position", "velocity", "effort")


def broadcaster() -> JointStateBroadcaster:
    interfaces = {
        "wrist": ("position",),
        "base": ALL,
        "left": ("position", "velocity"),
        "right": ("position", "velocity"),
    }
    return JointStateBroadcaster("jsb", interfaces, {"left": Mimic("right", -2.0, 0.1)}, ("base", "wrist", "right"))


def state() -> JointState:
    return JointState(7.0, np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.3]), np.array([10.0, 20.0, 30.0]))


def test_joints_are_alphabetical_mimics_follow_and_what_is_not_there_is_nan() -> None:
    controller = broadcaster()
    controller.update(state(), 7.0, 0.05)
    latest = controller.latest
    assert latest is not None
    assert latest.stamp_s == 7.0
    assert latest.names == ("base", "left", "right", "wrist")
    np.testing.assert_allclose(latest.position, [1.0, -5.9, 3.0, 2.0])
    np.testing.assert_allclose(latest.velocity, [0.1, -0.6, 0.3, np.nan])
    np.testing.assert_allclose(latest.effort, [10.0, np.nan, np.nan, np.nan])


def test_it_claims_nothing_and_is_always_settled() -> None:
    controller = broadcaster()
    assert controller.command_interfaces == ()
    assert controller.command.shape == (0,)
    assert controller.settled()


def test_nothing_old_is_shown_after_the_life_cycle_turned() -> None:
    controller = broadcaster()
    controller.update(state(), 7.0, 0.05)
    controller.deactivate()
    assert controller.latest is None
    controller.update(state(), 7.0, 0.05)
    controller.activate(state(), np.empty(0))
    assert controller.latest is None
