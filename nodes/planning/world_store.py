"""The server's planning scene, its topics, and the functions that change it."""

from collections.abc import Callable
from typing import Final

from moveit_msgs.msg import AttachedCollisionObject, CollisionObject, PlanningScene
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile

from drivers.printable import printable_line
from nodes.planning.edits import WorldEdit
from nodes.planning.joint_monitor import JointMonitor
from nodes.planning.request_errors import REFUSALS, RequestError, crash
from nodes.planning.requests import Snapshot
from nodes.planning.scene_messages import scene_message
from nodes.planning.world import first_world
from planning.motion import State
from planning.robot import PlanningRobot

CHANGES: Final = QoSProfile(depth=100)
"""QoS profile for the topics that change the scene, so that no object in a burst is lost."""
STATE_S: Final = 0.25
"""Period at which the robot state is published on /monitored_planning_scene, in seconds."""

Change = Callable[[WorldEdit], None]


class WorldStore:
    """The current scene. All methods must be called from the executor thread."""

    def __init__(self, node: Node, robot: PlanningRobot, joints: JointMonitor) -> None:
        self.world = first_world(robot)
        """The current scene. The world object itself never changes."""
        self.listeners: list[Callable[[], None]] = []
        """Functions to call after each change."""
        self._robot = robot
        self._joints = joints
        self._log = node.get_logger()
        self._published: State = {}
        group = ReentrantCallbackGroup()
        self._scenes = node.create_publisher(PlanningScene, "monitored_planning_scene", CHANGES)
        for kind, topic, change in (
            (PlanningScene, "planning_scene", self._on_scene),
            (CollisionObject, "collision_object", self._on_object),
            (AttachedCollisionObject, "attached_collision_object", self._on_attached),
        ):
            node.create_subscription(kind, topic, change, CHANGES, callback_group=group)
        node.create_timer(STATE_S, self._publish_state, callback_group=group)

    async def snapshot(self) -> Snapshot:
        """Return the scene and the measured state. Raises RequestError if the state is unknown."""
        await self._joints.wait()
        return Snapshot(self.world, self._joints.state())

    def apply(self, what: str, change: Change) -> str:
        """Apply a scene change completely or not at all. Return the reason if the change was rejected, otherwise ""."""
        edit = WorldEdit(self._robot, self.world, self._state)
        try:
            change(edit)
        except REFUSALS as error:
            self._log.error(printable_line(f"{what} rejected: {error}"))
            return str(error)
        except Exception as error:  # After an error, the server must remain available to the other clients.
            return str(crash(self._log, error).message)
        self.world = edit.world
        self._scenes.publish(scene_message(self._robot, self.world, self._state()))
        for listener in list(self.listeners):
            listener()
        return ""

    def apply_scene(self, message: PlanningScene) -> str:
        """Apply a scene message. Return the reason if the change was refused, or ""."""
        if message.world.octomap.octomap.data:
            self._log.warning("the scene's octomap is ignored: send boxes or meshes instead", once=True)
        return self.apply("a planning scene was", lambda edit: edit.apply_scene(message))

    def _on_scene(self, message: PlanningScene) -> None:
        self.apply_scene(message)

    def _on_object(self, message: CollisionObject) -> None:
        self.apply("a collision object was", lambda edit: edit.apply_object(message))

    def _on_attached(self, message: AttachedCollisionObject) -> None:
        self.apply("an attached object was", lambda edit: edit.apply_attached(message))

    def _state(self) -> State | None:
        """Return the measured state, or None if it is unknown."""
        try:
            return self._joints.state()
        except RequestError:
            return None

    def _publish_state(self) -> None:
        """Publish the robot state if it has changed and a client subscribes to it."""
        state = self._state()
        if state is None or not self._scenes.get_subscription_count() or state == self._published:
            return
        self._published = state
        message = scene_message(self._robot, self.world, state, is_diff=True)
        self._scenes.publish(message)
