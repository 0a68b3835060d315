"""If a box appears in the path of a running motion on virtual servos, the arm stops before the box or goes around
it."""

import random
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

pytest.importorskip("moveit_msgs")
pytest.importorskip("ompl")

from moveit_msgs.msg import MoveItErrorCodes
from sensor_msgs.msg import JointState

from planning.scene import Box, Pose, SceneObject
from tests.planning.robots import robot_arm
from tests.ros.plan_client import READY, PlanClient, box, joint_goal, remove
from tests.ros.planned_stack import planned_stack

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]

TRIALS = 20
ARRIVALS = 18
"""Number of trials in which the arm must arrive if it may plan again."""
SIDE_RAD = 1.1
"""Positions of joint1 at the start and at the end of the motions."""
SHARE = 0.3
"""Share of the limits of velocity and acceleration."""
SIDE_M = 0.05
"""Length of the edges of the box, in m. The box appears at least 0.7 rad ahead of the arm. The hand and the box take up
0.45 rad of this distance, and the arm needs the rest to brake."""
ROBOT = robot_arm()
INVALIDATED = MoveItErrorCodes.MOTION_PLAN_INVALIDATED_BY_ENVIRONMENT_CHANGE


@dataclass
class Bench:
    """A client that stores all states that the arm has reported since the last ``clear``."""

    client: PlanClient
    states: list[dict[str, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.client.node.create_subscription(JointState, "/joint_states", self._on_state, 10)

    def _on_state(self, message: JointState) -> None:
        self.states.append(dict(zip(message.name, message.position, strict=True)))

    def spin_until(self, condition: Any) -> None:
        end_s = time.monotonic() + 20.0
        while not condition():
            assert time.monotonic() < end_s, "the arm does not move as planned"
            self.client.executor.spin_once(timeout_sec=0.02)

    def move_to(self, side_rad: float) -> None:
        result = self.client.run(joint_goal(**{**READY, "joint1": side_rad}))
        assert result.error_code.val == MoveItErrorCodes.SUCCESS, result.error_code.message

    def is_at(self, side_rad: float) -> bool:
        self.states.clear()
        self.spin_until(lambda: self.states)
        return abs(self.states[-1]["joint1"] - side_rad) < 0.03


@pytest.fixture(scope="module")
def bench(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with planned_stack(tmp_path_factory.mktemp("planned")):
        client = PlanClient()
        try:
            yield Bench(client)
        finally:
            client.close()


def drop(bench: Bench, chance: random.Random, *, replan: bool) -> tuple[int, list[str]]:
    """Put a box into the path of a motion, and return the error code and all contacts of the arm."""
    bench.client.apply(remove("box"))
    bench.move_to(-SIDE_RAD)
    goal = joint_goal(**{**READY, "joint1": SIDE_RAD})
    goal.request.max_velocity_scaling_factor = goal.request.max_acceleration_scaling_factor = SHARE
    goal.planning_options.replan, goal.planning_options.replan_attempts = replan, 5
    appears_rad, place_rad = chance.uniform(-0.9, -0.5), chance.uniform(0.2, 0.5)
    pose = ROBOT.link_poses(["gripper_base_link"], {**ROBOT.rest, **READY, "joint1": place_rad})["gripper_base_link"]
    place_m = pose.position_m + np.array([0.0, 0.0, chance.uniform(-0.08, 0.08)])
    bench.states.clear()
    handle = bench.client.send(goal)
    bench.spin_until(lambda: bench.states and bench.states[-1]["joint1"] > appears_rad)
    sides_m = (SIDE_M, SIDE_M, SIDE_M)
    assert bench.client.apply(box("box", tuple(place_m.tolist()), sides_m))
    code = bench.client.result(handle).error_code.val
    bench.client.spin(0.5)
    item = SceneObject("box", ((Box(*sides_m), Pose()),), Pose(place_m))
    scene = ROBOT.scene.without("cube").with_object(item)
    return code, sorted({touched for state in bench.states for touched in touches(state, scene)})


def touches(state: dict[str, float], scene: Any) -> list[str]:
    positions = {joint: state[joint] for joint in ROBOT.limits}
    return [f"{touch.one} and {touch.other}" for touch in ROBOT.validity(positions, scene).touches]


def test_arm_stops_before_the_box(bench: Bench) -> None:
    chance = random.Random(1)
    for trial in range(TRIALS):
        code, touched = drop(bench, chance, replan=False)
        assert (code, touched) == (INVALIDATED, []), f"trial {trial}"
        assert not bench.is_at(SIDE_RAD), f"trial {trial}"


def test_arm_goes_around_the_box_if_it_may_plan_again(bench: Bench) -> None:
    chance, arrived = random.Random(2), 0
    for trial in range(TRIALS):
        code, touched = drop(bench, chance, replan=True)
        assert touched == [], f"trial {trial}"
        arrived += code == MoveItErrorCodes.SUCCESS and bench.is_at(SIDE_RAD)
    assert arrived >= ARRIVALS
