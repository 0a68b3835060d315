"""Changes of the planning scene that clients send: objects, attached objects and whole scenes."""

from collections.abc import Callable, Iterable
from dataclasses import replace

from moveit_msgs.msg import AttachedCollisionObject, CollisionObject, PlanningScene
from std_msgs.msg import Header

from nodes.planning.conversion.allowed import AllowedCollisions
from nodes.planning.conversion.frames import Frames, link_point
from nodes.planning.conversion.poses import is_identity, pose_message, pose_of
from nodes.planning.conversion.semantic import robot_name
from nodes.planning.conversion.shapes import centered, copied, has_shapes, joined, shapes_of, with_shape_poses
from nodes.planning.request_errors import RequestError
from nodes.planning.world import PlanningWorld
from planning.motion import State
from planning.robot import PlanningRobot
from planning.scene import Pose, SceneObject


class WorldEdit:
    """A series of changes. ``world`` is the result. If a change is rejected, use the previous world."""

    def __init__(self, robot: PlanningRobot, world: PlanningWorld, state: Callable[[], State | None]) -> None:
        self.world = world
        """The world with all changes so far."""
        self._robot = robot
        self._state = state

    def apply_scene(self, message: PlanningScene) -> None:
        """Apply a scene message: only its changes if ``is_diff`` is set, otherwise the whole scene.

        First, objects are detached, then the objects of the world are changed, and then objects are attached. A single
        message can therefore detach an object and remove it, or remove an object and attach it.

        Raises:
            RequestError, PlanningError: A part of the scene is invalid, or the scene is for a different robot.
        """
        name, own = message.robot_model_name, robot_name(self._robot)
        if name and name != own:
            raise RequestError(
                "INVALID_ROBOT_STATE", f"the scene is for the robot {name}, not for {own}: load a scene for {own}"
            )
        if not message.is_diff:
            self._clear()
        matrix = message.allowed_collision_matrix
        if matrix.entry_names or matrix.default_entry_names:
            self.world = replace(self.world, allowed=AllowedCollisions.from_message(matrix))
        attached = message.robot_state.attached_collision_objects
        loosened = [held for held in attached if held.object.operation == CollisionObject.REMOVE]
        fastened = [held for held in attached if held not in loosened]
        for held in loosened:
            self._change_attached(held)
        for item in message.world.collision_objects:
            replaced = item.operation == CollisionObject.REMOVE and item.id in {held.object.id for held in fastened}
            if not replaced or item.id in self.world.scene.objects:
                self._change_object(item)
        for held in fastened:
            self._change_attached(held)
        self._set_colors_and_padding(message)
        self.world = self.world.settled(self._robot)

    def apply_object(self, message: CollisionObject) -> None:
        """Add a world object, append shapes to it, move it or remove it. Raises RequestError or PlanningError."""
        self._change_object(message)
        self.world = self.world.settled(self._robot)

    def apply_attached(self, message: AttachedCollisionObject) -> None:
        """Attach an object to a link, or detach it. Raises RequestError or PlanningError."""
        self._change_attached(message)
        self.world = self.world.settled(self._robot)

    def _clear(self) -> None:
        scene = self.world.scene
        for name in (*self._robot.objects, *scene.objects, *scene.attached):
            scene = scene.without(name)
        self.world = PlanningWorld(scene, {}, self.world.allowed, self.world.colors, self.world.padding_m)

    def _set_colors_and_padding(self, message: PlanningScene) -> None:
        colors = {color.id: color.color for color in message.object_colors}
        padding = {item.link_name: item.padding for item in message.link_padding}
        for link, padding_m in padding.items():
            if not 0.0 <= padding_m < float("inf"):
                raise RequestError("INVALID_LINK_NAME", f"the padding of {link} is {padding_m} m: send 0 or more")
        self.world = replace(
            self.world, colors={**self.world.colors, **colors}, padding_m={**self.world.padding_m, **padding}
        )

    def _change_object(self, message: CollisionObject) -> None:
        if message.operation == CollisionObject.REMOVE:
            self._remove(message.id)
        elif message.operation == CollisionObject.MOVE:
            self._move(message)
        elif message.operation == CollisionObject.APPEND and message.id in self.world.scene.objects:
            self._append(message)
        elif message.operation in (CollisionObject.ADD, CollisionObject.APPEND):
            self._check_name(message.id)
            own = centered(message)
            self._put(own, self._frames().in_scene(own.header.frame_id) @ pose_of(own.pose))
        else:
            raise RequestError(
                "INVALID_OBJECT_NAME",
                f'object "{message.id}" has the operation {message.operation!r}: use ADD or REMOVE',
            )

    def _put(self, message: CollisionObject, pose: Pose) -> None:
        """Add or replace a world object at a pose in the world frame of the scene."""
        item = SceneObject(message.id, shapes_of(message), pose)
        self._check_subframes(message)
        self.world = replace(
            self.world,
            scene=self.world.scene.with_object(item),
            items={**self.world.items, message.id: self._kept(message, self._robot.frame, self._in_base(pose))},
        )

    def _remove(self, name: str) -> None:
        """Remove an object, or all objects if the name is empty. An attached object with this name stays attached."""
        scene = self.world.scene
        if name in scene.attached:
            return
        removable = [*scene.objects, *(one for one in self._robot.objects if one not in scene.removed)]
        if name and name not in removable:
            raise RequestError("INVALID_OBJECT_NAME", f'there is no object "{name}": {_known(removable)}')
        own = [name] if name else removable
        for one in own:
            scene = scene.without(one)
        items = {key: item for key, item in self.world.items.items() if key not in own}
        self.world = replace(self.world, scene=scene, items=items)

    def _move(self, message: CollisionObject) -> None:
        """Move an object and, if the message contains shape poses, also the shapes within the object. As in MoveIt,
        shapes in the message are ignored."""
        if message.id not in self.world.scene.objects:
            raise RequestError(
                "INVALID_OBJECT_NAME",
                f'there is no object "{message.id}" to move: {_known(self.world.scene.objects)}',
            )
        pose = self._frames().in_scene(message.header.frame_id) @ pose_of(message.pose)
        self._put(with_shape_poses(self.world.items[message.id], message), pose)

    def _append(self, message: CollisionObject) -> None:
        """Add shapes to an object. The object moves to the pose in the message, as in MoveIt."""
        own = centered(message)
        pose = self._frames().in_scene(own.header.frame_id) @ pose_of(own.pose)
        self._put(joined(self.world.items[message.id], own), pose)

    def _change_attached(self, message: AttachedCollisionObject) -> None:
        if message.object.operation == CollisionObject.REMOVE:
            self._detach(message)
        elif message.object.operation == CollisionObject.APPEND and message.object.id in self.world.scene.attached:
            self._append_attached(message)
        elif message.object.operation in (CollisionObject.ADD, CollisionObject.APPEND):
            self._attach(message)
        else:
            raise RequestError(
                "INVALID_OBJECT_NAME", f'attach object "{message.object.id}" with ADD, or detach it with REMOVE'
            )

    def _attach(self, message: AttachedCollisionObject) -> None:
        item, frames = message.object, self._frames()
        point = link_point(self._robot, message.link_name)
        link = point.link if point else message.link_name
        if link not in self._robot.links:
            known = ", ".join(self._robot.links)
            raise RequestError(
                "INVALID_LINK_NAME", f'there is no link "{link}" to attach "{item.id}" to: choose one of {known}'
            )
        if has_shapes(item):
            self._check_name(item.id)
            item = centered(item)
            pose = frames.in_scene(item.header.frame_id) @ pose_of(item.pose)
        elif item.id in self.world.scene.objects:
            item, pose = self.world.items[item.id], self.world.scene.objects[item.id].pose
        elif item.id in self.world.scene.attached:
            item, pose = self.world.items[item.id], frames.in_scene(item.id)
        else:
            raise RequestError(
                "INVALID_OBJECT_NAME",
                f'there is no object "{item.id}" to attach: send its shapes; {_known(self.world.items)}',
            )
        self._hold(item, link, frames.in_scene(link).inverse() @ pose, message.touch_links)

    def _append_attached(self, message: AttachedCollisionObject) -> None:
        """Add shapes and touch links to an attached object. As in MoveIt, the object keeps its pose if the message does
        not contain one."""
        item, frames, held = message.object, self._frames(), self.world.scene.attached[message.object.id]
        pose = held.item.pose
        if not is_identity(item.pose):
            pose = frames.in_scene(held.link).inverse() @ frames.in_scene(item.header.frame_id) @ pose_of(item.pose)
        self._hold(joined(self.world.items[item.id], item), held.link, pose, held.touch_links | {*message.touch_links})

    def _hold(self, item: CollisionObject, link: str, pose: Pose, touch_links: Iterable[str]) -> None:
        """Attach an object at a pose relative to a link."""
        shapes = shapes_of(item)
        self._check_subframes(item)
        scene = self.world.scene.attach(SceneObject(item.id, shapes, pose), link, touch_links)
        self.world = replace(self.world, scene=scene, items={**self.world.items, item.id: self._kept(item, link, pose)})

    def _detach(self, message: AttachedCollisionObject) -> None:
        attached, name = self.world.scene.attached, message.object.id
        point = link_point(self._robot, message.link_name)
        link = point.link if point else message.link_name
        own = [name] if name else [key for key, held in attached.items() if link in ("", held.link)]
        if name and name not in attached:
            known = ", ".join(attached) or "none"
            raise RequestError("INVALID_OBJECT_NAME", f'"{name}" is not attached; attached objects: {known}')
        if name and link not in ("", attached[name].link):
            raise RequestError(
                "INVALID_LINK_NAME",
                f'"{name}" is attached to {attached[name].link}, not to {message.link_name}: omit the link',
            )
        for one in own:
            self._put(self.world.items[one], self._frames().in_scene(one))

    def _kept(self, message: CollisionObject, frame: str, pose: Pose) -> CollisionObject:
        kept = copied(message)
        kept.header, kept.pose, kept.operation = Header(frame_id=frame), pose_message(pose), CollisionObject.ADD
        return kept

    def _check_name(self, name: str) -> None:
        if not name:
            raise RequestError("INVALID_OBJECT_NAME", "an object has no id: give the object an id")
        if name in self._robot.links or name in self._robot.description.links:
            raise RequestError("INVALID_OBJECT_NAME", f'"{name}" is a link of the robot: give the object another id')

    def _check_subframes(self, message: CollisionObject) -> None:
        if len(message.subframe_names) != len(message.subframe_poses):
            text = "has different numbers of subframe names and poses: send one pose for each name"
            raise RequestError("INVALID_OBJECT_NAME", f'object "{message.id}" {text}')
        for pose in message.subframe_poses:
            pose_of(pose)

    def _in_base(self, pose: Pose) -> Pose:
        return self._robot.origin.inverse() @ pose

    def _frames(self) -> Frames:
        return Frames(self._robot, self._state(), self.world.scene, self.world.items)


def _known(names: Iterable[str]) -> str:
    return f"known objects: {', '.join(names) or 'none'}"
