"""The search for paths: plans, repeatability, time and errors."""

import itertools
import subprocess
import sys
import time

import numpy as np
import pytest

from planning.collision import Collisions, Margins
from planning.paths.request import PathRequest
from planning.paths.search import find_path, planner_stem
from planning.planning_errors import PlanningError
from planning.scene import Box, Pose, Scene, SceneObject
from tests.planning.arms import ROOT, planar

START, GOAL = np.array([0.2, 0.0]), np.array([1.4, 0.0])
"""Positions on both sides of the post of the planar arm."""


def in_time(seconds: float):
    end = time.monotonic() + seconds
    return lambda: end - time.monotonic()


def touches(collisions: Collisions, path) -> bool:
    """Return whether one of many poses on a path is in contact."""
    parts = np.linspace(0.0, 1.0, 300)
    return any(
        collisions.clearance(one + (other - one) * part).distance_m <= 0.0
        for one, other in itertools.pairwise(path)
        for part in parts
    )


@pytest.mark.parametrize(
    "planner", ["", "RRTConnectkConfigDefault", "BKPIECEkConfigDefault", "KPIECE", "LBKPIECE", "PRM"]
)
def test_the_arm_passes_around_the_post_the_same_way_twice(planner):
    arm = planar()
    collisions = Collisions(arm, Scene())
    request = PathRequest(START, (GOAL,), planner, seed=7)
    path = find_path(arm, collisions, request, in_time(5.0))
    assert path[0].tolist() == START.tolist()
    assert path[-1].tolist() == GOAL.tolist()
    assert not touches(collisions, path)
    find_path(arm, collisions, PathRequest(GOAL, (START,), seed=3), in_time(5.0))  # must not change the next search
    again = find_path(planar(), Collisions(planar(), Scene()), request, in_time(5.0))
    assert again.tolist() == path.tolist()


def test_a_planner_that_improves_its_path_ends_in_time():
    arm = planar()
    collisions = Collisions(arm, Scene())
    begun = time.monotonic()
    path = find_path(arm, collisions, PathRequest(START, (GOAL,), "RRTstar"), in_time(0.3))
    assert time.monotonic() - begun < 0.4
    assert not touches(collisions, path)


def test_one_of_several_goals_is_reached():
    arm = planar()
    behind = np.array([0.2, 1.0])
    path = find_path(arm, Collisions(arm, Scene()), PathRequest(START, (GOAL, behind)), in_time(5.0))
    assert path.tolist() == [START.tolist(), behind.tolist()]


def enclosed() -> Scene:
    """Two walls that enclose the arm."""
    walls = [
        SceneObject(f"wall{i}", ((Box(2.0, 0.02, 1.0), Pose()),), Pose(np.array([0.0, y, 0.0])))
        for i, y in enumerate((-0.4, 0.4))
    ]
    return Scene().without("post").with_object(walls[0]).with_object(walls[1])


@pytest.mark.parametrize("planner", ["", "PRM"])
def test_an_impossible_search_ends_in_time(planner):
    arm = planar()
    for allowed_s in (0.1, 0.3):
        begun = time.monotonic()
        with pytest.raises(PlanningError, match="no path within the planning time") as caught:
            request = PathRequest(np.array([0.0, 0.0]), (np.array([3.0, 0.0]),), planner)
            find_path(arm, Collisions(arm, enclosed()), request, in_time(allowed_s))
        assert caught.value.code == "TIMED_OUT"
        assert time.monotonic() - begun < allowed_s + 0.1


@pytest.mark.parametrize(
    ("start", "goals", "code", "words"),
    [
        ((0.785, 0.0), [(0.0, 0.0)], "START_STATE_IN_COLLISION", "in the start, lower touches post"),
        ((0.0, 0.0), [(0.785, 0.0)], "GOAL_IN_COLLISION", "in the goal, lower touches post"),
        ((0.0, 0.0), [], "INVALID_GOAL_CONSTRAINTS", "no goal"),
        ((0.0, 0.0), [(0.0, 4.0)], "INVALID_GOAL_CONSTRAINTS", "two is at 4.0000, outside its limits -3.0000 to 3"),
        ((0.0, 0.0), [(float("nan"), 0.0)], "INVALID_GOAL_CONSTRAINTS", "one is at nan"),
        ((5.0, 0.0), [(0.0, 0.0)], "START_STATE_INVALID", "start: one is at 5.0000, outside its limits"),
    ],
)
def test_an_impossible_request_is_refused_by_name(start, goals, code, words):
    arm = planar()
    request = PathRequest(np.array(start), tuple(np.array(goal) for goal in goals))
    with pytest.raises(PlanningError, match=words) as caught:
        find_path(arm, Collisions(arm, Scene()), request, in_time(1.0))
    assert caught.value.code == code


def test_goals_in_contact_are_left_out():
    arm = planar()
    goals = (np.array([0.785, 0.0]), np.array([0.0, 0.5]))
    path = find_path(arm, Collisions(arm, Scene()), PathRequest(np.array([0.0, 0.0]), goals), in_time(1.0))
    assert path[-1].tolist() == [0.0, 0.5]


def test_a_continuous_joint_takes_the_shorter_way():
    arm = planar(end=float("inf"))
    request = PathRequest(np.array([3.0, 0.0]), (np.array([-3.0, 0.0]),))
    path = find_path(arm, Collisions(arm, Scene().without("post")), request, in_time(1.0))
    assert path[-1] == pytest.approx([2 * np.pi - 3.0, 0.0])


def test_a_start_near_an_obstacle_reduces_the_padding():
    arm = planar()
    wall = SceneObject("wall", ((Box(0.2, 0.2, 0.2), Pose()),), Pose(np.array([0.8, -0.1205, 0.15])))
    collisions = Collisions(arm, Scene().without("post").with_object(wall))
    clearance_m = collisions.clearance(np.zeros(2)).distance_m
    assert 0.0 < clearance_m < 0.002
    path = find_path(arm, collisions, PathRequest(np.zeros(2), (np.array([1.0, 0.0]),), "", Margins()), in_time(1.0))
    assert not touches(collisions, path)


@pytest.mark.parametrize(
    ("planner_id", "stem"),
    [
        ("", "rrtconnect"),
        ("RRTConnect", "rrtconnect"),
        ("geometric::RRTstar", "rrtstar"),
        ("arm[PRMkConfigDefault]", "prm"),
        ("KPIECEkConfigDefault", "kpiece"),
        ("ESTkConfigDefault", None),
    ],
)
def test_planner_ids_of_moveit(planner_id, stem):
    assert planner_stem(planner_id) == stem


PROGRAM = """
import gc
import numpy as np
from planning.collision import Collisions
from planning.paths.request import PathRequest
from planning.scene import Scene
from planning.paths.search import find_path
from tests.planning.arms import planar
arm = planar()
found = find_path(arm, Collisions(arm, Scene()), PathRequest(np.array([0.2, 0]), (np.array([1.4, 0]),)), lambda: 1.0)
print(len(found) > 2)
gc.freeze()
"""


def test_a_program_prints_nothing_at_exit():
    run = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, cwd=ROOT, timeout=60)
    assert (run.stdout, run.stderr) == ("True\n", "")
