"""Obstacles around an arm, and objects that it carries."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from planning.mesh_file import read_mesh
from planning.planning_errors import PlanningError
from planning.scene import Box, Cylinder, Pose, Scene, SceneObject, Shape, Sphere
from planning.scene_file import read_scene_file
from servoloop.api.arm_errors import ArmInputError, PlanFailedError
from servoloop.api.checks import checked_number, checked_numbers
from servoloop.api.planning.motion_planner import MotionPlanner

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
"""Quaternion of an object that is not rotated."""


@contextmanager
def plan_errors() -> Iterator[None]:
    """Convert PlanningError to PlanFailedError."""
    try:
        yield
    except PlanningError as error:
        raise PlanFailedError(str(error), code=error.code) from error


class ArmScene:
    """Obstacles around an arm. Lengths are in m, and poses are in the frame of the arm's base.

    Initially, the obstacles are the objects from the arm's scene file. All methods raise PlanFailedError if an object
    has no size, its name is not a string or its pose is not finite, and ArmInputError if a length is not a number.
    """

    def __init__(self, planner: MotionPlanner, position: Callable[[], Mapping[str, float]]) -> None:
        """Provide access to a planner's scene.

        Args:
            planner: Planner for the arm.
            position: Function that returns the measured positions of all joints.
        """
        self._planner, self._position = planner, position

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the obstacles."""
        scene = self._planner.scene
        hidden = [
            name for name in self._planner.objects if name not in scene.removed | {*scene.objects, *scene.attached}
        ]
        return (*scene.objects, *hidden)

    @property
    def attached(self) -> tuple[str, ...]:
        """Names of the attached objects."""
        return tuple(self._planner.scene.attached)

    def add_box(
        self,
        name: str,
        size_m: Sequence[float],
        position_m: Sequence[float],
        quaternion_xyzw: Sequence[float] = UPRIGHT,
    ) -> None:
        """Add a box, or replace the object with this name.

        ``size_m`` (3,) contains the lengths of the box along x, y and z.
        """
        x, y, z = checked_numbers("size_m", size_m, 3)
        self._add(name, Box(x, y, z), position_m, quaternion_xyzw)

    def add_cylinder(
        self,
        name: str,
        height_m: float,
        radius_m: float,
        position_m: Sequence[float],
        quaternion_xyzw: Sequence[float] = UPRIGHT,
    ) -> None:
        """Add a cylinder along z, or replace the object with this name. The position of a cylinder is its center."""
        cylinder = Cylinder(checked_number("height_m", height_m), checked_number("radius_m", radius_m))
        self._add(name, cylinder, position_m, quaternion_xyzw)

    def add_sphere(self, name: str, radius_m: float, position_m: Sequence[float]) -> None:
        """Add a sphere, or replace the object with this name."""
        self._add(name, Sphere(checked_number("radius_m", radius_m)), position_m, UPRIGHT)

    def add_mesh(
        self,
        name: str,
        file: str | Path,
        position_m: Sequence[float],
        quaternion_xyzw: Sequence[float] = UPRIGHT,
        scale: float = 1.0,
    ) -> None:
        """Add the convex hull of an STL or OBJ file, or replace the object with this name.

        ``scale`` is a factor applied to all lengths, such as 0.001 for a file in mm.
        """
        with plan_errors():
            mesh = read_mesh(_path(file), checked_number("scale", scale))
        self._add(name, mesh, position_m, quaternion_xyzw)

    def load(self, file: str | Path) -> tuple[str, ...]:
        """Add the objects from a YAML file or a MoveIt ``.scene`` file, and return their names."""
        with plan_errors():
            items, scene = read_scene_file(_path(file)), self._planner.scene
            for item in items:
                scene = scene.with_object(SceneObject(item.name, item.shapes, self._origin @ item.pose))
        self._planner.scene = scene
        return tuple(item.name for item in items)

    def remove(self, name: str) -> None:
        """Remove an obstacle or an attached object."""
        if name not in (*self.names, *self.attached):
            raise self._unknown(name)
        self._planner.scene = self._planner.scene.without(name)

    def allow(self, one: str, other: str) -> None:
        """Allow two links or objects to touch each other."""
        known = (*self.names, *self.attached, *self._planner.links)
        for name in (one, other):
            if name not in known:
                raise PlanFailedError(f"there is no link or object {name}: choose from {', '.join(known)}")
        self._planner.scene = self._planner.scene.allow(one, other)

    def attach(self, name: str, link: str | None, touch_links: Sequence[str] | None) -> None:
        """Attach an obstacle to a link, so that the obstacle moves with the link."""
        robot, scene, state = self._planner.robot, self._planner.scene, self._position()
        if name not in self.names:
            raise self._unknown(name)
        if name not in scene.objects:
            raise PlanFailedError(
                f"{name} cannot be attached, because it contains a plane, a capsule or an ellipsoid: use an object of "
                "boxes, spheres, cylinders and meshes",
                code="INVALID_OBJECT_NAME",
            )
        with plan_errors():
            carrier = link or self._planner.carrier
            carried = robot.carried_links(carrier)
            touching = carried if touch_links is None else _checked_links(touch_links)
            held = robot.frame_pose(carrier, robot.state(state)).inverse() @ scene.objects[name].pose
            item = SceneObject(name, scene.objects[name].shapes, held)
            self._planner.scene = scene.attach(item, carrier, touching)

    def detach(self, name: str) -> None:
        """Detach an object and leave it where it is now."""
        robot, scene = self._planner.robot, self._planner.scene
        with plan_errors():
            if name not in self.attached:
                scene.detach(str(name), Pose())  # raises an error
            pose = robot.frame_pose(name, robot.state(self._position()), scene)
            self._planner.scene = scene.detach(name, pose)

    @property
    def _origin(self) -> Pose:
        return self._planner.robot.origin

    def _add(self, name: str, shape: Shape, position_m: Sequence[float], quaternion_xyzw: Sequence[float]) -> None:
        with plan_errors():
            pose = self._origin @ Pose.from_quaternion(position_m, quaternion_xyzw)
            scene: Scene = self._planner.scene.with_object(SceneObject(name, ((shape, Pose()),), pose))
        self._planner.scene = scene

    def _unknown(self, name: str) -> PlanFailedError:
        known = ", ".join((*self.names, *self.attached)) or "none"
        return PlanFailedError(f"there is no object {name}; the objects are: {known}", code="INVALID_OBJECT_NAME")


def _path(file: object) -> Path:
    if not isinstance(file, str | Path):
        raise ArmInputError(f"the file must be a path, not {file!r}")
    return Path(file)


def _checked_links(touch_links: object) -> Sequence[str]:
    given = [*touch_links] if isinstance(touch_links, Iterable) and not isinstance(touch_links, str) else [None]
    links = [link for link in given if isinstance(link, str)]
    if len(links) != len(given):
        raise ArmInputError(f"touch_links must be a sequence of link names, not {touch_links!r}")
    return links
