"""Who commands which joint, and what happens when one controller misbehaves."""

import numpy as np
import pytest

from controller.forward_command_controller import ForwardCommandController
from controller.manager import ClaimError, ControllerManager
from hal.lifecycle import LifecycleState
from hal.types import JointLimits, JointState

JOINTS = ("a", "b", "c")
LIMIT = JointLimits(-1.0, 1.0, 1.0, 1.0, 1.0)
STANDING = JointState(0.0, np.zeros(3), np.zeros(3), np.zeros(3))


def forward(name: str, *joints: str) -> ForwardCommandController:
    return ForwardCommandController(name, joints, [LIMIT] * len(joints), JOINTS)


class Stubborn(ForwardCommandController):
    """Cannot be deactivated."""

    def deactivate(self) -> None:
        raise RuntimeError("stubborn")


def manager(*controllers: ForwardCommandController) -> ControllerManager:
    made = ControllerManager(JOINTS)
    for controller in controllers:
        made.add(controller)
    return made


def test_a_joint_belongs_to_one_controller() -> None:
    made = manager(forward("first", "a", "b"))
    with pytest.raises(ClaimError, match="second and first both command b/position: a joint belongs to one controller"):
        made.add(forward("second", "b", "c"))
    assert list(made.controllers) == ["first"]


def test_each_commands_its_own_and_the_rest_stays() -> None:
    first, second = forward("first", "c"), forward("second", "a")
    made = manager(first, second)
    last = np.array([0.1, 0.2, 0.3])
    made.activate(STANDING, last)
    first.submit([0.7])
    second.submit([-0.7])
    np.testing.assert_allclose(made.update(STANDING, last, 0.0, 0.05), [-0.7, 0.2, 0.7])
    np.testing.assert_allclose(last, [0.1, 0.2, 0.3])


def test_an_inactive_controller_commands_nothing() -> None:
    first = forward("first", "a")
    made = manager(first)
    first.submit([0.7])
    last = np.zeros(3)
    np.testing.assert_allclose(made.update(STANDING, last, 0.0, 0.05), last)
    assert made.state("first") is LifecycleState.INACTIVE
    made.activate(STANDING, last)
    assert made.state("first") is LifecycleState.ACTIVE
    made.deactivate()
    assert made.state("first") is LifecycleState.INACTIVE


def test_settled_is_the_controllers_own_word_while_it_is_active() -> None:
    first = forward("first", "a")
    made = manager(first)
    assert made.settled("nobody")
    first.submit([0.7])
    assert made.settled("first")  # inactive: there is nothing to wait for
    made.activate(STANDING, np.zeros(3))
    first.submit([0.7])
    assert not made.settled("first")


def test_one_controller_that_cannot_be_deactivated_does_not_keep_the_others_active() -> None:
    made = manager(Stubborn("stubborn", ("a",), [LIMIT], JOINTS), forward("last", "b"))
    made.activate(STANDING, np.zeros(3))
    with pytest.raises(RuntimeError, match="stubborn"):
        made.deactivate()
    assert made.state("stubborn") is LifecycleState.INACTIVE
    assert made.state("last") is LifecycleState.INACTIVE
