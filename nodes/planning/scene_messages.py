"""Convert the planning scene to a message, as a whole or in parts."""

from moveit_msgs.msg import LinkPadding, LinkScale, ObjectColor, PlanningScene, PlanningSceneComponents

from nodes.planning.conversion.semantic import robot_name
from nodes.planning.conversion.shapes import without_shapes
from nodes.planning.states import attached_messages, joint_message
from nodes.planning.world import PlanningWorld
from planning.motion import State
from planning.robot import PlanningRobot

PARTS = PlanningSceneComponents


def scene_message(
    robot: PlanningRobot, world: PlanningWorld, state: State | None, parts: int = 0, is_diff: bool = False
) -> PlanningScene:
    """Return a message for the scene.

    Args:
        robot: The robot.
        world: The scene.
        state: Positions of all driven joints, or None if they are unknown.
        parts: Sum of PlanningSceneComponents values, or 0 for all components.
        is_diff: Whether the message contains only the robot state, as a change.
    """
    message = PlanningScene(robot_model_name=robot_name(robot), is_diff=is_diff)
    message.robot_state.is_diff = state is None or is_diff
    if state is not None and _has(parts, PARTS.ROBOT_STATE | PARTS.ROBOT_STATE_ATTACHED_OBJECTS):
        message.robot_state.joint_state = joint_message(robot, state)
    if is_diff:
        return message
    if _has(parts, PARTS.ROBOT_STATE_ATTACHED_OBJECTS):
        message.robot_state.attached_collision_objects = attached_messages(world.scene, world)
    if _has(parts, PARTS.WORLD_OBJECT_GEOMETRY):
        message.world.collision_objects = [world.items[name] for name in world.scene.objects]
    elif _has(parts, PARTS.WORLD_OBJECT_NAMES):
        message.world.collision_objects = [without_shapes(world.items[name]) for name in world.scene.objects]
    if _has(parts, PARTS.ALLOWED_COLLISION_MATRIX):
        message.allowed_collision_matrix = world.allowed.message(world.names(robot))
    if _has(parts, PARTS.LINK_PADDING_AND_SCALING):
        message.link_padding = [
            LinkPadding(link_name=link, padding=float(world.padding_m.get(link, 0.0))) for link in robot.links
        ]
        message.link_scale = [LinkScale(link_name=link, scale=1.0) for link in robot.links]
    if _has(parts, PARTS.OBJECT_COLORS):
        message.object_colors = [ObjectColor(id=name, color=color) for name, color in world.colors.items()]
    return message


def _has(parts: int, wanted: int) -> bool:
    return not parts or bool(parts & wanted)
