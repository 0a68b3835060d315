"""Distances between shapes, compared with those of MuJoCo and with a brute-force search."""

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planning.arm_model import ArmModel
from planning.collision import Collisions
from planning.scene import Box, Cone, Cylinder, Mesh, Pose, Scene, SceneObject, Sphere
from tests.planning.arms import limits

KINDS = ("sphere", "capsule", "box", "cylinder", "ellipsoid", "plane")


def two_geoms(geoms: str, moving: str) -> ArmModel:
    """A fixed geom, and a geom that slides."""
    hand = f'<body name="hand"><joint name="slide" type="slide" axis="0 0 1"/>{moving}</body>'
    scene = f"<mujoco><worldbody>{geoms}{hand}</worldbody></mujoco>"
    return ArmModel.from_string(scene, {"slide": limits(-1.0, 1.0)})


def text(values) -> str:
    return " ".join(str(value) for value in values)


@given(kinds=st.tuples(st.sampled_from(KINDS), st.sampled_from(KINDS[:-1])), seed=st.integers(0, 10_000))
@settings(max_examples=60, deadline=None)
def test_distances_equal_those_of_mujoco(kinds, seed):
    random = np.random.default_rng(seed)
    fixed, moving = (
        f'<geom name="{kind}_{i}" type="{kind}" size="{text(random.uniform(0.03, 0.3, 3))}" '
        f'pos="{text(random.uniform(-0.5, 0.5, 3))}" quat="{text(random.normal(size=4))}"/>'
        for i, kind in enumerate(kinds)
    )
    arm = two_geoms(fixed, moving)
    expected = mujoco.mj_geomDistance(arm.model, arm.data, 0, 1, 10.0, None)
    clearance = Collisions(arm, Scene()).clearance(np.zeros(1))
    assert clearance.pair == ("hand", f"{kinds[0]}_0")
    if expected > 1e-6:
        assert clearance.distance_m == pytest.approx(expected, abs=1e-5)
    else:
        assert clearance.distance_m < 1e-5


BALL = '<geom type="sphere" size="0.1"/>'
CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 2.0) for z in (0.0, 0.5)])


@pytest.mark.parametrize(
    ("shape", "position", "distance_m"),
    [
        (Box(1.0, 0.4, 0.2), (1.0, 0.0, 0.0), 0.4),
        (Cylinder(0.4, 0.3), (0.0, 0.0, 0.5), 0.2),
        (Sphere(0.25), (0.0, 1.0, 0.0), 0.65),
        (Cone(0.6, 0.3), (0.0, 0.0, -0.8), 0.4),  # the tip is up, 0.3 above the origin
        (Cone(0.6, 0.3), (0.8, 0.0, 0.3), 0.4),  # the edge of the base is 0.3 below the origin
        (Mesh(CORNERS), (0.3, -0.5, -0.9), 0.4),
    ],
)
def test_objects_of_the_scene_are_as_far_as_their_shape(shape, position, distance_m):
    scene = Scene().with_object(SceneObject("thing", ((shape, Pose()),), Pose(np.array(position))))
    clearance = Collisions(two_geoms("", BALL), scene).clearance(np.zeros(1))
    assert clearance.pair == ("hand", "thing")
    assert clearance.distance_m == pytest.approx(distance_m, abs=1e-6)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=10, deadline=None)
def test_a_large_mesh_is_reduced_to_its_hull(seed):
    random = np.random.default_rng(seed)
    points = random.uniform((0.3, -0.3, -0.3), (0.9, 0.3, 0.3), (200, 3))
    scene = Scene().with_object(SceneObject("cloud", ((Mesh(points), Pose()),)))
    collisions = Collisions(two_geoms("", BALL), scene)
    at_m = float(random.uniform(-1.0, 1.0))
    distance_m = collisions.clearance(np.array([at_m])).distance_m
    # brute force: the best separating direction is at least as good as any sampled one
    directions = random.normal(size=(2000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    sampled = ((points - [0.0, 0.0, at_m]) @ directions.T).min(axis=0).max() - 0.1
    nearest = np.linalg.norm(points - [0.0, 0.0, at_m], axis=1).min() - 0.1
    assert max(sampled, -0.1) - 1e-6 <= distance_m <= nearest + 1e-6


def test_an_object_of_size_zero_is_refused_by_name():
    for shape, size in (
        (Box(1.0, 0.0, 1.0), "1 x 0 x 1 m"),
        (Sphere(-1.0), "-1 m"),
        (Cylinder(math.nan, 1.0), "nan x 1 m"),
        (Mesh(CORNERS * [1.0, 1.0, 0.0]), "x 0 m"),
    ):
        with pytest.raises(Exception, match=f'object "thing" has size .*{size}'):
            Scene().with_object(SceneObject("thing", ((shape, Pose()),)))


@pytest.mark.parametrize("quaternion", [(0, 0, 0, 0), (0, 0, 0, 2), (math.nan, 0, 0, 1)])
def test_a_quaternion_that_is_no_rotation_is_refused(quaternion):
    with pytest.raises(Exception, match=r"normalize it to length 1|must be finite"):
        Pose.from_quaternion((0, 0, 0), quaternion)
