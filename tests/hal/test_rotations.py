"""Conversions of rotations agree with one another at every angle."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.rotations import (
    angle_between,
    euler_angles,
    euler_rates,
    matrices,
    quaternions,
    rotation_vectors,
    slerp,
    vector_rates,
)
from hal.types import FloatArray

ANGLES = st.one_of(st.floats(0.0, np.pi), st.sampled_from([0.0, 1e-9, 1e-4, 2.69, np.pi - 1e-9, np.pi]))
AXES = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array).filter(lambda axis: np.linalg.norm(axis) > 0.1)
UNIT = AXES.map(lambda axis: axis / np.linalg.norm(axis))


def quaternion(axis: FloatArray, angle_rad: float) -> FloatArray:
    return np.array([*(axis * np.sin(angle_rad / 2.0)), np.cos(angle_rad / 2.0)])


@settings(max_examples=40)
@given(UNIT, ANGLES)
def test_quaternions_matrices_and_vectors_are_the_same_rotation(axis: FloatArray, angle_rad: float) -> None:
    rotation = matrices(quaternion(axis, angle_rad))
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-12)
    assert angle_between(quaternions(rotation), quaternion(axis, angle_rad)) == pytest.approx(0.0, abs=1e-7)
    vector = rotation_vectors(rotation[None])[0]
    assert np.linalg.norm(vector) == pytest.approx(angle_rad, abs=1e-7)
    assert matrices(quaternion(axis, float(vector @ axis))) == pytest.approx(rotation, abs=1e-6)


@settings(max_examples=40)
@given(UNIT, st.floats(0.0, 3.1), UNIT)
def test_rates_are_the_derivative_of_the_rotation_vector(axis: FloatArray, angle_rad: float, about: FloatArray) -> None:
    rotation, step = matrices(quaternion(axis, angle_rad)), 1e-6
    turned = np.array([rotation @ matrices(quaternion(about, sign * step)) for sign in (1.0, -1.0)])
    after, before = rotation_vectors(turned)
    assert vector_rates((angle_rad * axis)[None])[0] @ about == pytest.approx((after - before) / (2 * step), abs=1e-5)


@settings(max_examples=40)
@given(UNIT, ANGLES, UNIT, ANGLES, st.floats(0.0, 1.0))
def test_slerp_divides_the_shortest_rotation(
    axis: FloatArray, angle_rad: float, other: FloatArray, turned_rad: float, share: float
) -> None:
    start, end = quaternion(axis, angle_rad), quaternion(other, turned_rad)
    between, whole_rad = slerp(start, end, share), angle_between(start, end)
    assert angle_between(start, between) == pytest.approx(share * whole_rad, abs=1e-6)
    assert angle_between(between, end) == pytest.approx((1.0 - share) * whole_rad, abs=1e-6)


def about(axis: int, angle_rad: float) -> FloatArray:
    return matrices(quaternion(np.eye(3)[axis], angle_rad))


@settings(max_examples=40)
@given(UNIT, ANGLES)
def test_euler_angles_make_up_the_rotation(axis: FloatArray, angle_rad: float) -> None:
    rotation = matrices(quaternion(axis, angle_rad))
    x_rad, y_rad, z_rad = euler_angles(rotation[None])[0]
    assert about(0, x_rad) @ about(1, y_rad) @ about(2, z_rad) == pytest.approx(rotation, abs=1e-7)


@pytest.mark.parametrize("angles", [(0.4, np.pi / 2.0, 0.3), (-0.4, -np.pi / 2.0, 2.0)])
def test_euler_angles_at_the_singularity(angles: tuple[float, float, float]) -> None:
    rotation = about(0, angles[0]) @ about(1, angles[1]) @ about(2, angles[2])
    x_rad, y_rad, z_rad = euler_angles(rotation[None])[0]
    assert about(0, x_rad) @ about(1, y_rad) @ about(2, z_rad) == pytest.approx(rotation, abs=1e-7)


@settings(max_examples=40)
@given(st.floats(-3.0, 3.0), st.floats(-1.4, 1.4), st.floats(-3.0, 3.0), UNIT)
def test_rates_are_the_derivative_of_the_euler_angles(x: float, y: float, z: float, axis: FloatArray) -> None:
    rotation, step = about(0, x) @ about(1, y) @ about(2, z), 1e-6
    after, before = euler_angles(np.array([rotation @ matrices(quaternion(axis, sign * step)) for sign in (1.0, -1.0)]))
    assert euler_rates(np.array([[x, y, z]]))[0] @ axis == pytest.approx((after - before) / (2 * step), abs=1e-5)
