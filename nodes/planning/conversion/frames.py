"""Poses of the frames that requests refer to: links, objects and their subframes."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from moveit_msgs.msg import CollisionObject

from hal.robot_description.kinematics import child_pose
from nodes.planning.conversion.poses import pose_of
from nodes.planning.request_errors import RequestError
from planning.motion import State
from planning.planning_errors import PlanningError
from planning.robot import PlanningRobot
from planning.scene import Pose, Scene


@dataclass(frozen=True, slots=True)
class LinkPoint:
    """A frame that is fixed to a link in the planning model."""

    link: str
    pose: Pose
    """Pose of the frame relative to this link."""


class Frames:
    """Frames of the robot in one state, with the objects around the robot. If the state is unknown, only fixed frames
    are available."""

    def __init__(
        self,
        robot: PlanningRobot,
        state: State | None,
        scene: Scene,
        items: Mapping[str, CollisionObject] | None = None,
    ) -> None:
        self._robot = robot
        self._state = state
        self._scene = scene
        self._items = items or {}

    @property
    def held(self) -> tuple[str, ...]:
        """Names of the attached objects."""
        return tuple(self._scene.attached)

    def in_scene(self, name: str) -> Pose:
        """Return the pose of a frame in the world of the scene. An empty name means the planning frame.

        Raises:
            RequestError: The frame does not exist. The error message lists the existing frames.
        """
        name = name.removeprefix("/")
        point = self.point(name)
        if point is not None:
            return self._known(point.link) @ point.pose
        owner, subframe = self._subframe(name)
        return self._known(owner) @ subframe

    def in_base(self, name: str) -> Pose:
        """Return the pose of a frame in the planning frame. Raises RequestError."""
        return self._robot.origin.inverse() @ self.in_scene(name)

    def point(self, name: str) -> LinkPoint | None:
        """Return a frame relative to the link with which it moves, or None for links and for world frames.

        The frame is a link that exists only in the URDF, an attached object or a subframe of such an object.
        """
        if (point := link_point(self._robot, name)) is not None:
            return point
        owner, subframe = self._subframe(name)
        held = self._scene.attached.get(owner)
        return LinkPoint(held.link, held.item.pose @ subframe) if held is not None else None

    def _subframe(self, name: str) -> tuple[str, Pose]:
        """Return the object to which a subframe belongs, and the pose of the subframe in this object. Other names are
        returned unchanged."""
        owner, slash, subframe = name.partition("/")
        names = list(getattr(self._items.get(owner), "subframe_names", ()))
        if not slash or subframe not in names:
            return name, Pose()
        return owner, pose_of(self._items[owner].subframe_poses[names.index(subframe)])

    def _known(self, name: str) -> Pose:
        if (
            self._state is None
            and name != self._robot.frame
            and (name in self._robot.links or name in self._scene.attached)
        ):
            raise RequestError(
                "ROBOT_STATE_STALE", f"the pose of {name} is unknown without /joint_states: start the stack"
            )
        try:
            return self._robot.frame_pose(name, self._state or self._robot.rest, self._scene)
        except PlanningError as error:
            raise RequestError("FRAME_TRANSFORM_FAILURE", str(error)) from None


def link_point(robot: PlanningRobot, name: str) -> LinkPoint | None:
    """Return the pose of a link that exists only in the URDF, relative to a link of the planning model, or None for
    other links."""
    parents = {joint.child: joint for joint in robot.description.joints.values()}
    pose, link = Pose(), name
    while link not in robot.links:
        joint = parents.get(link)
        if joint is None or joint.kind != "fixed":
            return None
        pose = Pose.from_quaternion(*child_pose(joint, 0.0)) @ pose
        link = joint.parent
    return None if link == name else LinkPoint(link, Pose(np.array(pose.position_m), pose.matrix))
