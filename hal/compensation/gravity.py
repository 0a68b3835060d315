"""Compute the joint torques due to gravity from the link masses of a URDF."""

import logging
import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from hal.compensation.mass_tree import Matrix, MovingJoint, inclination_unknown, mass_tree
from hal.robot_description.description import Description, Vector
from hal.types import FloatArray

LOG = logging.getLogger("servoloop.hal")

GRAVITY_M_S2: Final = 9.81


class Gravity:
    """Gravity model of an arm. Gravity acts along -z of the root link.

    A moving joint that is not in ``joints`` and does not follow one of them is assumed to be at position zero. The
    torques of all joints beyond such a joint are assumed to be zero, because the inclination of those joints is
    unknown.
    """

    def __init__(self, description: Description, joints: Sequence[str]) -> None:
        """Create the model. ``joints`` specifies the order of positions and torques."""
        self._tree = mass_tree(description, joints)
        self._joints = len(joints)
        self._unknown = inclination_unknown(self._tree)
        if not any(joint.carried_kg for joint in self._tree):
            LOG.warning("the links of the URDF have no masses, so gravity is not compensated")

    def torques(self, position: FloatArray) -> FloatArray:
        """Compute the torques that hold the arm at a position.

        Args:
            position: Joint positions of shape (n,), in rad or m.

        Returns:
            Torques or forces of shape (n,), in N m or N.
        """
        return np.array(self.torques_at(position.tolist()))

    def torques_at(self, places: Sequence[float]) -> list[float]:
        """Compute the same torques as ``torques``, but with plain floats, which are faster than arrays of three
        elements."""
        torques = [0.0] * self._joints
        turned: list[Matrix] = []
        slid: list[float] = []
        up: list[Vector] = []
        for joint in self._tree:
            q = places[joint.leader] * joint.multiplier + joint.offset if joint.leader >= 0 else 0.0
            matrix = _orientation(joint, q) if joint.turns else joint.still
            turned.append(matrix)
            slid.append(0.0 if joint.turns else q)
            up.append(_in_link(matrix, up[joint.parent] if joint.parent >= 0 else (0.0, 0.0, GRAVITY_M_S2)))
        moments = [joint.moment for joint in self._tree]
        for index in range(len(self._tree) - 1, -1, -1):  # children before parents
            joint, moment = self._tree[index], moments[index]
            if joint.leader >= 0 and joint.leader not in self._unknown:
                torques[joint.leader] += joint.multiplier * _held(joint, moment, up[index])
            if joint.parent >= 0:
                moments[joint.parent] = _carried(joint, turned[index], slid[index], moment, moments[joint.parent])
        return torques


def _orientation(joint: MovingJoint, q: float) -> Matrix:
    """Return the orientation of the moved link in the frame of its parent."""
    s, c = math.sin(q), math.cos(q)
    a0, a1, a2, a3, a4, a5, a6, a7, a8 = joint.still
    b0, b1, b2, b3, b4, b5, b6, b7, b8 = joint.sine
    d0, d1, d2, d3, d4, d5, d6, d7, d8 = joint.cosine
    return (
        a0 + s * b0 + c * d0, a1 + s * b1 + c * d1, a2 + s * b2 + c * d2,
        a3 + s * b3 + c * d3, a4 + s * b4 + c * d4, a5 + s * b5 + c * d5,
        a6 + s * b6 + c * d6, a7 + s * b7 + c * d7, a8 + s * b8 + c * d8,
    )  # fmt: skip


def _in_link(matrix: Matrix, vector: Vector) -> Vector:
    """Transform a vector from the parent's frame to the link's frame."""
    x, y, z = vector
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = matrix
    return r0 * x + r3 * y + r6 * z, r1 * x + r4 * y + r7 * z, r2 * x + r5 * y + r8 * z


def _held(joint: MovingJoint, moment: Vector, up: Vector) -> float:
    """Return the torque or force that holds a joint. ``up`` is the negative gravity vector in the link's frame."""
    (x, y, z), (ux, uy, uz) = joint.axis, up
    if not joint.turns:
        return joint.carried_kg * (x * ux + y * uy + z * uz)
    mx, my, mz = moment
    return x * (my * uz - mz * uy) + y * (mz * ux - mx * uz) + z * (mx * uy - my * ux)


def _carried(joint: MovingJoint, matrix: Matrix, slid_m: float, moment: Vector, own: Vector) -> Vector:
    """Return the sum of the parent's first moment (``own``) and the first moment of a link that the parent carries."""
    (x, y, z), (px, py, pz), (dx, dy, dz) = moment, joint.place_m, joint.slide
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = matrix
    kg = joint.carried_kg
    return (
        own[0] + r0 * x + r1 * y + r2 * z + kg * (px + slid_m * dx),
        own[1] + r3 * x + r4 * y + r5 * z + kg * (py + slid_m * dy),
        own[2] + r6 * x + r7 * y + r8 * z + kg * (pz + slid_m * dz),
    )
