"""Tests of link poses against rotation matrices in numpy."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.robot_description import kinematics
from hal.robot_description.description import UrdfJoint, Vector
from hal.robot_description.kinematics import Quaternion
from hal.types import FloatArray

angles = st.floats(-7.0, 7.0)
lengths = st.floats(-2.0, 2.0)
vectors = st.tuples(lengths, lengths, lengths)
axes = vectors.filter(lambda v: math.hypot(*v) > 1e-3)

JOINT = UrdfJoint(
    name="j",
    kind="revolute",
    parent="a",
    child="b",
    xyz_m=(0.0, 0.0, 0.0),
    rpy_rad=(0.0, 0.0, 0.0),
    axis=(1.0, 0.0, 0.0),
    lower=-1.0,
    upper=1.0,
    velocity=1.0,
    mimic=None,
)


def about(axis: Vector, angle: float) -> FloatArray:
    """Return the rotation matrix by Rodrigues' formula."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: FloatArray = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)
    return rotation


def fixed_axes(rpy: Vector) -> FloatArray:
    roll, pitch, yaw = rpy
    rotation: FloatArray = about((0, 0, 1), yaw) @ about((0, 1, 0), pitch) @ about((1, 0, 0), roll)
    return rotation


def matrix(q: Quaternion) -> FloatArray:
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def close(a: object, b: object) -> None:
    np.testing.assert_allclose(np.array(a), np.array(b), rtol=0.0, atol=1e-9)


@given(vectors)
def test_roll_pitch_yaw(rpy: Vector) -> None:
    close(matrix(kinematics.from_rpy(rpy)), fixed_axes(rpy))


@given(axes, angles)
def test_a_rotation_about_an_axis(axis: Vector, angle: float) -> None:
    q = kinematics.about_axis(axis, angle)
    close(matrix(q), about(axis, angle))
    assert math.hypot(*q) == pytest.approx(1.0)


@given(axes, angles, axes, angles, vectors)
def test_product_and_rotation(axis_a: Vector, a: float, axis_b: Vector, b: float, v: Vector) -> None:
    p, q = kinematics.about_axis(axis_a, a), kinematics.about_axis(axis_b, b)
    close(matrix(kinematics.multiply(p, q)), about(axis_a, a) @ about(axis_b, b))
    close(kinematics.rotate(p, v), about(axis_a, a) @ np.array(v))


@pytest.mark.parametrize("kind", ["revolute", "continuous"])
@given(xyz=vectors, rpy=vectors, axis=axes, angle=angles)
def test_a_revolute_joint_turns_its_child(kind: str, xyz: Vector, rpy: Vector, axis: Vector, angle: float) -> None:
    joint = replace(JOINT, kind=kind, xyz_m=xyz, rpy_rad=rpy, axis=axis)
    position, orientation = kinematics.child_pose(joint, angle)
    close(position, xyz)
    close(matrix(orientation), fixed_axes(rpy) @ about(axis, angle))


@given(xyz=vectors, rpy=vectors, axis=axes, way=lengths)
def test_a_prismatic_joint_shifts_its_child(xyz: Vector, rpy: Vector, axis: Vector, way: float) -> None:
    """The shift is in meters along the axis, regardless of the length of the axis vector."""
    joint = replace(JOINT, kind="prismatic", xyz_m=xyz, rpy_rad=rpy, axis=axis)
    position, orientation = kinematics.child_pose(joint, way)
    unit = np.array(axis) / np.linalg.norm(axis)
    close(position, np.array(xyz) + fixed_axes(rpy) @ unit * way)
    close(matrix(orientation), fixed_axes(rpy))


@given(xyz=vectors, rpy=vectors, position=angles)
def test_a_fixed_joint_stays(xyz: Vector, rpy: Vector, position: float) -> None:
    joint = replace(JOINT, kind="fixed", xyz_m=xyz, rpy_rad=rpy)
    place, orientation = kinematics.child_pose(joint, position)
    close(place, xyz)
    close(matrix(orientation), fixed_axes(rpy))
