"""Constraints that a motion satisfies at every point: joint ranges, and regions for link poses."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from hal.types import FloatArray, JointLimits
from planning.arm_model import ArmModel
from planning.collision import MARGINS, PADDING_M, Collisions, Contact, Margins
from planning.kinematics.chain import Chain
from planning.kinematics.goals import PoseGoal
from planning.planning_errors import PlanningError
from planning.scene import Pose, Scene

STEP_RAD: Final = 0.02
"""Maximum motion of a joint between two checked points of an edge, in rad or m. Between these points, a pose may leave
its region by as much as this joint motion can cause.
"""
CONSTRAINT: Final = "path constraint"
"""Name used instead of the other object if a link leaves its region."""


@dataclass(frozen=True, slots=True, eq=False)
class LinkRegion:
    """Region in which a link must stay.

    To constrain only the orientation, make the position region large, and vice versa.
    """

    goal: PoseGoal
    link: str | None = None
    """Link or site, or the tip of the group if None."""
    offset: Pose = field(default_factory=Pose)
    """Frame that stays in the region, relative to the link to which it is fixed."""


@dataclass(frozen=True, slots=True)
class PathConstraints:
    """Constraints of a motion."""

    joints: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Lower and upper limits, keyed by joint name, in rad or m. If both ends of an edge are within these
    ranges, the whole edge is within them.
    """
    regions: Sequence[LinkRegion] = ()
    """Link regions, checked at steps of ``STEP_RAD``."""

    def limits(self, limits: Mapping[str, JointLimits]) -> dict[str, JointLimits]:
        """Return limits that are narrowed to the joint ranges.

        Raises:
            PlanningError: A range does not overlap the joint's limits.
        """
        narrowed = dict(limits)
        for joint, (lower, upper) in self.joints.items():
            if joint not in limits:
                continue  # a joint of another group does not move
            limit = limits[joint]
            lowest, highest = max(lower, limit.lower), min(upper, limit.upper)
            if not lowest < highest or not math.isfinite(lower + upper):
                raise PlanningError(
                    "INVALID_MOTION_PLAN",
                    f"the path constraint of {joint}, {lower:g} to {upper:g}, allows no motion within its limits "
                    f"{limit.lower:g} to {limit.upper:g}: widen the constraint",
                )
            narrowed[joint] = replace(limit, lower=lowest, upper=highest)
        return narrowed

    def broken_range(self, state: Mapping[str, float]) -> str:
        """Describe the first joint of a state that is outside its range, or return an empty string."""
        for joint, (lower, upper) in self.joints.items():
            if joint in state and not lower - STEP_RAD <= state[joint] <= upper + STEP_RAD:
                return f"{joint} is at {state[joint]:.4f}, outside its path constraint {lower:.4f} to {upper:.4f}"
        return ""


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A region for one link, with the kinematics of the link."""

    chain: Chain
    goal: PoseGoal
    own: Sequence[int]
    """Index of each joint of the chain in the group's positions."""

    def broken(self, positions: FloatArray) -> int:
        """Return the index of the first of several positions (k, n) that is outside the region, or -1."""
        inside = self.goal.contains(self.chain.transforms(positions[:, self.own]))
        return -1 if inside.all() else int(np.argmin(inside))

    def text(self, positions: FloatArray) -> str:
        """Describe how far the link is outside the region at positions (n,).

        The string is empty if the link is inside.
        """
        if self.broken(positions[None]) < 0:
            return ""
        tool = self.chain.transforms(positions[None, self.own])
        beyond = np.abs(self.goal.excess(tool, 1.0)[0]).reshape(2, 3).max(axis=1)
        away = zip(self.goal.distances(tool)[0].tolist(), beyond.tolist(), ("m", "rad"), strict=True)
        place = " and ".join(f"{distance:.3f} {unit}" for distance, excess, unit in away if excess > 0.0)
        return f"{self.chain.tool} is outside its path constraint, {place} from its center"


class ConstrainedCollisions(Collisions):
    """Collision checks that also reject poses and edges with links outside their regions."""

    def __init__(self, arm: ArmModel, scene: Scene, regions: Sequence[Region]) -> None:
        super().__init__(arm, scene)
        self._regions = regions

    def is_clear(self, positions: FloatArray, padding_m: float = PADDING_M) -> bool:
        """Return whether positions (n,) have a clearance of at least ``padding_m`` and all links are in their
        regions."""
        return not self.broken_region(positions) and super().is_clear(positions, padding_m)

    def edge_contact(self, start: FloatArray, end: FloatArray, margins: Margins = MARGINS) -> Contact | None:
        """Return the position at which an edge comes too close to an obstacle or leaves a region, or None."""
        count = max(1, math.ceil(float(np.abs(np.subtract(end, start)).max()) / STEP_RAD))
        shares = np.linspace(0.0, 1.0, count + 1)
        points = np.asarray(start) + shares[:, None] * np.subtract(end, start)
        for region in self._regions:
            if (index := region.broken(points)) >= 0:
                return Contact(float(shares[index]), (region.chain.tool, CONSTRAINT))
        return super().edge_contact(start, end, margins)

    def broken_region(self, positions: FloatArray) -> str:
        """Describe the first link outside its region at positions (n,), or return an empty string."""
        return next((text for region in self._regions if (text := region.text(positions))), "")
