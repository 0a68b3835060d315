"""Margins of a path, which are smaller near a start or a goal that is itself close to an obstacle."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hal.types import FloatArray
from planning.collision import Collisions, Contact, Margins


@dataclass(frozen=True, slots=True, eq=False)
class Near:
    """Poses near an end of a path, with separate margins."""

    end: FloatArray
    """The start or the goal (n,), in rad or m."""
    radius: float
    """Maximum distance from the end, in rad."""
    margins: Margins


@dataclass(frozen=True, slots=True)
class PathMargins:
    """Margins of a path."""

    margins: Margins
    near: tuple[Near, ...] = ()
    """Areas of the path with different margins."""

    def at(self, start: FloatArray, end: FloatArray) -> Margins:
        """Return the margins of an edge. If one of the areas contains the whole edge, the margins of that area are
        returned."""
        for place in self.near:
            if max(float(np.linalg.norm(point - place.end)) for point in (start, end)) <= place.radius:
                return place.margins
        return self.margins

    def for_parts(self) -> "PathMargins":
        """Return margins that every segment of an accepted path satisfies."""
        near = tuple(replace(place, margins=place.margins.for_parts()) for place in self.near)
        return PathMargins(self.margins.for_parts(), near)

    def contact(
        self, collisions: Collisions, points: Sequence[FloatArray], sags_m: FloatArray | None = None
    ) -> Contact | None:
        """Return the first contact of the edges between points (m, n), or None.

        ``part`` is the index of the edge plus the position on this edge.

        Args:
            collisions: Collision checks of the arm in the scene.
            points: Points (m, n), in rad or m.
            sags_m: Distances (m - 1,) to add to the padding of each edge, in m. If None, nothing is added.
        """
        sags_m = np.zeros(len(points) - 1) if sags_m is None else sags_m
        for index, ((start, end), sag_m) in enumerate(zip(itertools.pairwise(points), sags_m, strict=True)):
            margins = self.at(start, end)
            grown = replace(margins, padding_m=margins.padding_m + float(sag_m))
            if contact := collisions.edge_contact(start, end, grown):
                return Contact(index + contact.part, contact.pair)
        return None
