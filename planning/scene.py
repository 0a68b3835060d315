"""The planning scene: world objects, objects attached to links, and pairs that may touch.

A scene never changes. All methods return changed copies, so that a plan keeps the scene with which it began. Meshes are
replaced by their convex hulls.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hal.rotations import matrices
from hal.types import FloatArray
from planning.arm_model import Pair, pair
from planning.planning_errors import PlanningError
from planning.vectors import vector_of

FLAT_M: Final = 1e-6
"""Extent below which a mesh is considered flat, in m. A flat mesh has no volume and therefore no hull."""


@dataclass(frozen=True, slots=True)
class Pose:
    """Position and orientation of a frame."""

    position_m: FloatArray = field(default_factory=lambda: np.zeros(3))
    """Position (3,), in m."""
    matrix: FloatArray = field(default_factory=lambda: np.eye(3))
    """Rotation matrix (3, 3)."""

    @classmethod
    def from_quaternion(cls, position_m: Iterable[float], quaternion: Iterable[float]) -> "Pose":
        """Return a pose from a position (3,) in m and a quaternion x, y, z, w.

        Raises:
            PlanningError: A value is missing or not finite, or the quaternion's length is not 1.
        """
        position, (x, y, z, w) = _numbers("position", position_m, 3), _numbers("quaternion", quaternion, 4).tolist()
        length = math.sqrt(x * x + y * y + z * z + w * w)
        if not np.all(np.isfinite(position)) or not math.isfinite(length):
            raise PlanningError("INVALID_OBJECT_NAME", f"pose {position.tolist()}, {[x, y, z, w]} must be finite")
        if abs(length - 1.0) > 1e-2:
            raise PlanningError(
                "INVALID_OBJECT_NAME", f"quaternion {[x, y, z, w]} has length {length:.3g}: normalize it to length 1"
            )
        return cls(position, matrices(np.array([x, y, z, w]) / length))

    def __matmul__(self, other: "Pose") -> "Pose":
        """Return the pose of a frame, given its pose relative to this frame (``other``)."""
        return Pose(self.matrix @ other.position_m + self.position_m, self.matrix @ other.matrix)

    def inverse(self) -> "Pose":
        """Return the pose of the parent frame relative to this frame."""
        return Pose(-self.matrix.T @ self.position_m, self.matrix.T)


@dataclass(frozen=True, slots=True)
class Box:
    """A box, with its origin at its center."""

    x_m: float
    y_m: float
    z_m: float

    def sides_m(self) -> tuple[float, ...]:
        """Return the lengths that must be positive."""
        return self.x_m, self.y_m, self.z_m


@dataclass(frozen=True, slots=True)
class Cylinder:
    """A cylinder along z, with its origin at its center."""

    height_m: float
    radius_m: float

    def sides_m(self) -> tuple[float, ...]:
        """Return the lengths that must be positive."""
        return self.height_m, self.radius_m


@dataclass(frozen=True, slots=True)
class Cone:
    """A cone with its tip at +z and its origin halfway up the axis."""

    height_m: float
    radius_m: float

    def sides_m(self) -> tuple[float, ...]:
        """Return the lengths that must be positive."""
        return self.height_m, self.radius_m


@dataclass(frozen=True, slots=True)
class Sphere:
    """A sphere, with its origin at its center."""

    radius_m: float

    def sides_m(self) -> tuple[float, ...]:
        """Return the lengths that must be positive."""
        return (self.radius_m,)


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """A mesh, represented by the convex hull of its vertices."""

    vertices_m: FloatArray
    """Vertices (v, 3), in m."""
    triangles: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))
    """Indices of the corners of each triangle (t, 3), used only for display."""

    def sides_m(self) -> tuple[float, ...]:
        """Return the lengths that must be positive, which are the extents along the principal axes of the vertices."""
        if len(self.vertices_m) < 4 or not np.all(np.isfinite(self.vertices_m)):
            return (math.nan,)
        centered = self.vertices_m - self.vertices_m.mean(axis=0)
        along = centered @ np.linalg.svd(centered, full_matrices=False)[2].T
        return tuple(float(extent) if extent > FLAT_M else 0.0 for extent in np.ptp(along, axis=0))


Shape = Box | Cylinder | Cone | Sphere | Mesh


@dataclass(frozen=True, slots=True)
class SceneObject:
    """An object that consists of one or more shapes."""

    name: str
    shapes: tuple[tuple[Shape, Pose], ...]
    """Shapes with their poses in the frame of the object."""
    pose: Pose = field(default_factory=Pose)
    """Pose in the world, or relative to the link to which the object is attached."""


@dataclass(frozen=True, slots=True)
class Attached:
    """An object that moves with a link."""

    item: SceneObject
    link: str
    touch_links: frozenset[str] = frozenset()
    """Links that may touch the object. The link to which the object is attached may always touch the object."""


@dataclass(frozen=True)
class Scene:
    """World objects, attached objects and pairs that may touch.

    ``allowed`` contains pairs of link and object names, each pair in sorted order. Adjacent links may always touch.
    """

    objects: Mapping[str, SceneObject] = field(default_factory=dict)
    attached: Mapping[str, Attached] = field(default_factory=dict)
    allowed: frozenset[Pair] = frozenset()
    removed: frozenset[str] = frozenset()
    """Names of world objects that were removed from the arm's scene file and are not obstacles."""

    def with_object(self, item: SceneObject) -> "Scene":
        """Return a scene with an additional object, which replaces any object with the same name.

        Raises:
            PlanningError: The name is not a string, the object has no shape, or a shape has a size that is not
                positive.
        """
        check_object(item)
        attached = {name: held for name, held in self.attached.items() if name != item.name}
        return replace(self, objects={**self.objects, item.name: item}, attached=attached)

    def without(self, name: str) -> "Scene":
        """Return a scene without the given object, which may be from the scene or from the arm's scene file."""
        objects = {key: item for key, item in self.objects.items() if key != name}
        attached = {key: held for key, held in self.attached.items() if key != name}
        return replace(self, objects=objects, attached=attached, removed=self.removed | {name})

    def attach(self, item: SceneObject, link: str, touch_links: Iterable[str] = ()) -> "Scene":
        """Return a scene in which an object moves with a link. ``item.pose`` is relative to the link."""
        check_object(item)
        held = Attached(item, link, frozenset(touch_links))
        return replace(self.without(item.name), attached={**self.attached, item.name: held})

    def detach(self, name: str, pose: Pose) -> "Scene":
        """Return a scene in which an attached object becomes a world object at a pose in the world.

        Raises:
            PlanningError: No object with this name is attached.
        """
        if name not in self.attached:
            known = ", ".join(self.attached) or "none"
            raise PlanningError("INVALID_OBJECT_NAME", f'"{name}" is not attached; attached objects: {known}')
        return self.with_object(replace(self.attached[name].item, pose=pose))

    def allow(self, one: str, other: str) -> "Scene":
        """Return a scene in which two links or objects may touch each other.

        Raises:
            PlanningError: A name is not a string.
        """
        _check_name(one)
        _check_name(other)
        return replace(self, allowed=self.allowed | {pair(one, other)})

    def forbid(self, one: str, other: str) -> "Scene":
        """Return a scene in which two links or objects must not touch each other. Adjacent links may still touch each
        other."""
        return replace(self, allowed=self.allowed - {pair(one, other)})


def _numbers(what: str, values: Iterable[float], count: int) -> FloatArray:
    """Return values as an array (count,). Raises PlanningError if there are more or fewer values, or not numbers."""
    found = vector_of(values)
    if found is None or len(found) != count:
        raise PlanningError("INVALID_OBJECT_NAME", f"a {what} needs {count} numbers, not {values!r}")
    return found


def _check_name(name: object) -> None:
    if not isinstance(name, str):
        raise PlanningError("INVALID_OBJECT_NAME", f"the name of an object is {name!r}: use a string")


def check_object(item: SceneObject) -> None:
    """Check an object. Raises PlanningError if its name is not a string, or if the object has no shape, or a size that
    is not positive and finite."""
    _check_name(item.name)
    if not item.shapes:
        raise PlanningError("INVALID_OBJECT_NAME", f'object "{item.name}" has no shape: add at least one shape')
    for shape, pose in item.shapes:
        kind = type(shape).__name__.lower()
        if isinstance(shape, Mesh) and len(shape.vertices_m) < 4:
            mesh = f'mesh of object "{item.name}" has {len(shape.vertices_m)} vertices'
            raise PlanningError("INVALID_OBJECT_NAME", f"{mesh}: a mesh must have at least 4")
        if not all(math.isfinite(side) and side > 0.0 for side in shape.sides_m()):
            sides = " x ".join(f"{side:g}" for side in shape.sides_m())
            raise PlanningError(
                "INVALID_OBJECT_NAME",
                f'{kind} of object "{item.name}" has size {sides} m: every length must be positive and finite',
            )
        if not np.all(np.isfinite(pose.position_m)) or not np.all(np.isfinite(item.pose.position_m)):
            raise PlanningError("INVALID_OBJECT_NAME", f'{kind} of object "{item.name}" has a pose that is not finite')
