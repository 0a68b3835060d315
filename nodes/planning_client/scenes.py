"""Create messages that change the planning scene."""

from collections.abc import Sequence
from typing import Final

from geometry_msgs.msg import Point
from moveit_msgs.msg import AttachedCollisionObject, CollisionObject, PlanningScene, PlanningSceneComponents
from moveit_msgs.srv import GetPlanningScene
from shape_msgs.msg import Mesh as MeshMessage
from shape_msgs.msg import MeshTriangle, SolidPrimitive

from hal.rotations import quaternions
from nodes.planning_client.goals import pose_message
from planning.scene import Box, Cone, Cylinder, Mesh, Pose, SceneObject, Shape, Sphere

OBJECTS: Final = GetPlanningScene.Request(
    components=PlanningSceneComponents(
        components=PlanningSceneComponents.WORLD_OBJECT_NAMES
        | PlanningSceneComponents.WORLD_OBJECT_GEOMETRY
        | PlanningSceneComponents.ROBOT_STATE
        | PlanningSceneComponents.ROBOT_STATE_ATTACHED_OBJECTS
    )
)
"""Request for all objects."""
_SOLIDS: Final[dict[type[Shape], int]] = {
    Box: SolidPrimitive.BOX,
    Cylinder: SolidPrimitive.CYLINDER,
    Cone: SolidPrimitive.CONE,
    Sphere: SolidPrimitive.SPHERE,
}


def object_message(item: SceneObject, frame: str) -> CollisionObject:
    """Return a message that adds an object or replaces the object with the same name.

    Args:
        item: Object with its pose in ``frame``.
        frame: Frame of the pose, or empty for the planning frame.
    """
    message = CollisionObject(id=item.name, operation=CollisionObject.ADD)
    message.header.frame_id = frame
    message.pose = _pose(item.pose)
    for shape, pose in item.shapes:
        if isinstance(shape, Mesh):
            message.meshes.append(_mesh(shape))
            message.mesh_poses.append(_pose(pose))
        else:
            message.primitives.append(SolidPrimitive(type=_SOLIDS[type(shape)], dimensions=list(shape.sides_m())))
            message.primitive_poses.append(_pose(pose))
    return message


def removal(name: str, *, is_attached: bool) -> PlanningScene:
    """Return a scene change that removes an object. MoveIt moves a detached object into the world, so the change also
    removes the object from the world."""
    gone = CollisionObject(id=name, operation=CollisionObject.REMOVE)
    return change([gone], [AttachedCollisionObject(object=gone)] if is_attached else [])


def change(objects: Sequence[CollisionObject], attached: Sequence[AttachedCollisionObject] = ()) -> PlanningScene:
    """Return a scene change."""
    scene = PlanningScene(is_diff=True)
    scene.robot_state.is_diff = True
    scene.world.collision_objects = list(objects)
    scene.robot_state.attached_collision_objects = list(attached)
    return scene


def _pose(pose: Pose) -> object:
    return pose_message(pose.position_m.tolist(), quaternions(pose.matrix).tolist())


def _mesh(shape: Mesh) -> MeshMessage:
    points = [Point(x=x, y=y, z=z) for x, y, z in shape.vertices_m.tolist()]
    return MeshMessage(
        vertices=points, triangles=[MeshTriangle(vertex_indices=three) for three in shape.triangles.tolist()]
    )
