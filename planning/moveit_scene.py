"""Parse MoveIt's ``.scene`` files, which RViz's MotionPlanning panel saves.

A file begins with the name of the scene. Each object begins with a line that contains ``*`` and the object's name.
The next lines contain the object's pose, the number of its shapes, the shapes with their poses and colors, the number
of its subframes, and the subframe poses. The older format does not contain object poses or subframes.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from planning.planning_errors import PlanningError
from planning.scene import Box, Cone, Cylinder, Mesh, Pose, SceneObject, Shape, Sphere, check_object

MOST: Final = 1_000_000
"""Maximum number of shapes, subframes, vertices or triangles."""


class SceneFileError(PlanningError):
    """A scene file contains an error. The message contains the file name and the line number."""

    def __init__(self, message: str) -> None:
        super().__init__("INVALID_OBJECT_NAME", message)


def parse_moveit_scene(text: str, file: str) -> list[SceneObject]:
    """Parse a ``.scene`` file in the old or the new format. Colors and subframes are ignored.

    Args:
        text: Content of the file.
        file: Name of the file, for messages.

    Returns:
        The objects, with their poses in the planning frame.

    Raises:
        SceneFileError: The file contains an error.
    """
    reader = _Reader(text, file)
    objects: dict[str, SceneObject] = {}
    while (marker := reader.word("* or .")) != ".":
        if marker != "*":
            raise reader.error(f"expected * (an object) or . (the end of the file), not {marker}")
        name = reader.rest_of_line()
        if not name or name in objects:
            raise reader.error(
                f"two objects are named {name}: rename one" if name else "the object has no name: add a name"
            )
        objects[name] = _object(reader, name)
    return list(objects.values())


class _Reader:
    """Words of a file, with their line numbers."""

    def __init__(self, text: str, file: str) -> None:
        self._lines = text.splitlines()
        self._file = file
        self._line = 1  # the first line contains the name of the scene
        self._words: list[str] = self._split()
        markers = (number for number, line in enumerate(self._lines) if number and line.startswith("*"))
        first = next(markers, len(self._lines))
        after = self._lines[first + 1] if first + 1 < len(self._lines) else ""
        self.is_new = len(after.split()) > 1
        """Whether objects have poses and subframes."""

    def error(self, text: str) -> SceneFileError:
        """Return an error for the current line."""
        return SceneFileError(f"{self._file}, line {min(self._line + 1, max(1, len(self._lines)))}: {text}")

    def word(self, what: str) -> str:
        """Return the next word. ``what`` describes the word in error messages."""
        while not self._words:
            if self._line + 1 >= len(self._lines):
                raise self.error(f"the file ends before {what}: complete the file")
            self._line += 1
            self._words = self._split()
        return self._words.pop(0)

    def rest_of_line(self) -> str:
        """Return the rest of the current line."""
        rest, self._words = " ".join(self._words), []
        return rest

    def count(self, what: str) -> int:
        """Return the next word as a count."""
        word = self.word(f"the number of {what}")
        if not word.isascii() or not word.isdigit() or int(word) > MOST:
            raise self.error(f"the number of {what} must be a whole number up to {MOST}, not {word}")
        return int(word)

    def numbers(self, count: int, what: str) -> list[float]:
        """Return the next words as finite numbers."""
        found = []
        for _ in range(count):
            word = self.word(what)
            try:
                found.append(float(word))
            except ValueError:
                raise self.error(f"{what} must be {count} numbers, but one is {word}") from None
            if not math.isfinite(found[-1]):
                raise self.error(f"{what} must be finite, but one number is {word}")
        return found

    def pose(self, what: str) -> Pose:
        """Return the next seven numbers as a pose: a position, then a quaternion x, y, z, w."""
        position, quaternion = self.numbers(3, f"the position of {what}"), self.numbers(4, f"the orientation of {what}")
        try:
            return Pose.from_quaternion(position, quaternion)
        except PlanningError as error:
            raise self.error(str(error)) from error

    def _split(self) -> list[str]:
        return self._lines[self._line].split() if self._line < len(self._lines) else []


def _object(reader: _Reader, name: str) -> SceneObject:
    pose = reader.pose(f"object {name}") if reader.is_new else Pose()
    shapes = []
    for _ in range(reader.count(f"shapes of {name}")):
        shape = _shape(reader, name)
        shapes.append((shape, reader.pose(f"a shape of {name}")))
        reader.numbers(4, f"the color of {name}")
    for _ in range(reader.count(f"subframes of {name}") if reader.is_new else 0):
        reader.word("the name of a subframe")
        reader.pose(f"a subframe of {name}")
    item = SceneObject(name, tuple(shapes), pose)
    try:
        check_object(item)
    except PlanningError as error:
        raise reader.error(str(error)) from error
    return item


def _shape(reader: _Reader, name: str) -> Shape:
    kind = reader.word(f"a shape of {name}")
    if kind == "sphere":
        return Sphere(*reader.numbers(1, f"the radius of {name}"))
    if kind == "box":
        return Box(*reader.numbers(3, f"the size of {name}"))
    if kind in ("cylinder", "cone"):
        radius_m, height_m = reader.numbers(2, f"radius and height of {name}")
        return (Cylinder if kind == "cylinder" else Cone)(height_m, radius_m)
    if kind == "mesh":
        return _mesh(reader, name)
    remedy = "replace it with a box" if kind == "plane" else "use box, sphere, cylinder, cone or mesh"
    raise reader.error(f"{name} has a shape of type {kind}, which is not supported: {remedy}")


def _mesh(reader: _Reader, name: str) -> Mesh:
    vertices, triangles = reader.count(f"vertices of {name}"), reader.count(f"triangles of {name}")
    if triangles == 0:
        raise reader.error(f"the mesh of {name} has no triangles: add triangles, or remove the mesh")
    places = np.array([reader.numbers(3, f"a vertex of {name}") for _ in range(vertices)]).reshape(-1, 3)
    corners = [_corners(reader, name, vertices) for _ in range(triangles)]
    return Mesh(places, np.array(corners, dtype=np.int64))


def _corners(reader: _Reader, name: str, vertices: int) -> Sequence[int]:
    corners = [reader.count(f"a vertex in a triangle of {name}") for _ in range(3)]
    if max(corners) >= vertices:
        raise reader.error(f"a triangle of {name} has vertex {max(corners)}, but the mesh has {vertices} vertices")
    return corners
