"""Read objects from scene files in MoveIt's ``.scene`` format or in YAML.

A YAML file contains one entry for each object::

    objects:
      shelf:
        position_m: [0.35, 0.0, 0.30]
        rpy_rad: [0.0, 0.0, 0.5]
        box: [0.10, 0.30, 0.02]
      cup:
        position_m: [0.20, 0.10, 0.05]
        cylinder: {height_m: 0.10, radius_m: 0.04}
      fixture:
        shapes:
        - mesh: {file: fixture.stl, scale: 0.001}
        - sphere: {radius_m: 0.02}
          position_m: [0.0, 0.0, 0.1]

Object poses are in the planning frame. Shape poses are in the frame of their object.
"""

import math
from pathlib import Path
from typing import Annotated, Final, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from hal.plausible import Finite, Positive
from hal.text_file import read_text
from hal.yaml_file import load_with_lines
from hal.yaml_nodes import YamlFile
from planning.mesh_file import read_mesh
from planning.moveit_scene import SceneFileError, parse_moveit_scene
from planning.planning_errors import PlanningError
from planning.scene import Box, Cone, Cylinder, Pose, SceneObject, Shape, Sphere, check_object

KINDS: Final = ("box", "cylinder", "cone", "sphere", "mesh")
Length = Annotated[float, Positive]
Number = Annotated[float, Finite]
Vector = tuple[Number, Number, Number]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class RoundPart(_Part):
    """A cylinder or a cone."""

    height_m: Length
    radius_m: Length


class SpherePart(_Part):
    """A sphere."""

    radius_m: Length


class MeshPart(_Part):
    """A mesh from a file, represented by its convex hull."""

    file: str
    """Path of an STL or OBJ file, relative to the scene file."""
    scale: Length = 1.0
    """Factor applied to all lengths, such as 0.001 for a file in mm."""


class Placed(_Part):
    """A pose."""

    position_m: Vector = (0.0, 0.0, 0.0)
    rpy_rad: Vector | None = None
    """Rotations about the fixed x, y and z axes, in this order, in rad."""
    quaternion_xyzw: tuple[Number, Number, Number, Number] | None = None

    @model_validator(mode="after")
    def _one_orientation(self) -> Self:
        if self.rpy_rad is not None and self.quaternion_xyzw is not None:
            raise ValueError("has both rpy_rad and quaternion_xyzw: remove one")
        return self

    def pose(self) -> Pose:
        """Return the pose. Raises PlanningError if the quaternion's length is not 1."""
        if self.quaternion_xyzw is not None:
            return Pose.from_quaternion(self.position_m, self.quaternion_xyzw)
        return Pose(np.array(self.position_m), rotation(*self.rpy_rad or (0.0, 0.0, 0.0)))


class ShapePart(Placed):
    """A pose and one shape."""

    box: tuple[Length, Length, Length] | None = None
    """Lengths along x, y and z, in m."""
    cylinder: RoundPart | None = None
    cone: RoundPart | None = None
    sphere: SpherePart | None = None
    mesh: MeshPart | None = None

    def kinds(self) -> list[str]:
        """Return the types of the given shapes."""
        return [kind for kind in KINDS if getattr(self, kind) is not None]

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        if len(self.kinds()) > 1:
            raise ValueError(f"has several shapes ({', '.join(self.kinds())}): list them under shapes")
        return self

    def shape(self, folder: Path) -> Shape:
        """Return the shape. Mesh paths are relative to ``folder``. Raises MeshFileError."""
        if self.box is not None:
            return Box(*self.box)
        if self.cylinder is not None:
            return Cylinder(self.cylinder.height_m, self.cylinder.radius_m)
        if self.cone is not None:
            return Cone(self.cone.height_m, self.cone.radius_m)
        if self.sphere is not None:
            return Sphere(self.sphere.radius_m)
        assert self.mesh is not None
        return read_mesh(folder / self.mesh.file, self.mesh.scale)


class LoneShape(ShapePart):
    """One of several shapes of an object."""

    @model_validator(mode="after")
    def _has_shape(self) -> Self:
        if not self.kinds():
            raise ValueError(f"has no shape: add one of {', '.join(KINDS)}")
        return self


class ObjectPart(ShapePart):
    """An object with one shape, or with a list of shapes."""

    shapes: tuple[LoneShape, ...] = ()

    @model_validator(mode="after")
    def _has_shapes(self) -> Self:
        if bool(self.kinds()) == bool(self.shapes):
            raise ValueError(f"needs either one of {', '.join(KINDS)}, or a list of shapes")
        return self

    def item(self, name: str, folder: Path) -> SceneObject:
        """Return the object. Raises PlanningError."""
        alone = [(self.shape(folder), Pose())] if self.kinds() else []
        shapes = [*alone, *((part.shape(folder), part.pose()) for part in self.shapes)]
        found = SceneObject(name, tuple(shapes), self.pose())
        check_object(found)
        return found


class SceneFile(_Part):
    """Content of a YAML file."""

    objects: dict[str, ObjectPart] = Field(min_length=1)


def read_scene_file(path: Path) -> list[SceneObject]:
    """Read the objects of a scene file.

    Args:
        path: A MoveIt ``.scene`` file or a YAML file.

    Returns:
        The objects, with their poses in the planning frame.

    Raises:
        SceneFileError: The file contains errors. The message contains the line of each error.
    """
    if path.suffix.lower() == ".scene":
        return parse_moveit_scene(read_text(path, SceneFileError), str(path))
    content, lines = load_with_lines(path, SceneFile, SceneFileError)
    return [_item(name, part, path, lines) for name, part in content.objects.items()]


def _item(name: str, part: ObjectPart, path: Path, lines: YamlFile) -> SceneObject:
    try:
        return part.item(name, path.parent)
    except PlanningError as error:
        raise SceneFileError(f"{lines.place(('objects', name))}: objects.{name}: {error}") from error


def rotation(roll: float, pitch: float, yaw: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Return the matrix (3, 3) for rotations about the fixed x, y and z axes, in this order, in rad."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(angle), math.sin(angle)) for angle in (roll, pitch, yaw))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
