"""The lead: how far ahead of the reference the servos are commanded."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.interface import ControllerContext
from controller.motion import Kinematics, motion_to
from controller.trajectory.goal import GoalPoint, TrajectoryGoal
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from controller.trajectory.parameters import TrajectoryParameters
from controller.trajectory.sampler import TrajectorySampler
from drivers.servos import sts
from hal.servo_compliance import NO_LAG
from hal.types import JointState
from servoloop.files import read_files
from servoloop.hardware import compliances
from sim_backend.motion_profile import MotionProfile
from tests.controller.bench import ARM_LIMITS, PERIOD_S

FILES = read_files()
JOINTS = tuple(f"joint{i}" for i in range(1, 7))
lags = st.tuples(st.floats(0.0, 0.1), st.one_of(st.just(math.inf), st.floats(5.0, 50.0)), st.floats(0.0, 0.01))


@given(lags, lags, st.floats(0.01, 2.5), st.sampled_from([1.0, 0.5]))
def test_each_joint_is_commanded_as_far_ahead_as_its_servo_lags(
    one: tuple[float, ...], other: tuple[float, ...], ahead_s: float, rate: float
) -> None:
    """By a time, by the way that braking takes, and by the rotor's inertia; never out of the limits."""
    limits, of_joints = [ARM_LIMITS] * 2, np.array([one, other]).T
    start, end = (Kinematics.at_rest(np.array(position)) for position in ((0.0, 1.9), (1.95, -1.9)))
    sampler = TrajectorySampler(limits, rate, of_joints)
    sampler.follow(motion_to(start, end, limits, 2.0), start)
    to = sampler.reference(ahead_s)
    (lag_s, braking, inertia_s2), speed = of_joints, np.abs(to.velocity)
    way = [max(v - 0.25 * a * ahead_s, 0.0) ** 2 / (2.0 * a) for v, a in zip(speed, braking, strict=True)]
    behind = lag_s * to.velocity + np.sign(to.velocity) * way + inertia_s2 * to.acceleration
    assert sampler.ahead(ahead_s) == pytest.approx(np.clip(to.position + behind, -2.0, 2.0))
    assert sampler.ahead(60.0) == pytest.approx(end.position)


@pytest.mark.parametrize("period_s", [0.01, 0.05])
@pytest.mark.parametrize("speed_counts_s", [300, 1000, 1304])
def test_a_servos_profile_is_as_far_behind_a_stream_of_goals_as_is_assumed(
    speed_counts_s: int, period_s: float
) -> None:
    profile = MotionProfile()
    profile.acceleration = float(sts.GOAL_ACCELERATION * sts.ACCELERATION_UNIT_COUNTS_S2)
    profile.speed = 1.05 * speed_counts_s + 20.0  # as ServoHardware tells it
    for cycle in range(200):
        profile.goal = float(round(speed_counts_s * period_s * (cycle + 1)))
        for _ in range(round(period_s * 1000)):
            profile.step(0.001)
    slowest = speed_counts_s - 0.25 * profile.acceleration * period_s
    assert profile.goal - profile.position == pytest.approx(slowest**2 / (2.0 * profile.acceleration), abs=1.0)


def command_after_a_while(command_lead: float | None) -> float:
    """Where joint1 is sent 0.4 s after the beginning of its way up."""
    known = compliances(FILES.robot.joints)
    context = ControllerContext(FILES.description, FILES.component, FILES.limits, lambda name: True, known)
    parameters = TrajectoryParameters(joints=JOINTS, interpolation_method="ruckig", command_lead=command_lead)
    arm = JointTrajectoryController.build("arm", parameters, context)
    zeros = np.zeros(len(context.component.joints))
    arm.activate(JointState(0.0, zeros, zeros, zeros), np.zeros(6))
    goal = TrajectoryGoal(JOINTS, (GoalPoint((1.0, *[0.0] * 5), 1.0),))
    assert arm.check(goal) is None
    arm.submit(goal)
    for cycle in range(1, 10):
        arm.update(JointState(cycle * PERIOD_S, zeros, zeros, zeros), cycle * PERIOD_S, PERIOD_S)
    return float(arm.command[0])


def test_a_lead_that_the_parameters_name_counts_instead_of_what_is_known_of_the_servos() -> None:
    assert command_after_a_while(0.0) < command_after_a_while(0.02) < command_after_a_while(None)
    assert command_after_a_while(PERIOD_S) == pytest.approx(command_after_a_while(0.0) + 0.05 * 1.5, abs=0.04)


def test_a_joint_of_whose_servo_nothing_is_known_follows_at_once() -> None:
    context = ControllerContext(FILES.description, FILES.component, FILES.limits, lambda name: True)
    assert [set(row) for row in context.lags(JOINTS)] == [{number} for number in NO_LAG]
