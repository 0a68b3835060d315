"""Compute the clearances of an arm in a scene, both at poses and along edges (straight lines in joint space)."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from hal.types import FloatArray, JointLimits
from planning.arm_model import ArmModel
from planning.clearance.chain_tables import chain_tables, joint_positions
from planning.clearance.kernel import edge_contact, pair_distances, pose_clearance
from planning.clearance.pair_tables import pair_tables, planned_levers
from planning.clearance.placement import placement
from planning.scene import Scene

PADDING_M: Final = 2e-3
"""Default minimum clearance of a pose, in m. The padding between links of the arm is never larger than this value."""
TOLERANCE_M: Final = 1e-3
"""Resolution of the edge check, in m. An accepted edge has a clearance of at least the padding minus this value.
"""
ROUNDING_M: Final = 1e-6
"""Rounding tolerance of positions along an edge, in m."""
CONTACT_M: Final = 1e-5
"""Clearance below which a pose is considered in contact, in m."""
INFINITE_M: Final = 1e9


class Clearance(NamedTuple):
    """Smallest distance at a pose."""

    distance_m: float
    """Distance in m, or infinity if nothing can touch. In contact, the value is 0 or negative, but it does not
    represent the penetration depth.
    """
    pair: tuple[str, str]
    """Names of the two links or objects, with the link first."""


class Contact(NamedTuple):
    """Point on an edge at which the arm comes too close to a link or object."""

    part: float
    """Position on the edge, from 0 to 1."""
    pair: tuple[str, str]
    """Names of the two links or objects, the link first."""


@dataclass(frozen=True, slots=True)
class Margins:
    """Distances used by the checks.

    Every point of an accepted edge has a clearance of at least ``padding_m - tolerance_m``. Each step of the check
    covers at least the segment of the edge on which links move by ``tolerance_m``.
    """

    padding_m: float = PADDING_M
    tolerance_m: float = TOLERANCE_M

    def __post_init__(self) -> None:
        if not (0.0 < self.tolerance_m <= self.padding_m < math.inf):
            raise ValueError(
                f"tolerance {self.tolerance_m} m must be above 0 and at most the padding {self.padding_m} m: "
                "otherwise an accepted edge could touch something"
            )

    def within(self, clearance_m: float) -> "Margins":
        """Return margins for a pose with the given clearance. Edges that start at the pose keep at least half of the
        clearance."""
        padding_m = min(self.padding_m, clearance_m)
        return self if padding_m == self.padding_m else Margins(padding_m, min(self.tolerance_m, padding_m / 2.0))

    def for_parts(self) -> "Margins":
        """Return margins that every segment of an accepted edge satisfies.

        Between its checked poses, an accepted edge may come closer to an obstacle than the padding. A second check of a
        segment with the same margins could therefore reject the segment.
        """
        padding_m = max(self.padding_m - self.tolerance_m - ROUNDING_M, ROUNDING_M)
        return Margins(padding_m, min(self.tolerance_m, padding_m) / 2.0)


MARGINS: Final = Margins()
"""Default distances for all checks."""


class Collisions:
    """Collision checks of an arm in a scene.

    The object stores the current positions of joints that are not planned. Only one thread at a time may use the
    object.

    Args:
        arm: The arm.
        scene: Objects, and pairs that may touch each other.

    Raises:
        PlanningError: An object is attached to an unknown link, or a geom of the arm has an unsupported shape.
    """

    def __init__(self, arm: ArmModel, scene: Scene) -> None:
        self._chains = chain_tables(arm)
        self._pairs, self._names = pair_tables(arm, scene, self._chains)
        self._now = placement(self._chains, self._pairs, joint_positions(arm))
        world = self._pairs.frame < 0
        self._to_world = world[self._pairs.one] | world[self._pairs.other]
        self.levers_m = planned_levers(self._chains, self._pairs)
        """Maximum motion of any geometry per motion of each joint (n,), in m/rad, with 1 for a slide."""
        self.poses_checked = 0
        """Number of poses checked so far."""

    def clearance(self, positions: FloatArray) -> Clearance:
        """Return the smallest distance at positions (n,), in rad or m."""
        self.poses_checked += 1
        self._pad(0.0)
        distance_m, pair = pose_clearance(self._chains, self._pairs, self._now, _vector(positions), INFINITE_M)
        return Clearance(distance_m, self._named(pair)) if pair >= 0 else Clearance(math.inf, ("", ""))

    def is_clear(self, positions: FloatArray, padding_m: float = PADDING_M) -> bool:
        """Return whether the arm keeps ``padding_m`` from objects and its links keep their padding from each other."""
        return self.contact(positions, padding_m) is None

    def contact(self, positions: FloatArray, padding_m: float = PADDING_M) -> Contact | None:
        """Return the closest pair at positions (n,) if it is closer than the padding, otherwise None."""
        self.poses_checked += 1
        own_m = self._pad(padding_m)
        pair = pose_clearance(self._chains, self._pairs, self._now, _vector(positions), own_m)[1]
        return Contact(0.0, self._named(pair)) if pair >= 0 else None

    def nearer(self, positions: FloatArray, below_m: float) -> list[Clearance]:
        """Return the pairs of names that are closer than ``below_m`` at positions (n,), with the closest pair first."""
        self.poses_checked += 1
        distances = np.full(len(self._pairs.one), np.inf)
        pair_distances(self._chains, self._pairs, self._now, _vector(positions), distances)
        found: dict[tuple[str, str], float] = {}
        for pair in np.flatnonzero(distances < below_m).tolist():
            names = self._named(pair)
            found[names] = min(found.get(names, math.inf), float(distances[pair]))
        return sorted((Clearance(distance_m, names) for names, distance_m in found.items()), key=lambda one: one[0])

    def room_m(self, positions: FloatArray, padding_m: float) -> float:
        """Return the largest padding that positions (n,) satisfy, in m, but at most ``padding_m``. The padding is
        negative in contact."""
        self.poses_checked += 1
        distances = np.full(len(self._pairs.one), np.inf)
        pair_distances(self._chains, self._pairs, self._now, _vector(positions), distances)
        counts = self._to_world | (distances < PADDING_M)
        return min(padding_m, float(distances[counts].min(initial=np.inf)))

    def edge_contact(self, start: FloatArray, end: FloatArray, margins: Margins = MARGINS) -> Contact | None:
        """Return the position at which an edge comes closer to an object or link than the padding, or None if the edge
        is free.

        An edge that requires more than 2,000 poses, because it remains very close to an obstacle, is not considered
        free.

        Args:
            start: Positions at the start (n,), in rad or m.
            end: Positions at the end (n,).
            margins: Padding and tolerance.
        """
        ends = np.array([start, end], dtype=float)
        padding_m, tolerance_m = self._pad(margins.padding_m), margins.tolerance_m
        # The tolerance is appropriate for the padding of objects, but not for the padding of links.
        if padding_m < margins.padding_m:
            tolerance_m = min(tolerance_m, padding_m / 2.0)
        part, pair, checked = edge_contact(self._chains, self._pairs, self._now, ends, padding_m, tolerance_m)
        self.poses_checked += checked
        return Contact(part, self._named(pair)) if pair >= 0 else None

    def path_contact(self, points: Sequence[FloatArray], margins: Margins = MARGINS) -> Contact | None:
        """Return the first contact of the edges between points (m, n), or None.

        ``part`` is the index of the edge plus the position on the edge.
        """
        for index, (start, end) in enumerate(itertools.pairwise(points)):
            if contact := self.edge_contact(start, end, margins):
                return Contact(index + contact.part, contact.pair)
        return None

    def deviation_m(self, moved: FloatArray) -> float:
        """Return the largest change in any distance if the joints move by ``moved`` (n,), each in rad or m."""
        return float(np.abs(moved) @ self.levers_m)

    def _pad(self, padding_m: float) -> float:
        """Set the padding between links and objects, and return the padding between links."""
        own_m = min(padding_m, PADDING_M)
        self._pairs.extra[:] = (padding_m - own_m) * self._to_world
        return own_m

    def _named(self, pair: int) -> tuple[str, str]:
        return self._names[self._pairs.one[pair]], self._names[self._pairs.other[pair]]


def warm_up() -> None:
    """Compile the checks, which takes about 20 s once per installation. Call this function before a time limit
    starts."""
    one = '<geom size="0.1"/><body name="b"><joint name="j"/><geom type="box" size="0.1 0.1 0.1" pos="1 0 0"/></body>'
    scene = f'<mujoco><worldbody><body name="a">{one}</body></worldbody></mujoco>'
    arm = ArmModel.from_string(scene, {"j": JointLimits(-1.0, 1.0, 1.0, 1.0, 1.0)})
    collisions = Collisions(arm, Scene())
    collisions.clearance(np.zeros(1))
    collisions.edge_contact(np.zeros(1), np.ones(1))
    collisions.nearer(np.zeros(1), 0.0)


def _vector(positions: FloatArray) -> FloatArray:
    return np.ascontiguousarray(positions, dtype=float)


if __name__ == "__main__":
    warm_up()
