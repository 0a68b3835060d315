"""Test the lead of the commands over the reference."""

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
from hal.types import JointState
from servoloop.stack.hardware import compliances
from servoloop.stack.robot_files import read_files
from tests.controller.bench import ARM_LIMITS, PERIOD_S, Bench, arm_parameters, to

FILES = read_files()
JOINTS = tuple(f"joint{i}" for i in range(1, 7))
ZEROS = np.zeros(len(FILES.component.joints))
lags = st.tuples(st.floats(0.0, 0.1), st.one_of(st.just(np.inf), st.floats(10.0, 100.0)), st.floats(0.0, 0.01))


@given(lags, lags, st.floats(0.0, 2.5), st.sampled_from([1.0, 0.5]), st.floats(0.0, 0.1))
def test_each_command_leads_by_the_lag_of_its_servo(
    one: tuple[float, ...], other: tuple[float, ...], at_s: float, rate: float, lead_s: float
) -> None:
    """The lead is the sum of three parts: lag time times velocity, the braking distance, and an inertia factor times
    acceleration. The leading command stays within the limits."""
    limits, of_joints = [ARM_LIMITS] * 2, np.array([one, other]).T
    start, end = (Kinematics.at_rest(np.array(position)) for position in ((0.0, 1.9), (1.95, -1.9)))
    sampler = TrajectorySampler(limits, rate, of_joints)
    sampler.follow(motion_to(start, end, limits, 2.0), start)
    sampler.elapsed_s = at_s
    to = sampler.reference(PERIOD_S)
    lag_s, braking, inertia_s2 = of_joints
    speed = np.abs(to.velocity)
    brakes = [
        0.0 if a == np.inf else max(v - a * PERIOD_S / 4.0, 0.0) ** 2 / (2.0 * a)
        for v, a in zip(speed, braking, strict=True)
    ]
    behind = lag_s * to.velocity + np.copysign(brakes, to.velocity) + inertia_s2 * to.acceleration
    assert sampler.ahead(PERIOD_S) == pytest.approx(np.clip(to.position + behind, -2.0, 2.0))
    assert sampler.ahead(PERIOD_S, lead_s) == pytest.approx(sampler.reference(PERIOD_S + lead_s).position)
    sampler.elapsed_s = 60.0
    assert sampler.ahead(PERIOD_S) == pytest.approx(end.position)


def arm_with(command_lead: float | None) -> JointTrajectoryController:
    """Return an active controller at position zero."""
    known = compliances(FILES.robot.joints)
    context = ControllerContext(FILES.description, FILES.component, FILES.limits, lambda name: True, known)
    parameters = TrajectoryParameters(joints=JOINTS, interpolation_method="ruckig", command_lead=command_lead)
    arm = JointTrajectoryController.build("arm", parameters, context)
    arm.activate(JointState(0.0, ZEROS, ZEROS, ZEROS), np.zeros(6))
    return arm


def command_after_a_while(arm: JointTrajectoryController, set_on_the_way: float | None = None) -> float:
    """Return the command of joint1 0.4 s after the start of its upward motion."""
    goal = TrajectoryGoal(JOINTS, (GoalPoint((1.0, *[0.0] * 5), 1.0),))
    assert arm.check(goal) is None
    arm.submit(goal)
    for cycle in range(1, 10):
        arm.update(JointState(cycle * PERIOD_S, ZEROS, ZEROS, ZEROS), cycle * PERIOD_S, PERIOD_S)
        if cycle == 5 and set_on_the_way is not None:
            arm.reconfigure(arm.parameters.model_copy(update={"command_lead": set_on_the_way}))
    return float(arm.command[0])


def test_the_command_lead_parameter_overrides_the_known_lag() -> None:
    none, some, known = (command_after_a_while(arm_with(lead)) for lead in (0.0, 0.02, None))
    assert none < some < known
    assert command_after_a_while(arm_with(PERIOD_S)) == pytest.approx(none + 0.05 * 1.5, abs=0.04)


def test_a_new_command_lead_applies_from_the_next_goal_on() -> None:
    assert command_after_a_while(arm_with(0.0), set_on_the_way=0.05) == command_after_a_while(arm_with(0.0))
    arm = arm_with(0.0)
    arm.reconfigure(arm.parameters.model_copy(update={"command_lead": 0.05}))
    arm.update(JointState(0.0, ZEROS, ZEROS, ZEROS), 0.0, PERIOD_S)
    assert command_after_a_while(arm) == command_after_a_while(arm_with(0.05))


def test_a_new_command_lead_applies_at_once_while_the_arm_is_at_rest() -> None:
    bench = Bench(arm_parameters(command_lead=0.0)).up()
    for lead_s in (0.0, 0.1):
        bench.arm.reconfigure(arm_parameters(command_lead=lead_s))
        stood = bench.loop.command.copy()
        bench.cycle(2)
        assert (bench.loop.command == stood).all(), "nothing moves by it"
        handle = bench.send(to(1.0 - stood[0], 0.0))
        bench.cycle(10)
        assert bench.arm.tracking is not None
        ahead = abs(bench.arm.command[0] - bench.arm.tracking.reference.position[0])
        assert ahead == pytest.approx(abs(bench.velocity[0]) * (PERIOD_S + lead_s), rel=0.1)
        bench.cycles_until(lambda handle=handle: handle.done)  # type: ignore[misc]


def test_a_joint_without_a_known_lag_has_no_lead() -> None:
    context = ControllerContext(FILES.description, FILES.component, FILES.limits, lambda name: True)
    lag_s, braking, inertia_s2 = context.lags(JOINTS)
    assert not lag_s.any() and not inertia_s2.any() and np.isinf(braking).all()
