"""Compute the pose of an arm's tool and its Jacobian from the joint positions (forward kinematics)."""

import math
from collections.abc import Container, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from hal.rotations import quaternions, skew
from hal.types import FloatArray, JointLimits
from planning.arm_model import HINGE, SLIDE
from planning.followers import followers_between
from planning.planning_errors import Code, PlanningError


@dataclass(frozen=True, slots=True, eq=False)
class ToolPose:
    """Pose of a frame relative to the base link."""

    position_m: FloatArray
    """Position (3,), in m."""
    quaternion_xyzw: FloatArray
    """Orientation (4,), as a unit quaternion."""


class Chain:
    """Joints between the base link and a tool, which is a body or a site of a MuJoCo model.

    The kinematics are copied from the model, so that a chain has no state and can compute many poses at once. Mimic
    joints between the base and the tool follow the planned joints. All other joints that are not planned remain at
    fixed positions. For k sets of positions, transforms have the shape (k, 4, 4), and Jacobians have the shape
    (k, 6, n). The first three rows of a Jacobian are linear velocities.
    """

    def __init__(
        self,
        model: Any,
        limits: Mapping[str, JointLimits],
        tool: str,
        base: str | None = None,
        others: Mapping[str, float] | None = None,
    ) -> None:
        """Copy the kinematics of a model.

        Args:
            model: The MuJoCo model (mujoco.MjModel). The model is not changed.
            limits: Limits of the planned joints, keyed by name, in the order of all positions.
            tool: Name of a body or a site of the model.
            base: Name of the body in whose frame poses are given. By default, this is the body on which the arm is
                mounted. If the first body of the arm moves, the default is the world.
            others: Positions of joints that are not planned, keyed by name. By default, the model's positions are used.
                Positions of mimic joints that follow a planned joint are ignored.

        Raises:
            PlanningError: A name is not in the model, or a joint does not move the tool relative to the base.
        """
        self.names = tuple(limits)
        """Names of the planned joints."""
        self.limits = tuple(limits.values())
        """Limits of the planned joints."""
        self.tool = tool
        """Name of the tool."""
        self.lower = np.array([limit.lower for limit in self.limits])
        """Lowest positions (n,), in rad or m."""
        self.upper = np.array([limit.upper for limit in self.limits])
        """Highest positions (n,), in rad or m."""
        planned, body = list(_joints(model, self.names).values()), _tool_body(model, tool)
        base_body = _stand(model, body) if base is None else _find(model, "body", base)
        path = _joints_between(model, base_body, body, tool)
        followers = followers_between(model, planned, path)
        leaders = {follower.leader for follower in followers}
        _check_moves(dict(zip(self.names, planned, strict=True)), {*path, *leaders}, tool)
        moved = [*planned, *(follower.joint for follower in followers)]
        self._followers = [(moved.index(joint), moved.index(leader), terms) for joint, leader, terms in followers]
        self._reference = model.qpos0[model.jnt_qposadr[planned]].copy()
        self.turns: NDArray[np.bool_] = model.jnt_type[planned] == HINGE
        """Whether each joint is revolute (n,). The other joints are prismatic."""
        self.periodic: NDArray[np.bool_] = self.turns & [joint not in leaders for joint in planned]
        """Whether the pose of the tool is the same after a full turn of each joint (n,)."""
        data = _reference_pose(model, moved, others or {})
        inverse = np.linalg.inv(_transform(data.xmat[base_body], data.xpos[base_body]))
        place = data.body(body) if _index(model, "body", tool) >= 0 else data.site(tool)
        self._rest = inverse @ _transform(place.xmat, place.xpos)
        joints = [joint for joint in path if joint in moved]
        self._order = [moved.index(joint) for joint in joints]
        """Index of each joint between base and tool (m,) among the planned joints and their mimic joints (v)."""
        axes, anchors = data.xaxis[joints], data.xanchor[joints]
        axes, anchors = axes @ inverse[:3, :3].T, anchors @ inverse[:3, :3].T + inverse[:3, 3]
        turns = model.jnt_type[joints] == HINGE
        self._generators = _generators(axes, anchors, turns)
        self._about = self._generators[0, :, :3, :3]
        self._along = (self._generators[0] + self._generators[2])[:, :3, 3]
        self._axes = axes * turns[:, None]

    def at_frame(self, matrix: FloatArray, position_m: FloatArray) -> "Chain":
        """Return a chain to a frame that is fixed to the tool.

        Args:
            matrix: Orientation of the frame relative to the tool (3, 3).
            position_m: Position of the frame relative to the tool (3,), in m.
        """
        moved = copy(self)
        moved._rest = self._rest @ _transform(matrix, position_m)
        return moved

    def checked(self, positions: FloatArray) -> FloatArray:
        """Check joint positions that a client sent, and return them as an array (n,), in rad or m. The positions may be
        outside the limits.

        Raises:
            PlanningError: A number is missing or not finite.
        """
        found = np.array(positions, dtype=np.float64)
        if found.shape != (len(self.names),):
            raise PlanningError(
                "INVALID_ROBOT_STATE",
                f"{found.size} joint positions were sent for {len(self.names)} joints: send one "
                f"for each of {', '.join(self.names)}",
            )
        for name, position in zip(self.names, found.tolist(), strict=True):
            if not math.isfinite(position):
                raise PlanningError(
                    "INVALID_ROBOT_STATE", f"the position of {name} is {position}: send a finite number"
                )
        return found

    def pose(self, positions: FloatArray) -> ToolPose:
        """Return the pose of the tool at joint positions (n,), in rad or m."""
        return pose_of(self.transforms(np.asarray(positions)[None])[0])

    def transforms(self, positions: FloatArray) -> FloatArray:
        """Return the poses of the tool (k, 4, 4) at several joint positions (k, n)."""
        return np.asarray(self._links(self._offsets(positions))[-1] @ self._rest)

    def transforms_and_jacobians(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the poses of the tool (k, 4, 4) and its Jacobians (k, 6, n) at several joint positions (k, n)."""
        offsets = self._offsets(positions)
        links = self._links(offsets)
        tools = links[-1] @ self._rest
        before = links[:-1].swapaxes(0, 1)
        rotations = before[..., :3, :3]
        seen = rotations.swapaxes(2, 3) @ (tools[:, None, :3, 3] - before[..., :3, 3])[..., None]
        twists = np.zeros((len(positions), len(self._order), 3, 2))
        twists[..., 0] = (self._about @ seen)[..., 0] + self._along
        twists[..., 1] = self._axes
        turned = rotations @ twists
        jacobians = np.zeros((len(positions), 6, offsets.shape[1]))
        jacobians[:, :3, self._order] = turned[..., 0].swapaxes(1, 2)
        jacobians[:, 3:, self._order] = turned[..., 1].swapaxes(1, 2)
        return tools, jacobians @ self._slopes(offsets) if self._followers else jacobians

    def _offsets(self, positions: FloatArray) -> FloatArray:
        """Return the offsets (k, v) of the planned joints and their mimic joints from their reference positions."""
        planned = positions - self._reference
        if not self._followers:
            return np.asarray(planned)
        offsets = np.empty((len(planned), len(self.names) + len(self._followers)))
        offsets[:, : len(self.names)] = planned
        for column, leader, coefficients in self._followers:
            offsets[:, column] = polynomial.polyval(offsets[:, leader], coefficients)
        return offsets

    def _slopes(self, offsets: FloatArray) -> FloatArray:
        """Return the derivatives (k, v, n) of the offsets (k, v) with respect to the planned joints."""
        slopes = np.zeros((*offsets.shape, len(self.names)))
        slopes[:, : len(self.names)] = np.eye(len(self.names))
        for column, leader, coefficients in self._followers:
            slope = polynomial.polyval(offsets[:, leader], polynomial.polyder(coefficients))
            slopes[:, column] = slope[:, None] * slopes[:, leader]
        return slopes

    def _links(self, offsets: FloatArray) -> FloatArray:
        """Return the transforms (m + 1, k, 4, 4) that move the base and each link from their reference poses."""
        moved = offsets[:, self._order, None, None]
        about, again, along = self._generators
        steps = np.sin(moved) * about + (1.0 - np.cos(moved)) * again + moved * along + np.eye(4)
        links = np.empty((len(self._order) + 1, len(offsets), 4, 4))
        links[0] = np.eye(4)
        for joint in range(len(self._order)):
            np.matmul(links[joint], steps[:, joint], out=links[joint + 1])
        return links


def moved_by(model: Any, joints: Sequence[str], tool: str) -> tuple[str, ...]:
    """Return the joints in ``joints`` that move a body or a site of the model, directly or through mimic joints. Raises
    PlanningError if a name is not in the model, or a joint is neither a hinge nor a slide."""
    named, path = _joints(model, joints), _joints_between(model, 0, _tool_body(model, tool), tool)
    leaders = {follower.leader for follower in followers_between(model, named.values(), path)}
    return tuple(name for name, joint in named.items() if joint in {*path, *leaders})


def pose_of(transform: FloatArray) -> ToolPose:
    """Convert a transform (4, 4) to a pose."""
    return ToolPose(transform[:3, 3].copy(), quaternions(transform[:3, :3]))


def _generators(axes: FloatArray, anchors: FloatArray, turns: NDArray[np.bool_]) -> FloatArray:
    """Return the matrices (3, n, 4, 4) by which sin q, 1 - cos q and q of each joint are multiplied."""
    about, again, along = found = np.zeros((3, len(axes), 4, 4))
    cross = skew(axes) * turns[:, None, None]
    about[:, :3, :3], again[:, :3, :3] = cross, cross @ cross
    for part in (about, again):
        part[:, :3, 3] = -np.einsum("nij,nj->ni", part[:, :3, :3], anchors)
    along[:, :3, 3] = axes * ~turns[:, None]
    return found


def _transform(rotation: FloatArray, position: FloatArray) -> FloatArray:
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = np.reshape(rotation, (3, 3)), position
    return found


_CODES: Final[Mapping[str, Code]] = {"body": "INVALID_LINK_NAME", "joint": "INVALID_ROBOT_STATE"}


def _index(model: Any, kind: str, name: str) -> int:
    """Return the index of a body, joint or site, or -1 if the model does not contain the name."""
    try:
        return int(mujoco.mj_name2id(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), name))
    except TypeError:  # The name is not a string.
        return -1


def _find(model: Any, kind: str, name: str) -> int:
    index = _index(model, kind, name)
    if index < 0:
        raise PlanningError(_CODES[kind], f"the model has no {kind} {name}: choose one of {_listed(model, kind)}")
    return index


def _listed(model: Any, *kinds: str) -> str:
    """Return the names of all objects of the given types."""
    counts = {"body": model.nbody, "joint": model.njnt, "site": model.nsite}
    return ", ".join(name for kind in kinds for i in range(counts[kind]) if (name := getattr(model, kind)(i).name))


def _joints(model: Any, names: Iterable[str]) -> dict[str, int]:
    """Return the indices of the planned joints, keyed by name. Raises PlanningError."""
    joints = {name: _find(model, "joint", name) for name in names}
    for name, joint in joints.items():
        if int(model.jnt_type[joint]) not in (HINGE, SLIDE):
            raise PlanningError(
                "INVALID_ROBOT_STATE", f"joint {name} is neither a hinge nor a slide: plan only joints with one axis"
            )
    return joints


def _tool_body(model: Any, tool: str) -> int:
    """Return the body that is the tool or carries the tool's site. Raises PlanningError if the model has no such body
    or site."""
    body, site = _index(model, "body", tool), _index(model, "site", tool)
    if max(body, site) < 0:
        names = _listed(model, "body", "site")
        raise PlanningError("INVALID_LINK_NAME", f"the model has no body or site {tool}: choose one of {names}")
    return body if body >= 0 else int(model.site_bodyid[site])


def _stand(model: Any, body: int) -> int:
    """Return the fixed body on which the arm of a given body is mounted."""
    root = int(model.body_rootid[body])
    return 0 if model.body_jntnum[root] else root


def _ancestors(model: Any, body: int) -> list[int]:
    """Return a body and its ancestors, up to the world."""
    found = [body]
    while found[-1]:
        found.append(int(model.body_parentid[found[-1]]))
    return found


def _joints_between(model: Any, base: int, last: int, tool: str) -> list[int]:
    """Return the joints between two bodies, those closest to the base first. Raises PlanningError if the last body does
    not descend from the base."""
    path = _ancestors(model, last)
    if base not in path:
        raise PlanningError(
            "INVALID_LINK_NAME",
            f"{tool} is not part of the arm that is mounted on {model.body(base).name}: choose one of its links",
        )
    bodies = reversed(path[: path.index(base)])
    return [int(model.body_jntadr[body]) + i for body in bodies for i in range(int(model.body_jntnum[body]))]


def _check_moves(planned: Mapping[str, int], moving: Container[int], tool: str) -> None:
    """Check that each planned joint moves the tool. Raises PlanningError."""
    for name, joint in planned.items():
        if joint not in moving:
            raise PlanningError("INVALID_LINK_NAME", f"joint {name} does not move {tool}: remove it from the group")


def _reference_pose(model: Any, moved: Sequence[int], others: Mapping[str, float]) -> Any:
    """Return MuJoCo's data with the moved joints at their reference positions, and others at the given positions."""
    data = mujoco.MjData(model)
    for name, position in others.items():
        data.qpos[model.jnt_qposadr[_find(model, "joint", name)]] = position
    addresses = model.jnt_qposadr[moved]
    data.qpos[addresses] = model.qpos0[addresses]
    mujoco.mj_kinematics(model, data)
    return data
