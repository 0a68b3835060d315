"""Messages for the node move_group: goals of the arm, straight lines, and changes of the planning scene."""

from collections.abc import Sequence
from typing import Any, Final

from geometry_msgs.msg import Point, Pose, Quaternion
from moveit_msgs.action import MoveGroup
from moveit_msgs.msg import (
    AttachedCollisionObject,
    CollisionObject,
    Constraints,
    JointConstraint,
    MoveItErrorCodes,
    OrientationConstraint,
    PlanningScene,
    PlanningSceneComponents,
    PositionConstraint,
)
from moveit_msgs.srv import GetCartesianPath, GetPlanningScene
from shape_msgs.msg import SolidPrimitive

from pick_place.pose_settings import PoseSettings, ToolPose

JOINT_TOLERANCE_RAD: Final = 1e-3
POSITION_TOLERANCE_M: Final = 1e-3
ORIENTATION_TOLERANCE_RAD: Final = 1e-2
LINE_STEP_M: Final = 2e-3
"""Distance between the poses for which a straight line is computed, in m."""
ATTEMPTS: Final = 3
OBJECTS: Final = GetPlanningScene.Request(
    components=PlanningSceneComponents(
        components=PlanningSceneComponents.WORLD_OBJECT_NAMES
        | PlanningSceneComponents.ROBOT_STATE
        | PlanningSceneComponents.ROBOT_STATE_ATTACHED_OBJECTS
    )
)
"""Request for the names of all objects."""
_CODES: Final = {
    getattr(MoveItErrorCodes, name): name
    for name in vars(type(MoveItErrorCodes))
    if name.isupper() and isinstance(getattr(MoveItErrorCodes, name), int)
}


def error_text(code: MoveItErrorCodes) -> str:
    """Return the name of an error code with its message, if it has one."""
    name = _CODES.get(code.val, f"error code {code.val}")
    return f"{name}: {code.message}" if code.message else f"{name}; the log of move_group may contain the reason"


def joint_goal(settings: PoseSettings, positions_rad: Sequence[float]) -> MoveGroup.Goal:
    """Return the goal of a motion to joint positions."""
    tolerance = {"tolerance_above": JOINT_TOLERANCE_RAD, "tolerance_below": JOINT_TOLERANCE_RAD}
    constraints = [
        JointConstraint(joint_name=joint, position=position, weight=1.0, **tolerance)
        for joint, position in zip(settings.joints, positions_rad, strict=True)
    ]
    return _goal(settings, Constraints(joint_constraints=constraints))


def pose_goal(settings: PoseSettings, pose: ToolPose) -> MoveGroup.Goal:
    """Return the goal of a motion of the tool to a pose."""
    target = pose_message(pose)
    position = PositionConstraint(link_name=settings.tool_link, weight=1.0)
    position.header.frame_id = settings.frame
    position.constraint_region.primitives = [
        SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[POSITION_TOLERANCE_M])
    ]
    position.constraint_region.primitive_poses = [Pose(position=target.position, orientation=Quaternion(w=1.0))]
    orientation = OrientationConstraint(
        link_name=settings.tool_link,
        orientation=target.orientation,
        absolute_x_axis_tolerance=ORIENTATION_TOLERANCE_RAD,
        absolute_y_axis_tolerance=ORIENTATION_TOLERANCE_RAD,
        absolute_z_axis_tolerance=ORIENTATION_TOLERANCE_RAD,
        weight=1.0,
    )
    orientation.header.frame_id = settings.frame
    return _goal(settings, Constraints(position_constraints=[position], orientation_constraints=[orientation]))


def _goal(settings: PoseSettings, constraints: Constraints) -> MoveGroup.Goal:
    goal = MoveGroup.Goal()
    request = goal.request
    request.group_name, request.goal_constraints = settings.group, [constraints]
    request.num_planning_attempts, request.allowed_planning_time = ATTEMPTS, settings.planning_time_s
    request.max_velocity_scaling_factor = request.max_acceleration_scaling_factor = settings.speed
    request.start_state.is_diff = True
    goal.planning_options.planning_scene_diff.is_diff = True
    goal.planning_options.planning_scene_diff.robot_state.is_diff = True
    return goal


def line(settings: PoseSettings, pose: ToolPose) -> GetCartesianPath.Request:
    """Return the request of a straight line from the present pose of the tool to ``pose``."""
    request = GetCartesianPath.Request(
        group_name=settings.group,
        link_name=settings.tool_link,
        waypoints=[pose_message(pose)],
        max_step=LINE_STEP_M,
        avoid_collisions=True,
        max_velocity_scaling_factor=settings.speed,
        max_acceleration_scaling_factor=settings.speed,
    )
    request.header.frame_id = settings.frame
    request.start_state.is_diff = True
    return request


def laid(settings: PoseSettings) -> PlanningScene:
    """Return the change of the scene that adds the object at its place before the pick."""
    return _change(objects=[_object(settings)])


def attached(settings: PoseSettings) -> PlanningScene:
    """Return the change of the scene that attaches the object to the tool. It is at its place before the pick."""
    touch_links = list(settings.target.touch_links)
    held = AttachedCollisionObject(link_name=settings.tool_link, object=_object(settings), touch_links=touch_links)
    return _change(held=[held])


def removed(settings: PoseSettings, *, attached: bool) -> PlanningScene:
    """Return the change of the scene that removes the object, which can be attached to the tool."""
    gone = CollisionObject(id=settings.target.name, operation=CollisionObject.REMOVE)
    held = [AttachedCollisionObject(link_name=settings.tool_link, object=gone)] if attached else []
    return _change(objects=[gone], held=held)


def _object(settings: PoseSettings) -> CollisionObject:
    target = settings.target
    item = CollisionObject(id=target.name, operation=CollisionObject.ADD)
    item.header.frame_id = settings.frame
    item.pose = pose_message((*target.position_m, 0.0, 0.0, 0.0, 1.0))
    item.primitives = [SolidPrimitive(type=SolidPrimitive.BOX, dimensions=list(target.size_m))]
    item.primitive_poses = [Pose(orientation=Quaternion(w=1.0))]
    return item


def _change(objects: Sequence[Any] = (), held: Sequence[Any] = ()) -> PlanningScene:
    scene = PlanningScene(is_diff=True)
    scene.robot_state.is_diff = True
    scene.world.collision_objects = list(objects)
    scene.robot_state.attached_collision_objects = list(held)
    return scene


def pose_message(pose: ToolPose) -> Pose:
    """Return a pose as a message."""
    x, y, z, *quaternion = pose
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(**dict(zip("xyzw", quaternion, strict=True))))
