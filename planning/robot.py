"""A robot for planning: its scene, driven joints, groups, and pairs of links that may touch."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from hal.robot_description.description import Description
from hal.types import FloatArray, JointLimits
from planning.arm_model import ArmModel, Pair
from planning.collision import CONTACT_M, Collisions
from planning.group_planner import GroupPlanner
from planning.groups import Group, Groups
from planning.motion import State, Touch, Validity
from planning.planning_errors import PlanningError
from planning.scene import Pose, Scene
from planning.world_objects import world_objects


class PlanningRobot:
    """Data shared by all plans for one robot.

    The object never changes, and several threads may use it. OMPL's random number generator is global in a process, so
    only one thread at a time may run ``GroupPlanner.plan``. Link poses are relative to ``frame``, the body on which the
    arm is mounted. Object poses in a ``Scene`` are in the world frame of the scene file. ``origin`` is the pose of
    ``frame`` in this world frame.

    Args:
        model: Compiled scene (mujoco.MjModel), which this object keeps.
        description: Robot description.
        limits: Limits of all driven joints, keyed by name.
        groups: Groups, end effectors and named states.
        allowed: Pairs of links that may touch. Adjacent links may always touch each other.

    Raises:
        PlanningError: A joint is missing from the scene.
    """

    def __init__(
        self,
        model: Any,
        description: Description,
        limits: Mapping[str, JointLimits],
        groups: Groups,
        allowed: Iterable[Pair] = (),
    ) -> None:
        self.model: Any = model
        self.description = description
        self.limits = dict(limits)
        """Limits of all driven joints, keyed by name, in the order used by all states."""
        self.groups = groups
        arm = self.arm()
        self.links = arm.links
        """Names of the robot's links."""
        self.objects = tuple(arm.world_geoms())
        """Names of all objects in the scene file, including objects with shapes that ``scene`` does not support."""
        root = int(model.body_rootid[arm.bodies[0]])
        self.frame = str(model.body(root).name)
        """Frame relative to which link poses are given."""
        self.origin = Pose(*arm.link_pose(self.frame))
        """Pose of ``frame`` in the world of the scene."""
        own = world_objects(arm)
        self.scene = Scene(objects=own, allowed=frozenset(allowed), removed=frozenset(own))
        """Scene with the objects from the scene file, from which all other scenes are derived."""
        self.rest: State = dict(zip(self.limits, arm.positions.tolist(), strict=True))
        """Positions of the driven joints in the scene file."""
        self._planners = {
            name: GroupPlanner(model, self.limits, self._driven(group)) for name, group in groups.groups.items()
        }

    def group(self, name: str) -> GroupPlanner:
        """Return the planner of a group. Raises PlanningError."""
        return self._planners[self.groups.group(name).name]

    def arm(self) -> ArmModel:
        """Return a model of the robot in which all driven joints are planned joints."""
        return ArmModel(self.model, self.limits)

    def state(self, positions: Mapping[str, float]) -> dict[str, float]:
        """Check positions that a client sent, and return the state of the driven joints.

        Mimic joints and other joints that are not driven are omitted.

        Raises:
            PlanningError: A driven joint is missing, a joint does not exist, or a position is not finite.
        """
        for name, position in positions.items():
            if name not in self.description.joints:
                raise PlanningError(
                    "INVALID_ROBOT_STATE", f"there is no joint {name}: choose from {', '.join(self.limits)}"
                )
            if not math.isfinite(position):
                raise PlanningError(
                    "INVALID_ROBOT_STATE", f"the position of {name} is {position}: send a finite number"
                )
        for name in self.limits:
            if name not in positions:
                raise PlanningError("INVALID_ROBOT_STATE", f"the state has no position for {name}: add the position")
        return {name: float(positions[name]) for name in self.limits}

    def link_poses(self, links: Sequence[str], state: State) -> dict[str, Pose]:
        """Return the poses of links relative to ``frame``. Raises PlanningError for an unknown link."""
        arm, back = self._placed(state), self.origin.inverse()
        return {link: back @ Pose(*arm.link_pose(link)) for link in links}

    def carried_links(self, link: str) -> tuple[str, ...]:
        """Return a link and all links that move with it. Raises PlanningError for an unknown link."""
        arm = self.arm()
        carried = {arm.body(link)}
        for body in arm.bodies:  # a parent precedes its children
            if int(self.model.body_parentid[body]) in carried:
                carried.add(body)
        return tuple(name for name, body in zip(arm.links, arm.bodies, strict=True) if body in carried)

    def frame_pose(self, name: str, state: State, scene: Scene | None = None) -> Pose:
        """Return the pose of a frame in the world of the scene.

        Args:
            name: A link, an object of the scene, an attached object, or "world". An empty name means ``frame``.
            state: Positions of all driven joints.
            scene: Scene with the objects. If None, the scene contains no objects.

        Raises:
            PlanningError: The frame does not exist. The message lists the existing frames.
        """
        scene = scene or self.scene
        if not name:
            return self.origin
        if name in self.links:
            return Pose(*self._placed(state).link_pose(name))
        if name in scene.objects:
            return scene.objects[name].pose
        if name in scene.attached:
            held = scene.attached[name]
            return Pose(*self._placed(state).link_pose(held.link)) @ held.item.pose
        if name == "world":
            return Pose()
        known = ", ".join((*self.links, *scene.objects, *scene.attached, "world"))
        raise PlanningError("FRAME_TRANSFORM_FAILURE", f'there is no frame "{name}": choose one of {known}')

    def validity(self, state: State, scene: Scene, group: str = "") -> Validity:
        """Check a state for contacts and limits.

        Args:
            state: Positions of all driven joints.
            scene: Objects and pairs that may touch.
            group: Group whose joint limits are checked, and whose links and attached objects are checked for contacts.
                If empty, the whole robot is checked.

        Raises:
            PlanningError: The group does not exist, or the scene has an error.
        """
        arm = self.arm()
        joints = self.groups.group(group).joints if group else arm.joints
        positions = np.array([state[joint] for joint in arm.joints])
        collisions = Collisions(arm, scene)
        near = collisions.nearer(positions, CONTACT_M)
        moved = self._moved_by(joints, scene) if group else None
        touches = tuple(Touch(*pair, one) for one, pair in near if moved is None or not moved.isdisjoint(pair))
        outside = next((text for joint in joints if (text := self._outside(joint, state[joint]))), "")
        return Validity(touches, outside, collisions.clearance(positions).distance_m)

    def _moved_by(self, joints: Iterable[str], scene: Scene) -> frozenset[str]:
        """Return the links that the given joints and their mimic joints move, and the objects attached to these
        links."""
        leaders = set(joints)
        followers = {
            name for name, joint in self.description.joints.items() if joint.mimic and joint.mimic.joint in leaders
        }
        children = [self.description.joints[name].child for name in leaders | followers]
        links = {link for child in children for link in self.carried_links(child)}
        return frozenset(links | {name for name, held in scene.attached.items() if held.link in links})

    def _outside(self, joint: str, position: float) -> str:
        limit = self.limits[joint]
        if limit.lower <= position <= limit.upper:
            return ""
        return f"{joint} is at {position:.4f}, outside its limits {limit.lower:.4f} to {limit.upper:.4f}"

    def _placed(self, state: State) -> ArmModel:
        arm = self.arm()
        arm.set(_vector(state, arm.joints))
        return arm

    def _driven(self, group: Group) -> Group:
        for joint in group.joints:
            if joint not in self.limits:
                known = ", ".join(self.limits)
                raise PlanningError(
                    "INVALID_GROUP_NAME", f"{joint} of group {group.name} is not driven: use only joints of {known}"
                )
        return group


def _vector(state: State, joints: Sequence[str]) -> FloatArray:
    return np.array([float(state[joint]) for joint in joints])
