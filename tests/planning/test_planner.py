"""Plans of the planar arm and of the project's arms are short, collision-free and repeatable."""

import itertools

import numpy as np
import pytest

from planning.arm_model import ArmModel
from planning.collision import Collisions, Margins
from planning.paths.planner import plan_path
from planning.paths.request import PathRequest
from planning.paths.smoothing import path_length
from planning.paths.timing import TimedPath, timed
from planning.planning_errors import PlanningError
from planning.scene import Box, Pose, Scene, SceneObject, Sphere
from tests.planning.arms import planar, robot_arm, so101


def plan_motion(arm: ArmModel, collisions: Collisions, request: PathRequest, limit_s: float) -> TimedPath:
    plan = plan_path(arm, collisions, request, lambda: limit_s)
    return timed(plan.points, arm.limits, collisions, plan.margins)


def test_more_searches_never_give_a_longer_path_and_the_same_seed_gives_the_same_path():
    arm = planar()
    request = PathRequest(np.array([0.2, 0.0]), (np.array([1.4, 0.0]),), seed=4)
    one, several, again = (
        plan_path(arm, Collisions(arm, Scene()), request, lambda: 1.0, searches).points for searches in (1, 4, 4)
    )
    assert several.tolist() == again.tolist()
    assert path_length(several) <= path_length(one)


@pytest.mark.parametrize(("make", "others"), [(robot_arm, {}), (so101, {"gripper": 0.7})])
def test_the_arms_of_the_project_are_planned_among_the_objects_of_their_scene(make, others):
    arm, random = make(), np.random.default_rng(5)
    arm.set_others(others)
    collisions = Collisions(arm, Scene(allowed=arm.adjacent()))
    clear = []
    while len(clear) < 4:
        positions = random.uniform(arm.lower, arm.upper)
        if collisions.is_clear(positions):
            clear.append(positions)
    for start, goal in itertools.pairwise(clear):
        path = plan_motion(arm, collisions, PathRequest(start, (goal,)), 5.0).positions
        poses = [one + (other - one) * part for one, other in itertools.pairwise(path) for part in (0.0, 0.5, 1.0)]
        assert min(collisions.clearance(pose).distance_m for pose in poses) >= 0.5e-3 - 2e-6


def test_no_time_is_an_error_of_its_own():
    arm = planar()
    request = PathRequest(np.array([0.2, 0.0]), (np.array([1.4, 0.0]),))
    with pytest.raises(PlanningError) as caught:
        plan_path(arm, Collisions(arm, Scene()), request, lambda: 0.0)
    assert caught.value.code == "TIMED_OUT"


def test_a_start_near_an_obstacle_is_timed_with_the_margins_of_its_plan():
    arm = planar()
    wall = SceneObject("wall", ((Box(0.2, 0.2, 0.2), Pose()),), Pose(np.array([0.8, -0.1205, 0.15])))
    collisions = Collisions(arm, Scene().without("post").with_object(wall))
    motion = plan_motion(arm, collisions, PathRequest(np.zeros(2), (np.array([1.0, 0.0]),)), 1.0)
    assert motion.positions[-1] == pytest.approx([1.0, 0.0])
    assert min(collisions.clearance(pose).distance_m for pose in motion.positions) > 0.0


def test_a_start_near_an_obstacle_reduces_the_margins_only_near_the_start():
    """The arm lies along a wall, at a distance of 0.5 mm. On its way around the post, the arm keeps almost the whole
    padding of 20 mm."""
    arm = planar()
    wall = SceneObject("wall", ((Box(0.2, 0.2, 0.2), Pose()),), Pose(np.array([0.8, -0.1205, 0.15])))
    collisions = Collisions(arm, Scene().with_object(wall))
    request = PathRequest(np.zeros(2), (np.array([1.6, 0.0]),), margins=Margins(0.02, 0.002))
    plan = plan_path(arm, collisions, request, lambda: 2.0)
    (near,) = plan.margins.near
    assert near.margins.padding_m < 0.001 and near.radius < 0.5
    motion = plan_motion(arm, collisions, request, 2.0)
    assert motion.positions[-1] == pytest.approx([1.6, 0.0])
    rest = [pose for pose in motion.positions if np.linalg.norm(pose) > near.radius]
    assert min(collisions.clearance(pose).distance_m for pose in rest) >= 0.02 - 1.5 * 0.002 - 1e-5
    assert min(collisions.clearance(pose).distance_m for pose in motion.positions) > 0.0


def narrow(gap_m: float) -> Scene:
    """Return a scene with a ball above the path of the upper link, at a distance."""
    ball = SceneObject("ball", ((Sphere(0.05), Pose()),), Pose(np.array([0.25, 0.0, 0.15 + 0.03 + 0.05 + gap_m])))
    return Scene(objects={"ball": ball})


def test_a_single_joint_passes_an_object_with_the_clearance_that_is_there():
    arm = planar("one")
    request = PathRequest(np.array([-0.6]), (np.array([0.6]),))
    collisions = Collisions(arm, narrow(1e-3))
    plan = plan_path(arm, collisions, request, lambda: 1.0)
    path = timed(plan.points, arm.limits, collisions, plan.margins)
    assert (path.positions[0].tolist(), path.positions[-1].tolist()) == ([-0.6], [0.6])
    assert min(collisions.clearance(one).distance_m for one in path.positions) > 0.4e-3


def test_a_single_joint_that_cannot_pass_an_object_names_it_at_once():
    arm = planar("one")
    request = PathRequest(np.array([-0.6]), (np.array([0.6]),))
    with pytest.raises(
        PlanningError, match="on the only path to the goal, upper comes too close to ball: move them apart"
    ) as caught:
        plan_path(arm, Collisions(arm, narrow(-1e-3)), request, lambda: 60.0)
    assert caught.value.code == "PLANNING_FAILED"
