"""The planner of a robot with two arms moves either arm around the other one, or both arms together."""

import numpy as np
import pytest

from planning.planning_errors import PlanningError
from servoloop import Arm, ArmInputError, MotionPlanner

READY = {"shoulder_pan": 0.0, "shoulder_lift": -0.603, "elbow_flex": 0.396, "wrist_flex": 1.498, "wrist_roll": 0.048}
INWARD = {"shoulder_pan": 1.57, "shoulder_lift": 0.9, "elbow_flex": -0.8, "wrist_flex": 0.0}


def of(name: str, pose: dict[str, float]) -> dict[str, float]:
    return {f"{name}_{joint}": position for joint, position in pose.items()}


START = {**of("left", READY), **of("right", READY)}


@pytest.fixture(scope="module")
def planner() -> MotionPlanner:
    return MotionPlanner("bimanual_so101")


@pytest.mark.parametrize("name", ["left", "right"])
def test_a_goal_of_one_arm_moves_this_arm_only(planner: MotionPlanner, name: str) -> None:
    planned = planner.plan(START, {f"{name}_shoulder_pan": 0.4})
    assert set(planned.positions) == set(of(name, READY))


def test_the_arms_never_come_into_each_others_way(planner: MotionPlanner) -> None:
    reach = {**of("left", INWARD), "left_shoulder_pan": 1.1}
    planned = planner.plan(START, {**reach, "right_shoulder_pan": 0.4})
    assert set(planned.positions) == set(START)
    states = [dict(zip(planned.positions, at, strict=True)) for at in np.array(list(planned.positions.values())).T]
    assert min(planner.clearance(state).distance_m for state in states) > 0.0
    both = {**of("left", INWARD), **of("right", {**INWARD, "shoulder_pan": -1.57})}
    with pytest.raises(PlanningError, match="left_lower_arm_link touches right_wrist_link: move them apart"):
        planner.plan(START, both)
    with pytest.raises(PlanningError, match="right_"):
        planner.plan({**START, **of("right", {**INWARD, "shoulder_pan": -1.57})}, of("left", INWARD))


def test_an_arm_moves_by_its_own_tool_and_the_hands_are_not_planned() -> None:
    with Arm.simulated("bimanual_so101", seed=1) as arm:
        arm.move_to(START, duration=2.0)
        before = arm.pose("right_gripper_link")
        arm.follow(arm.plan({"right_shoulder_pan": 0.3, "left_shoulder_pan": -0.3}))
        after = arm.pose("right_gripper_link")
        assert np.linalg.norm(np.subtract(after.position_m, before.position_m)) > 0.03
        assert arm.state.position["left_shoulder_pan"] == pytest.approx(-0.3, abs=0.03)
        with pytest.raises(ArmInputError, match="no planning group moves joint left_gripper"):
            arm.plan({"left_gripper": 0.3})
