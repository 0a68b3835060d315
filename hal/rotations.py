"""Rotations as matrices, quaternions (x, y, z, w) and rotation vectors, either single or in batches."""

from typing import Final

import numpy as np

from hal.types import FloatArray

SMALL_RAD: Final = 1e-4
"""Angle below which power series replace quotients of small numbers, in rad. The error of the series is below 1e-8."""
NEARLY_HALF_TURN: Final = -0.9
"""Cosine of the angle above which the sine is too inaccurate for finding the axis of a rotation."""


def matrices(quaternions: FloatArray) -> FloatArray:
    """Return the rotation matrices (..., 3, 3) for unit quaternions (..., 4)."""
    x, y, z, w = np.moveaxis(quaternions, -1, 0)
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def quaternions(rotations: FloatArray) -> FloatArray:
    """Return the unit quaternions (..., 4) for rotation matrices (..., 3, 3), with w at least 0."""
    r = np.asarray(rotations)
    xx, yy, zz = r[..., 0, 0], r[..., 1, 1], r[..., 2, 2]
    x_y, x_z, y_z = r[..., 0, 1] + r[..., 1, 0], r[..., 0, 2] + r[..., 2, 0], r[..., 1, 2] + r[..., 2, 1]
    x_w, y_w, z_w = r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]
    rows = [  # each row is 4 q_i q for one component q_i; the row of the largest component is the most accurate
        [1.0 + xx - yy - zz, x_y, x_z, x_w],
        [x_y, 1.0 - xx + yy - zz, y_z, y_w],
        [x_z, y_z, 1.0 - xx - yy + zz, z_w],
        [x_w, y_w, z_w, 1.0 + xx + yy + zz],
    ]
    products = np.moveaxis(np.array(rows), (0, 1), (-2, -1))
    largest = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)
    found = np.take_along_axis(products, largest[..., None, None], axis=-2)[..., 0, :]
    found = found / np.linalg.norm(found, axis=-1, keepdims=True)
    return np.asarray(np.where(found[..., 3:] < 0.0, -found, found))


def rotation_vectors(rotations: FloatArray) -> FloatArray:
    """Return the rotation vectors (k, 3) for rotation matrices (k, 3, 3): axis times angle, in rad, up to pi."""
    double = rotations - rotations.swapaxes(1, 2)
    sines = 0.5 * double.reshape(-1, 9)[:, (7, 2, 3)]
    sine = np.sqrt((sines * sines).sum(axis=1))
    cosine = 0.5 * (rotations.trace(axis1=1, axis2=2) - 1.0)
    small = sine < SMALL_RAD
    found = sines * np.where(small, 1.0, np.arctan2(sine, cosine) / np.where(small, 1.0, sine))[:, None]
    if (half_turns := cosine < NEARLY_HALF_TURN).any():
        q = quaternions(rotations[half_turns])
        half_rad = np.arccos(np.clip(q[:, 3:], -1.0, 1.0))
        found[half_turns] = q[:, :3] * (2.0 * half_rad / np.sin(half_rad))
    return found


def vector_rates(vectors: FloatArray) -> FloatArray:
    """Return the matrices (k, 3, 3) that convert an angular velocity to the rate of a rotation vector (k, 3).

    The angular velocity is given in the rotating frame.
    """
    angle_rad = np.sqrt((vectors * vectors).sum(axis=1))
    small = angle_rad < SMALL_RAD
    safe = np.where(small, 1.0, angle_rad)
    factor = np.where(small, 1.0 / 12.0, (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / (safe * safe))
    cross = skew(vectors)
    found = 0.5 * cross + factor[:, None, None] * (cross @ cross)
    found[:, (0, 1, 2), (0, 1, 2)] += 1.0
    return found


def euler_angles(rotations: FloatArray) -> FloatArray:
    """Return the angles (k, 3) about x, the new y and the new z axis that compose the rotations (k, 3, 3), in rad."""
    r = rotations
    about_y = np.arcsin(np.clip(r[:, 0, 2], -1.0, 1.0))
    locked = np.abs(r[:, 0, 2]) > 1.0 - SMALL_RAD**2
    about_x = np.where(locked, np.arctan2(r[:, 1, 0], r[:, 1, 1]), np.arctan2(-r[:, 1, 2], r[:, 2, 2]))
    about_x = np.where(locked & (r[:, 0, 2] < 0.0), -about_x, about_x)
    about_z = np.where(locked, 0.0, np.arctan2(-r[:, 0, 1], r[:, 0, 0]))
    return np.stack([about_x, about_y, about_z], axis=1)


def euler_rates(angles: FloatArray) -> FloatArray:
    """Return the matrices (k, 3, 3) that convert an angular velocity to the rates of Euler angles (k, 3).

    The angular velocity is given in the rotating frame. The rates are limited near 90 degrees about y, where they would
    become infinite.
    """
    (_, sin_y, sin_z), (_, cos_y, cos_z) = np.sin(angles).T, np.cos(angles).T
    cos_y = np.maximum(cos_y, SMALL_RAD)
    found = np.zeros((len(angles), 3, 3))
    found[:, 0, 0], found[:, 0, 1] = cos_z / cos_y, -sin_z / cos_y
    found[:, 1, 0], found[:, 1, 1] = sin_z, cos_z
    found[:, 2, :2], found[:, 2, 2] = -sin_y[:, None] * found[:, 0, :2], 1.0
    return found


def skew(vectors: FloatArray) -> FloatArray:
    """Return the matrices (..., 3, 3) that represent cross products with vectors (..., 3)."""
    found = np.zeros((*vectors.shape, 3))
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    found[..., 0, 1], found[..., 0, 2], found[..., 1, 2] = -z, y, -x
    found[..., 1, 0], found[..., 2, 0], found[..., 2, 1] = z, -y, x
    return found


def slerp(start: FloatArray, end: FloatArray, share: float) -> FloatArray:
    """Return the quaternion (4,) at a fraction from 0 to 1 along the shortest rotation between two quaternions (4,)."""
    cosine = float(start @ end)
    target = -end if cosine < 0.0 else end
    angle_rad = np.arctan2(np.linalg.norm(target - start), np.linalg.norm(target + start)) * 2.0
    if angle_rad < SMALL_RAD:
        mixed = (1.0 - share) * start + share * target
    else:
        mixed = np.sin((1.0 - share) * angle_rad) * start + np.sin(share * angle_rad) * target
    return np.asarray(mixed / np.linalg.norm(mixed))


def angle_between(one: FloatArray, other: FloatArray) -> float:
    """Return the angle between two orientations given as unit quaternions (4,), in rad, from 0 to pi."""
    sign = -1.0 if one @ other < 0.0 else 1.0
    return float(4.0 * np.arctan2(np.linalg.norm(one - sign * other), np.linalg.norm(one + sign * other)))
