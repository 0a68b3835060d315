"""Test that commands stay within the limits and every goal ends exactly once, for random clients and faults."""

from itertools import pairwise
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from controller.action_goals import GoalStatus
from controller.trajectory.goal import GoalHandle, GoalPoint, TrajectoryGoal
from hal.lifecycle import LifecycleState
from hal.types import JointFault
from tests.controller.bench import ARM, JOINTS, LIMITS, PERIOD_S, Bench, arm_parameters

VELOCITY = np.array([LIMITS[name].velocity for name in JOINTS])
LOWER = np.array([LIMITS[name].lower for name in JOINTS])
UPPER = np.array([LIMITS[name].upper for name in JOINTS])

any_number = st.floats(-2.5, 2.5) | st.floats()
pairs = st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)) | st.tuples(any_number, any_number)
extras = st.just(()) | pairs
points = st.builds(GoalPoint, pairs, st.floats(-1.0, 5.0), extras, extras)


class CountingHandle(GoalHandle):
    """Goal handle that records every status."""

    def __init__(self, goal: TrajectoryGoal) -> None:
        self.seen: list[GoalStatus] = []
        super().__init__(goal)

    def __setattr__(self, name: str, value: object) -> None:
        if isinstance(value, GoalStatus):
            self.seen.append(value)
        super().__setattr__(name, value)


class Client(RuleBasedStateMachine):
    """Random sequences of goals, topic messages, cancels, speed changes, hand commands, faults and late cycles."""

    method = "ruckig"

    def __init__(self) -> None:
        super().__init__()
        settings_ = arm_parameters(
            wait_for=["hand"],
            wait_for_timeout=0.3,
            command_lead=0.013,
            interpolation_method=self.method,
            allow_partial_joints_goal=True,
        )
        self.bench = Bench(settings_).up()
        self.handles: list[CountingHandle] = []
        self.checked = 0

    @rule(
        way=st.lists(points, min_size=1, max_size=3),
        delay_s=st.floats(-1.0, 1.0) | st.just(0.0),
        on_topic=st.booleans(),
    )
    def send(self, way: list[GoalPoint], delay_s: float, on_topic: bool) -> None:
        way = sorted(way, key=lambda p: p.time_from_start_s)
        self.submit(TrajectoryGoal(ARM, tuple(way), delay_s=delay_s, from_topic=on_topic))

    @rule(position=st.floats(-2.0, 2.0), after_s=st.floats(0.0, 2.0))
    def send_a_part(self, position: float, after_s: float) -> None:
        self.submit(TrajectoryGoal(ARM[1:], (GoalPoint((position,), after_s),)))

    @rule(apart_s=st.floats(0.01, 0.1), way=st.floats(-1.0, 1.0), count=st.integers(60, 100))
    def send_many(self, apart_s: float, way: float, count: int) -> None:
        shares = [(1.0 - np.cos(np.pi * i / count)) / 2.0 for i in range(1, count + 1)]
        many = (GoalPoint((float(way * share), 0.0), apart_s * (i + 1)) for i, share in enumerate(shares))
        self.submit(TrajectoryGoal(ARM, tuple(many)))

    @rule(factor=st.floats(0.0, 1.5) | st.floats())
    def scale(self, factor: float) -> None:
        self.bench.arm.scaling.ask(factor)

    def submit(self, goal: TrajectoryGoal) -> None:
        if self.bench.arm.check(goal) is None:
            with patch("controller.trajectory.joint_trajectory_controller.GoalHandle", CountingHandle):
                handle = self.bench.arm.submit(goal)
            assert isinstance(handle, CountingHandle)
            self.handles.append(handle)

    @precondition(lambda self: self.handles)
    @rule(which=st.integers(0, 1000))
    def cancel(self, which: int) -> None:
        self.bench.arm.cancel(self.handles[which % len(self.handles)])

    @rule(value=st.floats(-0.1, 0.1) | st.floats())
    def tell_hand(self, value: float) -> None:
        self.bench.hand.submit([value])

    @rule(count=st.integers(1, 15))
    def cycles(self, count: int) -> None:
        self.bench.cycle(count)

    @rule(late_s=st.floats(0.0, 2.0))
    def late_cycle(self, late_s: float) -> None:
        self.bench.clock.sleep_until(self.bench.clock.now() + late_s)
        self.bench.loop.step()

    @rule(stuck=st.sets(st.sampled_from(JOINTS)), silent=st.sets(st.sampled_from(JOINTS)))
    def trouble(self, stuck: set[str], silent: set[str]) -> None:
        self.bench.hardware.stuck = stuck
        self.bench.hardware.faults = {name: JointFault("silent", f"{name} is silent") for name in sorted(silent)}

    @rule()
    def restart_controllers(self) -> None:
        active = self.bench.manager.registry.state("arm") is LifecycleState.ACTIVE
        self.bench.manager.deactivate()
        assert not active or all(handle.done for handle in self.handles)
        self.bench.manager.activate(self.bench.hardware.read(), self.bench.loop.command)

    @invariant()
    def commands_are_sane(self) -> None:
        written = self.bench.hardware.written
        for before, after in pairwise(written[max(0, self.checked - 1) :]):
            assert np.isfinite(after).all()
            assert ((after >= LOWER) & (after <= UPPER)).all()
            assert (np.abs(after - before) <= VELOCITY * PERIOD_S + 1e-12).all()
        self.checked = len(written)

    @invariant()
    def goals_are_decided_at_most_once(self) -> None:
        for handle in self.handles:
            assert handle.seen[0] is GoalStatus.EXECUTING
            assert len(handle.seen) <= 2

    def teardown(self) -> None:
        self.bench.hardware.faults = {}
        self.bench.arm.scaling.ask(1.0)
        self.bench.cycle(800)  # longer than any of these goals takes
        self.commands_are_sane()
        assert all(handle.done for handle in self.handles)


class SplineClient(Client):
    """Random goals and faults, as above, with ros2_control's splines."""

    method = "splines"


TestClient = Client.TestCase
TestSplineClient = pytest.mark.slow(SplineClient.TestCase)
TestClient.settings = TestSplineClient.settings = settings(
    max_examples=25,
    stateful_step_count=20,
    deadline=None,
    derandomize=True,
    suppress_health_check=list(HealthCheck),
)
