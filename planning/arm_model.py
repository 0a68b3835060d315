"""The arm in a MuJoCo scene, for planning: its links, planned joints and geometry.

The arm is the tree of bodies that contains the planned joints. Every other body in the scene, and every geom of the
worldbody, is a world object. A world object is an obstacle in its initial pose, unless the planning scene removes the
object.
"""

import builtins
import math
from collections.abc import Iterable, Mapping
from typing import Any, Final

import mujoco
import numpy as np
from numpy.polynomial import polynomial

from hal.types import FloatArray, JointLimits
from planning.followers import followers
from planning.planning_errors import PlanningError

SLIDE: Final = int(mujoco.mjtJoint.mjJNT_SLIDE)
HINGE: Final = int(mujoco.mjtJoint.mjJNT_HINGE)
Pair = tuple[str, str]
"""Names of two links or objects, in sorted order."""


def pair(one: str, other: str) -> Pair:
    """Return two names in sorted order."""
    return (one, other) if one < other else (other, one)


class ArmModel:
    """The arm in a compiled scene, with its own MuJoCo model and data.

    Args:
        model: Compiled scene (mujoco.MjModel), to which this object keeps a reference.
        limits: Limits of the planned joints, keyed by name. All joint vectors (n,) use the order of the limits. A
            continuous joint has infinite position limits.

    Raises:
        PlanningError: A planned joint is missing, follows another joint, or is neither a hinge nor a slide.
    """

    def __init__(self, model: Any, limits: Mapping[str, JointLimits]) -> None:
        self.model: Any = model
        self.data: Any = mujoco.MjData(model)
        self.joints = tuple(limits)
        """Names of the planned joints (n)."""
        self.limits = tuple(limits.values())
        """Limits of the planned joints (n)."""
        self.followers = followers(model)
        """Mimic joints. A leader precedes its followers."""
        self.joint_ids = tuple(self._planned(name) for name in self.joints)
        """IDs of the planned joints in the model (n)."""
        roots = {int(model.body_rootid[model.jnt_bodyid[joint]]) for joint in self.joint_ids}
        self.bodies = tuple(body for body in range(1, model.nbody) if int(model.body_rootid[body]) in roots)
        """IDs of the arm's bodies. A parent precedes its children."""
        self.links = tuple(str(model.body(body).name) or f"body {body}" for body in self.bodies)
        """Names of the arm's bodies."""
        self._check_joints()
        self._addresses = [int(model.jnt_qposadr[joint]) for joint in self.joint_ids]
        self.lower = np.array([limit.lower for limit in self.limits])
        """Lower position limits (n,), in rad or m."""
        self.upper = np.array([limit.upper for limit in self.limits])
        """Upper position limits (n,), in rad or m."""
        self._follow()
        mujoco.mj_kinematics(self.model, self.data)

    @classmethod
    def from_string(cls, scene: str, limits: Mapping[str, JointLimits]) -> "ArmModel":
        """Read a scene (MJCF or URDF) from a string."""
        return cls(mujoco.MjModel.from_xml_string(scene), limits)

    @property
    def positions(self) -> FloatArray:
        """Current positions of the planned joints (n,), in rad or m."""
        return np.array(self.data.qpos[self._addresses])

    def set(self, positions: FloatArray) -> None:
        """Move the planned joints to positions (n,), in rad or m. Mimic joints follow."""
        self.data.qpos[self._addresses] = positions
        self._follow()
        mujoco.mj_kinematics(self.model, self.data)

    def set_others(self, positions: Mapping[str, float]) -> None:
        """Move joints that are not planned, such as the joints of the hand. Raises PlanningError if a name is
        unknown."""
        for name, position in positions.items():
            self.data.qpos[self.model.jnt_qposadr[self._joint(name)]] = position
        self._follow()
        mujoco.mj_kinematics(self.model, self.data)

    def follower_positions(self) -> dict[str, float]:
        """Return the current positions of the mimic joints, keyed by name, in rad or m."""
        qpos, addresses = self.data.qpos, self.model.jnt_qposadr
        joints = [follower.joint for follower in self.followers]
        return {str(self.model.joint(joint).name): float(qpos[addresses[joint]]) for joint in joints}

    def link_pose(self, link: str) -> tuple[FloatArray, FloatArray]:
        """Return the position (3,) in m and the rotation matrix (3, 3) of a link in the world frame."""
        body = self.body(link)
        return np.array(self.data.xpos[body]), np.array(self.data.xmat[body]).reshape(3, 3)

    def body(self, link: str) -> int:
        """Return the ID of a link's body. Raises PlanningError if the link is unknown."""
        if link not in self.links:
            raise PlanningError(
                "INVALID_LINK_NAME", f'the arm has no link "{link}": choose one of {", ".join(self.links)}'
            )
        return self.bodies[self.links.index(link)]

    def colliding_geoms(self, bodies: Iterable[int]) -> list[int]:
        """Return the geoms of the given bodies that can collide (contype or conaffinity)."""
        wanted, model = set(bodies), self.model
        collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        return [geom for geom in range(model.ngeom) if collides[geom] and int(model.geom_bodyid[geom]) in wanted]

    def link_geoms(self) -> dict[str, list[int]]:
        """Return the collision geoms of each link."""
        return {link: self.colliding_geoms([body]) for link, body in zip(self.links, self.bodies, strict=True)}

    def world_geoms(self) -> dict[str, list[int]]:
        """Return the collision geoms of each world object, which is a body with its children or one geom of the
        worldbody."""
        model, objects = self.model, dict[str, list[int]]()
        for geom in self.colliding_geoms(set(range(model.nbody)) - set(self.bodies)):
            root = int(model.body_rootid[model.geom_bodyid[geom]])
            name = str(model.body(root).name if root else model.geom(geom).name)
            objects.setdefault(name or (f"body {root}" if root else f"geom {geom}"), []).append(geom)
        return objects

    def adjacent(self) -> frozenset[Pair]:
        """Return the pairs of links that are connected by a single joint, directly or through links welded to them.

        Such links may touch each other. MuJoCo also excludes these pairs.
        """
        model, welds = self.model, self.model.body_weldid
        groups = dict[int, list[str]]()
        for body, name in zip(self.bodies, self.links, strict=True):
            groups.setdefault(int(welds[body]), []).append(name)
        pairs: builtins.set[Pair] = builtins.set()
        for weld, children in groups.items():
            parents = groups.get(int(welds[model.body_parentid[weld]]), []) if weld else []
            pairs |= {pair(parent, child) for parent in parents for child in children}
        return frozenset(pairs)

    def everything(self) -> frozenset[Pair]:
        """Return all pairs of links and world objects, so that all contacts in a scene can be ignored."""
        names = [*self.links, *self.world_geoms()]
        return frozenset(pair(one, other) for one in self.links for other in names if one != other)

    def outside(self, positions: FloatArray) -> str:
        """Describe the first joint whose position is not finite or is outside its limits.

        Return "" if there is no such joint.
        """
        for name, position, limit in zip(self.joints, positions, self.limits, strict=True):
            if not math.isfinite(position):
                return f"{name} is at {position}: give a finite position"
            if not limit.lower <= position <= limit.upper:
                return f"{name} is at {position:.4f}, outside its limits {limit.lower:.4f} to {limit.upper:.4f}"
        return ""

    def _follow(self) -> None:
        qpos, start, addresses = self.data.qpos, self.model.qpos0, self.model.jnt_qposadr
        for joint, leader, coefficients in self.followers:
            here, there = addresses[joint], addresses[leader]
            qpos[here] = start[here] + polynomial.polyval(qpos[there] - start[there], coefficients)

    def _joint(self, name: str) -> int:
        joint = int(mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, name))
        if joint < 0:
            known = ", ".join(str(self.model.joint(i).name) for i in range(self.model.njnt))
            raise PlanningError("INVALID_ROBOT_STATE", f'the scene has no joint "{name}": choose one of {known}')
        return joint

    def _planned(self, name: str) -> int:
        joint = self._joint(name)
        for follower in self.followers:
            if follower.joint == joint:
                leader = self.model.joint(follower.leader).name
                raise PlanningError("INVALID_ROBOT_STATE", f"{name} follows {leader}: plan for {leader} instead")
        return joint

    def _check_joints(self) -> None:
        owned = set(self.bodies)
        for joint in range(self.model.njnt):
            if int(self.model.jnt_bodyid[joint]) in owned and int(self.model.jnt_type[joint]) not in (SLIDE, HINGE):
                name = self.model.joint(joint).name
                raise PlanningError(
                    "INVALID_ROBOT_STATE", f"joint {name} of the arm is neither a hinge nor a slide: remove the joint"
                )
