"""Compute the pose of an arm's tool and its Jacobian from the joint positions (forward kinematics)."""

import math
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from hal.rotations import quaternions, skew
from hal.types import FloatArray, JointLimits
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

    The kinematics are copied from the model, so that a chain has no state and can compute many poses at once. Joints
    between the base and the tool that are not planned remain at fixed positions. For k sets of positions, transforms
    have the shape (k, 4, 4), and Jacobians have the shape (k, 6, n). The first three rows of a Jacobian are linear
    velocities.
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
                mounted.
            If the first body of the arm moves, the default is the world.
            others: Positions of joints that are not planned, keyed by name. By default, the model's positions are used.

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
        joints, body = _joints(model, self.names), _tool_body(model, tool)
        base_body = _stand(model, body) if base is None else _find(model, "body", base)
        _check_on_path(model, {name: int(model.jnt_bodyid[j]) for name, j in joints.items()}, (base_body, body), tool)
        data = mujoco.MjData(model)
        for name, position in (others or {}).items():
            data.qpos[model.jnt_qposadr[_find(model, "joint", name)]] = position
        mujoco.mj_kinematics(model, data)
        world = _transform(data.xmat[base_body], data.xpos[base_body])
        inverse = np.linalg.inv(world)
        place = data.body(body) if _index(model, "body", tool) >= 0 else data.site(tool)
        indices = sorted(joints.values(), key=lambda j: (_depth(model, int(model.jnt_bodyid[j])), j))
        self._order = [list(joints.values()).index(j) for j in indices]
        self._reference = model.qpos0[model.jnt_qposadr[list(joints.values())]].copy()
        self._rest = inverse @ _transform(place.xmat, place.xpos)
        self.turns: NDArray[np.bool_] = model.jnt_type[list(joints.values())] == int(mujoco.mjtJoint.mjJNT_HINGE)
        """Whether each joint is revolute (n,). The other joints are prismatic."""
        axes, anchors = data.xaxis[indices], data.xanchor[indices]
        axes, anchors = axes @ inverse[:3, :3].T, anchors @ inverse[:3, :3].T + inverse[:3, 3]
        self._generators = _generators(axes, anchors, self.turns[self._order])
        self._about = self._generators[0, :, :3, :3]
        self._along = (self._generators[0] + self._generators[2])[:, :3, 3]
        self._axes = axes * self.turns[self._order, None]

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
        return np.asarray(self._links(positions)[-1] @ self._rest)

    def transforms_and_jacobians(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the poses of the tool (k, 4, 4) and its Jacobians (k, 6, n) at several joint positions (k, n)."""
        links = self._links(positions)
        tools = links[-1] @ self._rest
        before = links[:-1].swapaxes(0, 1)
        rotations = before[..., :3, :3]
        seen = rotations.swapaxes(2, 3) @ (tools[:, None, :3, 3] - before[..., :3, 3])[..., None]
        twists = np.zeros((len(positions), len(self.names), 3, 2))
        twists[..., 0] = (self._about @ seen)[..., 0] + self._along
        twists[..., 1] = self._axes
        turned = rotations @ twists
        jacobians = np.empty((len(positions), 6, len(self.names)))
        jacobians[:, :3, self._order] = turned[..., 0].swapaxes(1, 2)
        jacobians[:, 3:, self._order] = turned[..., 1].swapaxes(1, 2)
        return tools, jacobians

    def _links(self, positions: FloatArray) -> FloatArray:
        """Return the transforms (n + 1, k, 4, 4) that move the base and each link from their reference poses."""
        moved = (positions - self._reference)[:, self._order, None, None]
        about, again, along = self._generators
        steps = np.sin(moved) * about + (1.0 - np.cos(moved)) * again + moved * along + np.eye(4)
        links = np.empty((len(self.names) + 1, len(positions), 4, 4))
        links[0] = np.eye(4)
        for joint in range(len(self.names)):
            np.matmul(links[joint], steps[:, joint], out=links[joint + 1])
        return links


def moved_by(model: Any, joints: Sequence[str], tool: str) -> tuple[str, ...]:
    """Return the joints in ``joints`` that move a body or a site of the model. Raises PlanningError if a name is not in
    the model, or a joint is neither a hinge nor a slide."""
    path = _ancestors(model, _tool_body(model, tool))
    return tuple(name for name, joint in _joints(model, joints).items() if int(model.jnt_bodyid[joint]) in path)


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
    return int(mujoco.mj_name2id(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), name))


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
        if int(model.jnt_type[joint]) not in (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)):
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


def _depth(model: Any, body: int) -> int:
    return len(_ancestors(model, body))


def _ancestors(model: Any, body: int) -> list[int]:
    """Return a body and its ancestors, up to the world."""
    found = [body]
    while found[-1]:
        found.append(int(model.body_parentid[found[-1]]))
    return found


def _check_on_path(model: Any, bodies: Mapping[str, int], ends: Sequence[int], tool: str) -> None:
    """Check that each joint's body is between the base and the tool. Raises PlanningError."""
    base, last = ends
    path = _ancestors(model, last)
    if base not in path:
        raise PlanningError(
            "INVALID_LINK_NAME",
            f"{tool} is not part of the arm that is mounted on {model.body(base).name}: choose one of its links",
        )
    path = path[: path.index(base)]
    for name, body in bodies.items():
        if body not in path:
            raise PlanningError("INVALID_LINK_NAME", f"joint {name} does not move {tool}: remove it from the group")
