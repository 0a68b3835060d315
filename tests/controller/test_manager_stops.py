"""Test that joints come to rest within their limits after their controller is deactivated during a motion."""

import logging
from collections.abc import Callable

import numpy as np
import pytest

from controller.manager.manager import ControllerManager
from controller.manager.switch import SwitchRequest
from hal.lifecycle import LifecycleState
from hal.types import FloatArray, JointLimits, JointState
from tests.controller.manager_bench import STANDING, Puppet, managing

PERIOD_S = 0.05
LIMITS = JointLimits(-10.0, 10.0, velocity=2.0, acceleration=8.0, jerk=100.0)
ALL = dict.fromkeys("abc", LIMITS)


class Runner(Puppet):
    """Controller that always moves at 1 rad/s."""

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        self._called("update")
        self.command = self.command + period_s


def run(manager: ControllerManager, last: FloatArray, cycles: int) -> FloatArray:
    """Return the commands of several cycles, shape (cycles, 3), on ideal hardware."""
    rows = []
    for _ in range(cycles):
        last = manager.cycle.update(STANDING, last, 0.0, PERIOD_S)
        rows.append(last)
    return np.array(rows)


def switched_off(manager: ControllerManager, runner: Runner) -> None:
    manager.switch(SwitchRequest((), ("runner",)), np.zeros(3))


def released(manager: ControllerManager, runner: Runner) -> None:
    manager.release({"a/position"}, "test")


def failing(manager: ControllerManager, runner: Runner) -> None:
    runner.failing.add("update")


@pytest.mark.parametrize("go", [switched_off, released, failing])
def test_joints_without_a_controller_come_to_rest_within_the_limits(
    go: Callable[[ControllerManager, Runner], None], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.CRITICAL)
    runner, other = Runner("runner", "a"), Runner("other", "b")
    manager = managing(runner, other, active=["runner", "other"], limits=ALL)
    before = run(manager, np.array([0.1, 0.2, 0.3]), 3)
    go(manager, runner)
    path = np.vstack([before, run(manager, before[-1], 20)])
    velocity = np.diff(path, axis=0) / PERIOD_S
    acceleration = np.diff(velocity, axis=0) / PERIOD_S
    assert velocity[0, 0] == pytest.approx(1.0)
    assert (velocity[1:, 0] >= -1e-9).all() and velocity[-1, 0] == 0.0
    assert (np.abs(acceleration[:, 0]) <= LIMITS.acceleration + 1e-6).all()
    assert path[-1, 0] > before[-1, 0] + 0.03
    np.testing.assert_allclose(velocity[:, 1], 1.0)
    np.testing.assert_allclose(path[:, 2], 0.3)
    assert not manager.stops.holds([0, 1, 2])


def test_a_controller_of_moving_joints_starts_where_they_come_to_rest() -> None:
    runner, heir = Runner("runner", "a", "b"), Runner("heir", "a")
    manager = managing(runner, heir, active=["runner"], limits=ALL)
    before = run(manager, np.zeros(3), 3)
    manager.switch(SwitchRequest(("heir",), ("runner",)), before[-1])
    assert manager.registry.state("heir") is LifecycleState.ACTIVE
    path = np.vstack([before, run(manager, before[-1], 20)])
    velocity = np.diff(path, axis=0) / PERIOD_S
    rested = (
        int(np.argmax(velocity[3:, 1] == 0.0)) + 3
    )  # Joint b has no controller, so its position shows the duration of the stop.
    assert (np.abs(np.diff(velocity[:rested], axis=0)) <= LIMITS.acceleration * PERIOD_S + 1e-6).all()
    assert path[rested, 0] - before[-1, 0] > 0.03
    np.testing.assert_allclose(velocity[rested + 1 :, 0], 1.0)  # The new controller continues from there.
    assert heir.calls[0] == "activate" and "update" in heir.calls


def test_a_controller_that_waits_for_a_stop_does_not_delay_others() -> None:
    runner, heir, other = Runner("runner", "a"), Runner("heir", "a"), Runner("other", "b")
    manager = managing(runner, heir, other, active=["runner", "other"], limits=ALL)
    before = run(manager, np.zeros(3), 3)
    manager.switch(SwitchRequest(("heir",), ("runner",)), before[-1])
    path = np.vstack([before, run(manager, before[-1], 3)])
    assert manager.stops.holds([0]) and "update" not in heir.calls
    np.testing.assert_allclose(np.diff(path[:, 1]) / PERIOD_S, 1.0)


def test_deactivating_a_waiting_controller_does_not_interrupt_a_stop() -> None:
    runner, heir = Runner("runner", "a"), Runner("heir", "a")
    manager = managing(runner, heir, active=["runner"], limits=ALL)
    path = [*run(manager, np.zeros(3), 3)]
    manager.switch(SwitchRequest(("heir",), ("runner",)), path[-1])
    path += [*run(manager, path[-1], 2)]
    manager.switch(SwitchRequest((), ("heir",)), path[-1])
    path += [*run(manager, path[-1], 20)]
    velocity = np.diff(np.array(path)[:, 0]) / PERIOD_S
    assert (np.abs(np.diff(velocity)) <= LIMITS.acceleration * PERIOD_S + 1e-6).all()
    assert (velocity >= -1e-9).all() and velocity[-1] == 0.0
    assert "update" not in heir.calls


def test_joints_at_rest_stay_at_rest() -> None:
    puppet = Puppet("p", "a", wanted=0.4)
    manager = managing(puppet, active=["p"], limits=ALL)
    last = run(manager, np.zeros(3), 3)[-1]
    manager.switch(SwitchRequest((), ("p",)), last)
    assert not manager.stops.holds([0, 1, 2])
    np.testing.assert_array_equal(run(manager, last, 2)[-1], [0.4, 0.0, 0.0])
