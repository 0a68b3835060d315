"""Conversions between the shapes of collision objects and the shapes of planning/."""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import chain, zip_longest
from typing import Any, Final

import numpy as np
from geometry_msgs.msg import Pose as PoseMessage
from moveit_msgs.msg import CollisionObject
from shape_msgs.msg import Mesh as MeshMessage
from shape_msgs.msg import Plane, SolidPrimitive

from nodes.planning.conversion.poses import is_identity, pose_message, pose_of
from nodes.planning.request_errors import RequestError
from planning.scene import Box, Cone, Cylinder, Mesh, Pose, Shape, Sphere

PLANE_M: Final = 20.0
"""Side of the box that replaces a plane, in m."""
PLANE_DEPTH_M: Final = 0.1
"""Depth of the box that replaces a plane, in m. The box is below the plane."""

_LISTS: Final = (("primitives", "primitive_poses"), ("meshes", "mesh_poses"), ("planes", "plane_poses"))
"""Fields of a collision object that contain its shapes and their poses."""

Shapes = tuple[tuple[Shape, Pose], ...]
"""Shapes with their poses in the frame of the object."""

_SOLIDS: Final[Mapping[int, tuple[str, int, Callable[..., Shape]]]] = {
    SolidPrimitive.BOX: ("box", 3, Box),
    SolidPrimitive.SPHERE: ("sphere", 1, Sphere),
    SolidPrimitive.CYLINDER: ("cylinder", 2, Cylinder),
    SolidPrimitive.CONE: ("cone", 2, Cone),
}
"""Type name, number of dimensions and message type of each solid. The dimensions are in the order of the
message."""


def shapes_of(item: CollisionObject) -> Shapes:
    """Return the shapes of a collision object. A plane becomes a large box below the plane.

    Raises:
        PlanningError: A pose is invalid.
        RequestError: A shape has an unknown type or no size, or the number of poses is wrong.
    """
    return tuple(
        chain(
            _posed(item.id, "primitives", item.primitives, item.primitive_poses, solid),
            _posed(item.id, "meshes", item.meshes, item.mesh_poses, mesh),
            _posed(item.id, "planes", item.planes, item.plane_poses, plane),
        )
    )


def has_shapes(item: CollisionObject) -> bool:
    """Return whether a collision object has any shapes."""
    return bool(item.primitives or item.meshes or item.planes)


def centered(item: CollisionObject) -> CollisionObject:
    """If an object has no pose and only one shape, move the shape's pose to the object, as MoveIt does."""
    poses = (item.primitive_poses, item.mesh_poses, item.plane_poses)
    if not is_identity(item.pose) or sum(map(len, poses)) != 1:
        return item
    changed = copied(item)
    for own in (changed.primitive_poses, changed.mesh_poses, changed.plane_poses):
        if own:
            changed.pose, own[0] = own[0], PoseMessage()
    return changed


def copied(item: CollisionObject) -> CollisionObject:
    """Return a copy of an object. The lists of the copy can be changed without changing the object."""
    fields = {name: getattr(item, name) for name in item.get_fields_and_field_types()}
    return CollisionObject(
        **{name: list(value) if isinstance(value, list) else value for name, value in fields.items()}
    )


def joined(item: CollisionObject, added: CollisionObject) -> CollisionObject:
    """Return a copy of an object that also has the shapes and subframes of another object."""
    changed = copied(item)
    for shapes, poses in _LISTS:
        missing = len(getattr(item, shapes)) - len(getattr(item, poses))
        getattr(changed, poses).extend([*(PoseMessage() for _ in range(missing)), *getattr(added, poses)])
        getattr(changed, shapes).extend(getattr(added, shapes))
    subframes = dict(zip(item.subframe_names, item.subframe_poses, strict=False))
    subframes |= dict(zip(added.subframe_names, added.subframe_poses, strict=False))
    changed.subframe_names, changed.subframe_poses = list(subframes), list(subframes.values())
    return changed


def with_shape_poses(item: CollisionObject, message: CollisionObject) -> CollisionObject:
    """Return an object with the shape poses from a message. A message without such poses leaves the object unchanged.

    Raises:
        RequestError: The number of poses differs from the number of shapes.
    """
    poses = [pose for _, field in _LISTS for pose in getattr(message, field)]
    if not poses:
        return item
    changed = copied(item)
    count = sum(len(getattr(item, shapes)) for shapes, _ in _LISTS)
    if len(poses) != count:
        raise _invalid(
            f'MOVE of object "{item.id}" has {len(poses)} poses of shapes, but the object has {count} shapes: '
            "send one pose for each shape, or none"
        )
    for shapes, field in _LISTS:
        own = len(getattr(item, shapes))
        setattr(changed, field, poses[:own])
        poses = poses[own:]
    return changed


def solid(owner: str, message: SolidPrimitive) -> tuple[Shape, Pose]:
    """Return the shape of a solid. Raises RequestError if its type or its number of dimensions is unknown."""
    if message.type not in _SOLIDS:
        known = ", ".join(name for name, _, _ in _SOLIDS.values())
        raise _invalid(f'object "{owner}" has a shape of type {message.type}: use {known}')
    name, count, shape = _SOLIDS[message.type]
    if len(message.dimensions) != count:
        raise _invalid(f'{name} of object "{owner}" has {len(message.dimensions)} dimensions: send {count}')
    return shape(*message.dimensions), Pose()


def mesh(owner: str, message: MeshMessage) -> tuple[Shape, Pose]:
    """Return the shape of a mesh. Raises RequestError if the mesh has no triangles, or if a triangle refers to a vertex
    that does not exist."""
    if not message.triangles:
        raise _invalid(f'mesh of object "{owner}" has no triangles: check its file')
    used = sorted({int(index) for triangle in message.triangles for index in triangle.vertex_indices})
    if used[-1] >= len(message.vertices):
        raise _invalid(f'mesh of object "{owner}" has no vertex {used[-1]}: it has {len(message.vertices)} vertices')
    vertices = [(message.vertices[i].x, message.vertices[i].y, message.vertices[i].z) for i in used]
    places = {index: place for place, index in enumerate(used)}
    triangles = [[places[int(index)] for index in triangle.vertex_indices] for triangle in message.triangles]
    return Mesh(np.array(vertices), np.array(triangles)), Pose()


def plane(owner: str, message: Plane) -> tuple[Shape, Pose]:
    """Return the box below the plane a x + b y + c z + d = 0. Raises RequestError if the plane's normal is zero."""
    *normal, offset = map(float, message.coef)
    length = math.hypot(*normal)
    if not math.isfinite(length + offset) or length == 0.0:
        raise _invalid(f'plane of object "{owner}" has the coefficients {[*normal, offset]}: send a normal')
    z = np.array(normal) / length
    x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    x /= np.linalg.norm(x)
    center_m = z * (-offset / length - PLANE_DEPTH_M / 2.0)
    return Box(PLANE_M, PLANE_M, PLANE_DEPTH_M), Pose(center_m, np.stack([x, np.cross(z, x), z], axis=1))


def add_shapes(item: CollisionObject, shapes: Sequence[tuple[Shape, Pose]]) -> None:
    """Append boxes, cylinders, cones, spheres and meshes to a message."""
    for shape, pose in shapes:
        if isinstance(shape, Mesh):
            raise TypeError("a mesh cannot be converted to a message: only its original message contains the triangles")
        kind = next(kind for kind, (_, _, known) in _SOLIDS.items() if known is type(shape))
        item.primitives.append(SolidPrimitive(type=kind, dimensions=list(shape.sides_m())))
        item.primitive_poses.append(pose_message(pose))


def _posed(
    owner: str,
    field: str,
    shapes: Sequence[Any],
    poses: Sequence[PoseMessage],
    convert: Callable[[str, Any], tuple[Shape, Pose]],
) -> list[tuple[Shape, Pose]]:
    if len(shapes) < len(poses):
        counts = f"{len(shapes)} {field} and {len(poses)} poses"
        raise _invalid(f'object "{owner}" has {counts}: send at most one pose for each')
    found = []
    for shape, pose in zip_longest(shapes, poses, fillvalue=PoseMessage()):  # As in MoveIt, the poses may be omitted.
        converted, own = convert(owner, shape)
        found.append((converted, pose_of(pose) @ own))
    return found


def _invalid(message: str) -> RequestError:
    return RequestError("INVALID_OBJECT_NAME", message)


def without_shapes(item: CollisionObject) -> CollisionObject:
    """Return an object that contains only its name, type and pose."""
    return CollisionObject(header=item.header, id=item.id, type=item.type, pose=item.pose)
