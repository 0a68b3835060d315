"""The server's planning scene: objects (as messages and for planning), pairs that may touch, and colors."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
from moveit_msgs.msg import CollisionObject
from std_msgs.msg import ColorRGBA, Header

from nodes.planning.conversion.allowed import AllowedCollisions
from nodes.planning.conversion.poses import pose_message
from nodes.planning.conversion.shapes import PLANE_DEPTH_M, PLANE_M, add_shapes
from planning.robot import PlanningRobot
from planning.scene import Box, Cylinder, Pose, Scene, SceneObject, Shape, Sphere


@dataclass(frozen=True)
class PlanningWorld:
    """A planning scene. The world itself never changes; ``edits.WorldEdit`` creates changed copies."""

    scene: Scene
    items: Mapping[str, CollisionObject] = field(default_factory=dict)
    """Messages for each world object and each attached object, with shapes and subframes."""
    allowed: AllowedCollisions = field(default_factory=AllowedCollisions)
    colors: Mapping[str, ColorRGBA] = field(default_factory=dict)
    padding_m: Mapping[str, float] = field(default_factory=dict)
    """Link padding set by clients, in m."""

    def names(self, robot: PlanningRobot) -> list[str]:
        """Return the names of all links and objects."""
        kept = [name for name in robot.objects if name not in self.scene.removed]
        return [*robot.links, *kept, *self.scene.objects, *self.scene.attached]

    def settled(self, robot: PlanningRobot) -> "PlanningWorld":
        """Return a copy of this world in which the pairs permitted by ``allowed`` may touch."""
        return replace(self, scene=replace(self.scene, allowed=self.allowed.touching(self.names(robot))))


def first_world(robot: PlanningRobot) -> PlanningWorld:
    """Return the initial world, in which the fixed objects of the arm's scene file are objects that clients can change.

    Objects that can move, such as the cube on a simulated bench, are omitted, because they are elsewhere after the
    first motion. Meshes in the scene file remain obstacles that clients cannot see.
    """
    scene, items = robot.scene, dict[str, CollisionObject]()
    for name, geoms in robot.arm().world_geoms().items():
        shapes = [_shape(robot.model, geom) for geom in geoms]
        if _is_loose(robot.model, geoms):
            scene = scene.without(name)
        elif known := [shape for shape in shapes if shape is not None]:
            if len(known) < len(shapes):
                continue
            center = known[0][1]
            own = tuple((shape, center.inverse() @ pose) for shape, pose in known)
            scene = scene.without(name).with_object(SceneObject(name, own, center))
            items[name] = message_of(robot, SceneObject(name, own, center))
    allowed = AllowedCollisions(dict.fromkeys(robot.scene.allowed, True))
    return PlanningWorld(scene, items, allowed).settled(robot)


def message_of(robot: PlanningRobot, item: SceneObject) -> CollisionObject:
    """Convert an object without meshes to a CollisionObject message in the planning frame."""
    message = CollisionObject(header=Header(frame_id=robot.frame), id=item.name)
    message.pose = pose_message(robot.origin.inverse() @ item.pose)
    add_shapes(message, item.shapes)
    return message


def _is_loose(model: mujoco.MjModel, geoms: Iterable[int]) -> bool:
    roots = {int(model.body_rootid[model.geom_bodyid[geom]]) for geom in geoms}
    return any(root and int(model.body_dofnum[root]) > 0 for root in roots)


def _shape(model: mujoco.MjModel, geom: int) -> tuple[Shape, Pose] | None:
    """Return a geom's shape with its pose in the world frame of the scene file, or None if the geom is a mesh.

    A plane becomes a box below the plane.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    pose = Pose(np.array(data.geom_xpos[geom]), np.array(data.geom_xmat[geom]).reshape(3, 3))
    x, y, z = (float(value) for value in model.geom_size[geom])
    kinds = mujoco.mjtGeom
    if int(model.geom_type[geom]) == int(kinds.mjGEOM_PLANE):
        below = Pose(np.array([0.0, 0.0, -PLANE_DEPTH_M / 2.0]))
        return Box(2.0 * x or PLANE_M, 2.0 * y or PLANE_M, PLANE_DEPTH_M), pose @ below
    shapes: dict[int, Shape] = {
        int(kinds.mjGEOM_BOX): Box(2.0 * x, 2.0 * y, 2.0 * z),
        int(kinds.mjGEOM_SPHERE): Sphere(x),
        int(kinds.mjGEOM_CYLINDER): Cylinder(2.0 * y, x),
    }
    shape = shapes.get(int(model.geom_type[geom]))
    return None if shape is None else (shape, pose)
