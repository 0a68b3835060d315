"""Which pairs of links and objects are checked, and the check of edges."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planning.arm_model import ArmModel
from planning.clearance import kernel
from planning.collision import PADDING_M, Collisions, Margins, warm_up
from planning.planning_errors import PlanningError
from planning.scene import Box, Pose, Scene, SceneObject, Sphere
from planning.srdf_file import parse_pairs
from tests.planning.arms import limits, planar, robot_arm, so101

REACH = np.array([math.pi / 4, 0.0])
"""Positions at which the planar arm points to its post, which is about 1 m away."""


def box(name: str, side_m: float, *position: float) -> SceneObject:
    return SceneObject(name, ((Box(side_m, side_m, side_m), Pose()),), Pose(np.array(position)))


def test_objects_of_the_scene_file_are_obstacles_until_they_are_removed():
    arm = planar()
    assert Collisions(arm, Scene()).clearance(REACH).distance_m <= 0.0
    assert Collisions(arm, Scene()).clearance(REACH).pair == ("lower", "post")
    assert Collisions(arm, Scene().without("post")).clearance(REACH).distance_m > 0.1


def test_an_attached_object_moves_with_its_link_and_may_touch_its_touch_links():
    arm, held = planar(), box("held", 0.1, 0.6, 0.0, 0.0)
    scene = Scene().without("post").with_object(box("wall", 0.2, 0.0, 1.22, 0.15)).attach(held, "lower")
    up = np.array([math.pi / 2, 0.0])
    assert Collisions(arm, scene).clearance(up).pair == ("held", "wall")
    fixed = scene.detach("held", Pose(np.array([0.6, 0.0, 0.15])))
    assert Collisions(arm, fixed).clearance(np.zeros(2)).pair == ("lower", "held")


def test_an_attached_object_may_touch_its_link_and_its_touch_links():
    arm, held = planar("one", "two", "right"), box("held", 0.05, 0.55, 0.0, 0.0)
    scene = Scene().without("post").allow("left", "right")
    assert not Collisions(arm, scene.attach(held, "lower", ["left"])).is_clear(np.zeros(3))
    assert Collisions(arm, scene.attach(held, "lower", ["left", "right"])).is_clear(np.zeros(3))


def test_an_attached_object_of_an_unknown_link_is_refused():
    with pytest.raises(PlanningError, match='no link "palm"'):
        Collisions(planar(), Scene().attach(box("held", 0.1, 0.0, 0.0, 0.0), "palm"))


def test_an_object_with_the_name_of_a_link_is_refused():
    with pytest.raises(PlanningError, match='object "lower" has the name of a link: rename the object'):
        Collisions(planar(), Scene().with_object(box("lower", 0.1, 0.5, 0.0, 0.15)))


def test_allowed_pairs_may_touch():
    srdf = '<robot name="r"><disable_collisions link1="upper" link2="base" reason="Adjacent"/></robot>'
    assert parse_pairs(srdf) == {("base", "upper"): "Adjacent"}
    scene = Scene().allow("post", "lower").allow("post", "left").allow("right", "post")
    assert Collisions(planar(), scene).is_clear(REACH)
    assert not Collisions(planar(), scene.forbid("lower", "post")).is_clear(REACH)


@pytest.mark.parametrize(
    ("srdf", "words"),
    [("<robot>", "not well-formed XML"), ('<robot><disable_collisions link1="a"/></robot>', "needs link1 and link2")],
)
def test_a_broken_srdf_is_refused(srdf, words):
    with pytest.raises(PlanningError, match=words):
        parse_pairs(srdf)


def test_an_edge_that_passes_an_obstacle_is_refused_at_the_obstacle():
    contact = Collisions(planar(), Scene()).edge_contact(np.zeros(2), np.array([math.pi / 2, 0.0]))
    assert contact.pair == ("lower", "post")
    assert contact.part == pytest.approx(0.5, abs=0.1)


def test_an_edge_that_meets_a_thin_obstacle_is_refused():
    wire = SceneObject("wire", ((Sphere(1e-4), Pose()),), Pose(np.array([0.0, 0.9, 0.15])))
    scene = Scene().without("post").with_object(wire)
    contact = Collisions(planar(), scene).edge_contact(np.array([1.0, 0.0]), np.array([2.3, 0.0]))
    assert contact.pair == ("lower", "wire")


ARMS = {
    "planar": planar(),
    "slide": planar("one", "two", "right", end=0.9),
    "robot_arm": robot_arm(),
    "so101": so101(),
}


@given(arm=st.sampled_from(sorted(ARMS)), seed=st.integers(0, 10**6), length=st.sampled_from([0.05, 0.3, 1.0]))
@settings(max_examples=60, deadline=None)
def test_every_point_of_an_accepted_edge_has_the_clearance(arm, seed, length):
    model, random = ARMS[arm], np.random.default_rng(seed)
    boxes = [box(f"box{i}", 0.06, *random.uniform((-0.4, -0.4, 0.0), 0.4)) for i in range(4)]
    scene = Scene().with_object(boxes[0]).with_object(boxes[1]).with_object(boxes[2])
    if arm == "robot_arm":
        scene = scene.attach(
            box("held", 0.03, 0.0, 0.0, 0.15), "gripper_base_link", ("hand_left_link", "hand_right_link")
        )
    collisions, margins = Collisions(model, scene), Margins(0.004, 0.002)
    start, end = random.uniform(model.lower, model.upper, (2, len(model.joints)))
    end = start + (end - start) * length
    before = collisions.poses_checked
    contact = collisions.edge_contact(start, end, margins)
    checked = collisions.poses_checked - before
    parts = np.linspace(0.0, 1.0, 200 if contact else min(10 * checked + 200, 1000))
    distances = [collisions.clearance(start + (end - start) * part).distance_m for part in parts]
    if contact is None:
        assert min(distances) >= 0.002 - 1e-6
    else:
        assert collisions.clearance(start + (end - start) * contact.part).distance_m < 0.004 + 1e-5


def test_the_pose_of_a_check_leaves_other_joints_where_they_are():
    arm = planar()
    arm.set_others({"right": 0.05})
    opened = Collisions(arm, Scene().without("post").with_object(box("wall", 0.2, 1.05, 0.2, 0.15)))
    arm.set_others({"right": 0.0})
    closed = Collisions(arm, Scene().without("post").with_object(box("wall", 0.2, 1.05, 0.2, 0.15)))
    assert opened.clearance(np.zeros(2)).distance_m < closed.clearance(np.zeros(2)).distance_m - 0.02


def test_margins_shrink_for_a_pose_that_is_nearer_than_the_padding():
    margins = Margins(0.004, 0.002).within(0.001)
    assert (margins.padding_m, margins.tolerance_m) == (0.001, 0.0005)
    assert Margins(0.004, 0.002).within(math.inf) == Margins(0.004, 0.002)


def test_adjacent_links_are_not_checked_and_others_are():
    arm = planar("one", "two", "right")
    names = {frozenset(pair) for pair in itertools.combinations(arm.links, 2)}
    apart = Collisions(arm, Scene().without("post").without("floor"))
    pairs = {frozenset(apart._named(pair)) for pair in range(len(apart._pairs.one))}
    assert pairs == names - {frozenset(pair) for pair in arm.adjacent()}


def test_after_the_warm_up_nothing_is_compiled():
    warm_up()
    kernels = (kernel.edge_contact, kernel.pose_clearance)
    before = [list(kernel.signatures) for kernel in kernels]
    collisions = Collisions(robot_arm(), Scene().with_object(box("box", 0.1, 0.3, 0.3, 0.3)))
    collisions.clearance(np.zeros(6))
    collisions.edge_contact(np.zeros(6), np.ones(6))
    assert [list(kernel.signatures) for kernel in kernels] == before
    assert all(before)


def test_an_edge_that_needs_too_many_poses_is_refused():
    """A capsule turns about its own axis beside a wall. The speed bound of the capsule does not take into account that
    no surface moves."""
    scene = """<mujoco><worldbody><geom name="wall" type="box" size="0.1 1 1" pos="0.201 0 0"/>
    <body name="hand"><joint name="turn" axis="0 0 1"/><geom type="capsule" size="0.1 0.3"/></body>
    </worldbody></mujoco>"""
    collisions = Collisions(ArmModel.from_string(scene, {"turn": limits(-3.0, 3.0)}), Scene())
    start, end = np.array([-1.0]), np.array([1.0])
    assert collisions.edge_contact(start, end, Margins(0.0009, 0.0005)) is None
    contact = collisions.edge_contact(start, end, Margins(0.0009999, 1e-7))
    assert contact is not None
    assert contact.pair == ("hand", "wall")


@pytest.mark.parametrize("length_rad", [1e30, 1e100, 1e300])
def test_an_edge_of_an_impossible_length_is_refused(length_rad):
    """A client may send such an edge in a trajectory. Each part of the edge is halved until it is free."""
    scene = Scene().without("post").with_object(box("lamp", 0.2, 0.0, 0.0, 3.0))
    assert Collisions(planar(), scene).edge_contact(np.zeros(2), np.array([length_rad, 0.0])) is not None


def test_a_wide_padding_applies_to_objects_and_not_between_links():
    """The planar arm is folded, with its tip near its own base."""
    folded = np.array([0.0, math.pi - 0.45])
    collisions = Collisions(planar(end=3.1), Scene().without("floor").without("post"))
    gap_m = collisions.clearance(folded).distance_m
    assert PADDING_M < gap_m < 0.2
    assert collisions.is_clear(folded, padding_m=0.25)
    wall = SceneObject("wall", ((Sphere(0.05), Pose()),), Pose(np.array([0.0, 0.25, 0.2])))
    near = Collisions(planar(end=3.1), Scene().without("floor").without("post").with_object(wall))
    distance_m = near.clearance(np.zeros(2)).distance_m
    assert near.is_clear(np.zeros(2), distance_m - 1e-6) and not near.is_clear(np.zeros(2), distance_m + 1e-6)
    assert near.edge_contact(np.zeros(2), np.array([0.01, 0.0]), Margins(distance_m + 1e-3, 1e-3)) is not None
