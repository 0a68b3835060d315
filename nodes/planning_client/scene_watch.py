"""Watch the planning scene and the plans of move_group in a thread, for the browser view."""

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from moveit_msgs.msg import CollisionObject, DisplayTrajectory, PlanningScene
from moveit_msgs.srv import GetPlanningScene
from rclpy.task import Future
from rclpy.time import Duration

from hal.types import FloatArray
from nodes.clients.client_node import WatchingNode
from nodes.planning.conversion.poses import pose_of
from nodes.planning.conversion.shapes import shapes_of
from nodes.planning.request_errors import REFUSALS
from nodes.planning_client.scenes import OBJECTS
from nodes.publishing import LATCHED
from planning.scene import Pose, Shape

PERIOD_S: Final = 0.5
"""Period of requests for the scene while it changes, in seconds."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneItem:
    """An object of the planning scene."""

    name: str
    link: str
    """Link that holds the object, or empty for a world object."""
    shapes: tuple[tuple[Shape, Pose], ...]
    """Shapes with their poses in the planning frame or, for an attached object, in the frame of the link."""


@dataclass(frozen=True, slots=True, eq=False)
class ShownPlan:
    """A planned motion."""

    joints: tuple[str, ...]
    times_s: FloatArray
    """Times (m,) from the start, in seconds."""
    positions: FloatArray
    """Positions (m, joints), in rad or m."""


@dataclass(frozen=True, slots=True, eq=False)
class WatchedScene:
    """The latest scene and the latest plan. Each change of the scene or plan creates a new object."""

    items: tuple[SceneItem, ...] = ()
    plan: ShownPlan | None = None


@dataclass(slots=True)
class SceneWatch:
    """Watches move_group if it is running. ``newest`` may be read from any thread."""

    newest: WatchedScene = field(default_factory=WatchedScene)
    namespace: str = ""
    """Namespace of move_group, or empty for the root namespace."""
    _is_new: bool = True
    """Whether the scene has changed since the last request."""
    _answer: Future | None = None
    _watching: WatchingNode | None = None
    _client: Any = None

    def start(self) -> None:
        """Start watching, in a separate thread and ROS context."""
        self._watching = WatchingNode("servoloop_view", self.namespace)
        node = self._watching.node
        node.create_subscription(PlanningScene, "monitored_planning_scene", self._on_scene, 10)
        node.create_subscription(DisplayTrajectory, "display_planned_path", self._on_plan, LATCHED)
        self._client = node.create_client(GetPlanningScene, "get_planning_scene")
        node.create_timer(PERIOD_S, self._request)
        self._watching.start()

    def close(self) -> None:
        """Stop watching."""
        if self._watching is not None:
            self._watching.close()

    def _on_scene(self, message: PlanningScene) -> None:
        has_objects = message.world.collision_objects or message.robot_state.attached_collision_objects
        self._is_new = self._is_new or not message.is_diff or bool(has_objects)

    def _on_plan(self, message: DisplayTrajectory) -> None:
        self.newest = WatchedScene(self.newest.items, plan_of(message))

    def _request(self) -> None:
        """Request the scene if it has changed. If a response is lost, the scene is requested again after the next
        change."""
        if self._is_new and self._client.service_is_ready():
            if self._answer is not None:
                self._client.remove_pending_request(self._answer)
            self._is_new = False
            self._answer = self._client.call_async(OBJECTS)
            self._answer.add_done_callback(self._on_answer)

    def _on_answer(self, answer: Future) -> None:
        if answer.result() is not None:
            self.newest = WatchedScene(items_of(answer.result().scene), self.newest.plan)


def items_of(scene: PlanningScene) -> tuple[SceneItem, ...]:
    """Return the objects of a scene. Objects that cannot be displayed are omitted."""
    world = [("", item) for item in scene.world.collision_objects]
    held = [(one.link_name, one.object) for one in scene.robot_state.attached_collision_objects]
    return tuple(found for link, item in (*world, *held) if (found := _item(item, link)) is not None)


def _item(item: CollisionObject, link: str) -> SceneItem | None:
    try:
        place = pose_of(item.pose)
        shapes = tuple((shape, place @ own) for shape, own in shapes_of(item))
    except REFUSALS:
        return None
    return SceneItem(item.id, link, shapes)


def plan_of(message: DisplayTrajectory) -> ShownPlan | None:
    """Return the last part of a displayed plan, or None if that part has no points or a point lacks a finite position
    for a joint."""
    trajectories = [one.joint_trajectory for one in message.trajectory if one.joint_trajectory.points]
    if not trajectories:
        return None
    joints, points = trajectories[-1].joint_names, trajectories[-1].points
    if any(len(point.positions) != len(joints) for point in points):
        return None
    times_s = np.array([Duration.from_msg(point.time_from_start).nanoseconds * 1e-9 for point in points])
    positions = np.array([point.positions for point in points])
    return ShownPlan(tuple(joints), times_s, positions) if np.isfinite(positions).all() else None
