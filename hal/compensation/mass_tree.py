"""The moving joints of a URDF and the masses that they carry, prepared for fast evaluation."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from hal.robot_description.description import Description, UrdfJoint, Vector
from hal.robot_description.kinematics import from_rpy, rotate
from hal.types import FloatArray

TURNING: Final = ("revolute", "continuous")

Matrix = tuple[float, ...]
"""The nine matrix elements, in row-major order."""


@dataclass(frozen=True, slots=True)
class MovingJoint:
    """A moving joint and its child link, including all links that are attached to it by fixed joints.

    The orientation of the link in the frame of its parent is ``still + sin(q) * sine + cos(q) * cosine``. The origin of
    the link is ``place_m + q * slide``. The position of the joint is ``multiplier`` times the position of the joint
    with index ``leader``, plus ``offset``.
    """

    name: str
    parent: int
    """Index of the previous moving joint; -1 for the root link."""
    turns: bool
    """Whether the joint is rotary. Other joints are prismatic."""
    still: Matrix
    sine: Matrix
    cosine: Matrix
    place_m: Vector
    slide: Vector
    axis: Vector
    leader: int
    """Index of the commanded joint that this joint follows; -1 if it does not follow any and is assumed to be at
    zero."""
    multiplier: float
    offset: float
    moment: Vector
    """First moment of the link's own mass, in kg m."""
    carried_kg: float
    """Mass of the link and of all its descendants."""


class _Tree:
    """Builder for a list of moving joints in which each joint comes after its parent."""

    def __init__(self, description: Description, joints: Sequence[str]) -> None:
        self.found: list[MovingJoint] = []
        self._joints = tuple(joints)
        self._description = description
        self._links = description.links
        self._below: dict[str, list[UrdfJoint]] = {}
        for joint in description.joints.values():
            self._below.setdefault(joint.parent, []).append(joint)

    def grow(self, link: str, parent: int, to: FloatArray, at: FloatArray) -> tuple[float, FloatArray]:
        """Add all joints after a link.

        Args:
            link: Name of the link.
            parent: Index of the moving joint that carries the link.
            to: Rotation of the link in the parent frame, shape (3, 3).
            at: Position of the link in the parent frame, shape (3,), in m.

        Returns:
            The total mass of the link and all its descendants, and the first moment of the links that move with the
            parent.
        """
        own = self._links.get(link)
        kg, center = (own.mass_kg, np.array(own.center_m)) if own else (0.0, np.zeros(3))
        moment = kg * (at + to @ center)
        for joint in self._below.get(link, []):
            turned, place = to @ _rotation(joint), at + to @ np.array(joint.xyz_m)
            if joint.kind == "fixed":
                more_kg, more = self.grow(joint.child, parent, turned, place)
                moment = moment + more
            else:
                more_kg = self._grow_moving(joint, parent, turned, place)
            kg += more_kg
        return kg, moment

    def _grow_moving(self, joint: UrdfJoint, parent: int, turned: FloatArray, place: FloatArray) -> float:
        axis = np.array(joint.axis) / np.linalg.norm(joint.axis)
        cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
        turns, along = joint.kind in TURNING, np.outer(axis, axis)
        leader, multiplier, offset = self._leader(joint)
        node = MovingJoint(
            name=joint.name,
            parent=parent,
            turns=turns,
            still=_flat(turned @ along if turns else turned),
            sine=_flat(turned @ cross),
            cosine=_flat(turned @ (np.eye(3) - along)),
            place_m=_vector(place),
            slide=_vector(turned @ axis),
            axis=_vector(axis),
            leader=leader,
            multiplier=multiplier,
            offset=offset,
            moment=(0.0, 0.0, 0.0),
            carried_kg=0.0,
        )
        index = len(self.found)
        self.found.append(node)
        carried_kg, moment = self.grow(joint.child, index, np.eye(3), np.zeros(3))
        self.found[index] = replace(node, moment=_vector(moment), carried_kg=carried_kg)
        return carried_kg

    def _leader(self, joint: UrdfJoint) -> tuple[int, float, float]:
        """Resolve chains of mimic joints. Return the index of the commanded joint, the multiplier and the offset."""
        multiplier, offset, seen = 1.0, 0.0, {joint.name}
        while joint.name not in self._joints and joint.mimic is not None and joint.mimic.joint not in seen:
            offset += multiplier * joint.mimic.offset
            multiplier *= joint.mimic.multiplier
            joint = self._description.joints[joint.mimic.joint]
            seen.add(joint.name)
        if joint.name in self._joints and joint.kind in (*TURNING, "prismatic"):
            return self._joints.index(joint.name), multiplier, offset
        return -1, 0.0, 0.0


def mass_tree(description: Description, joints: Sequence[str]) -> tuple[MovingJoint, ...]:
    """Return all moving joints, each one after its parent. ``joints`` are the commanded joints in order."""
    tree = _Tree(description, joints)
    children = {joint.child for joint in description.joints.values()}
    for root in dict.fromkeys(j.parent for j in description.joints.values() if j.parent not in children):
        tree.grow(root, -1, np.eye(3), np.zeros(3))
    return tuple(tree.found)


def inclination_unknown(tree: Sequence[MovingJoint]) -> set[int]:
    """Return the leaders of joints whose inclination is unknown because a joint nearer the root is not commanded."""
    unknown: set[int] = set()
    lost: list[bool] = []
    for node in tree:
        before = node.parent >= 0 and lost[node.parent]
        lost.append(before or node.leader < 0)
        if before:
            unknown.add(node.leader)
    return unknown


def _rotation(joint: UrdfJoint) -> FloatArray:
    turn = from_rpy(joint.rpy_rad)
    return np.array([rotate(turn, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]).T


def _flat(matrix: FloatArray) -> Matrix:
    return tuple(matrix.ravel().tolist())


def _vector(values: FloatArray) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
