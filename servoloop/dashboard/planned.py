"""Draw the planning scene, and the latest plan as a moving ghost, on the page of ``servoloop view``."""

from collections.abc import Collection, Iterable
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import trimesh
import viser

from hal.rotations import quaternions
from hal.types import FloatArray
from planning.scene import Box, Cone, Cylinder, Pose, Shape, Sphere
from servoloop.dashboard.arm_model import DrawnArm
from servoloop.dashboard.scene import MEASURED, DrawnRobot
from servoloop.dashboard.shapes import DrawnShape, Rgb

if TYPE_CHECKING:
    from nodes.planning_client.scene_watch import SceneItem, ShownPlan, WatchedScene

PLANNED, OBJECTS, HELD = "/planned", "/scene", "planning_object"
WORLD_RGB: Final[Rgb] = (120, 160, 90)
HELD_RGB: Final[Rgb] = (150, 80, 180)
PLAN_RGB: Final[Rgb] = (240, 150, 30)
OPACITY: Final = 0.5
LARGEST_M: Final = 3.0
"""Maximum size of an object that is drawn, in m. Larger objects, such as an infinite table, are omitted."""
SHOWN_S: Final = 2.0
"""Duration of the ghost's pause at the end of a plan, in seconds."""


class PlannedScene:
    """Drawing of the motion planner's scene and plan.

    ``drawn`` contains the names of the objects that the page already shows.
    """

    def __init__(
        self, server: viser.ViserServer, model: DrawnArm, visuals: Iterable[DrawnShape], drawn: Collection[str] = ()
    ) -> None:
        self._server, self._model, self._drawn = server, model, frozenset(drawn)
        self._ghost = DrawnRobot(server, model, PLANNED, visuals, PLAN_RGB)
        self._ghost.show(False)
        self._items: tuple[SceneItem, ...] = ()
        self._plan: ShownPlan | None = None
        self._begun_s = 0.0
        self._handles: list[Any] = []

    def show(self, watched: "WatchedScene", position: FloatArray, now_s: float) -> None:
        """Update the objects and the ghost.

        Args:
            watched: Latest scene and plan.
            position: Measured joint positions (n,), for the joints that the plan does not move.
            now_s: Time of any steady clock, in seconds.
        """
        if watched.items is not self._items:
            self._draw(watched.items)
        if watched.plan is not self._plan:
            self._plan, self._begun_s = watched.plan, now_s
        self._move_ghost(position, now_s - self._begun_s)

    def remove(self) -> None:
        """Remove everything from the page."""
        self._draw(())
        self._server.scene.remove_by_name(PLANNED)

    def _move_ghost(self, position: FloatArray, elapsed_s: float) -> None:
        plan = self._plan
        is_shown = plan is not None and elapsed_s < plan.times_s[-1] + SHOWN_S
        self._ghost.show(is_shown)
        if plan is None or not is_shown:
            return
        planned = np.array(position)
        for column, joint in enumerate(plan.joints):
            if joint in self._model.measured:
                at = np.interp(elapsed_s, plan.times_s, plan.positions[:, column])
                planned[self._model.measured.index(joint)] = at
        with self._server.atomic():
            self._ghost.move(self._model.moving(planned))

    def _draw(self, items: "tuple[SceneItem, ...]") -> None:
        self._items = items
        with self._server.atomic():
            for handle in self._handles:
                handle.remove()
            self._handles = [handle for number, item in enumerate(items) for handle in self._item(number, item)]

    def _item(self, number: int, item: "SceneItem") -> Iterable[Any]:
        if item.link and item.link not in self._model.links:
            return
        if not item.link and item.name in self._drawn:
            return
        root = f"{MEASURED}{self._model.branch(item.link)}/{HELD}" if item.link else OBJECTS
        for part, (shape, pose) in enumerate(item.shapes):
            mesh = mesh_of(shape)
            if mesh.extents.max() < LARGEST_M:
                yield self._add(f"{root}{number}_{part}", mesh, pose, HELD_RGB if item.link else WORLD_RGB)

    def _add(self, name: str, mesh: trimesh.Trimesh, pose: Pose, rgb: Rgb) -> Any:
        x, y, z, w = quaternions(pose.matrix).tolist()
        return self._server.scene.add_mesh_simple(
            name,
            np.asarray(mesh.vertices, np.float32),
            np.asarray(mesh.faces, np.uint32),
            color=rgb,
            opacity=OPACITY,
            flat_shading=True,
            position=tuple(pose.position_m.tolist()),
            wxyz=(w, x, y, z),
        )


def mesh_of(shape: Shape) -> trimesh.Trimesh:
    """Return a shape as a triangle mesh, with vertices in meters. The planner uses the convex hull of a mesh."""
    found: trimesh.Trimesh
    if isinstance(shape, Box):
        found = trimesh.creation.box(extents=shape.sides_m())
    elif isinstance(shape, Cylinder):
        found = trimesh.creation.cylinder(shape.radius_m, shape.height_m)
    elif isinstance(shape, Cone):
        found = trimesh.creation.cone(shape.radius_m, shape.height_m)
        # The origin of the planner's cone is at half its height on its axis.
        found.apply_translation((0.0, 0.0, -shape.height_m / 2.0))
    elif isinstance(shape, Sphere):
        found = trimesh.creation.icosphere(subdivisions=3, radius=shape.radius_m)
    else:
        found = trimesh.Trimesh(shape.vertices_m, shape.triangles, process=False)
    return found
