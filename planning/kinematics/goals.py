"""Tool goals as regions of poses, and checks of the poses and tolerances that a client sends."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from hal.rotations import euler_angles, euler_rates, matrices, rotation_vectors, vector_rates
from hal.types import FloatArray
from planning.kinematics.chain import ToolPose
from planning.planning_errors import PlanningError
from planning.vectors import vector_of

ROTATION_M: Final = 0.1
"""Distance that is equivalent to a rotation by 1 rad when positions and orientations are compared, in m/rad."""
NORMALIZED_WITHIN: Final = 1e-3
"""Maximum deviation of a quaternion's length from 1 that is corrected without an error."""
FARTHEST_M: Final = 1e3
"""Maximum coordinate of a goal, in m. A larger value is probably in the wrong unit."""
INSIDE: Final = 0.9
"""Fraction of the tolerances that the search for a pose inside the region uses."""


Angles = Literal["rotation_vector", "xyz_euler"]
"""Angles of a rotation, as in the parameterization of moveit_msgs/OrientationConstraint.

- ``rotation_vector``: components of the rotation axis times the angle, along the axes of the goal.
- ``xyz_euler``: angles about the x axis, the new y axis and the new z axis, in this order.
"""


class GoalError(PlanningError):
    """A client's goal is invalid or cannot be reached."""


class UnreachableError(GoalError):
    """No joint positions within the limits reach the goal."""

    def __init__(self, message: str, nearest: ToolPose, positions: FloatArray, distance: tuple[float, float]) -> None:
        super().__init__("NO_IK_SOLUTION", message)
        self.nearest = nearest
        """Nearest pose found that the tool can reach."""
        self.positions = positions
        """Joint positions (n,) of this pose, in rad or m."""
        self.distance_m, self.angle_rad = distance


class CollidingError(GoalError):
    """The goal can be reached only with joint positions that are not valid."""

    def __init__(self, message: str, positions: FloatArray) -> None:
        super().__init__("GOAL_IN_COLLISION", message)
        self.positions = positions
        """Joint positions (n,) that reach the goal but are not valid, in rad or m."""


def invalid(message: str) -> GoalError:
    """Return the error for a goal that is invalid for every arm."""
    return GoalError("INVALID_GOAL_CONSTRAINTS", message)


def checked_pose(position_m: Sequence[float] | FloatArray, quaternion_xyzw: Sequence[float] | FloatArray) -> ToolPose:
    """Check and normalize a pose that a client sent.

    Args:
        position_m: Position (3,), in m.
        quaternion_xyzw: Orientation (4,). The quaternion's length must be 1, except for rounding.

    Raises:
        GoalError: A number is not finite or too large, or the quaternion's length is not 1.
    """
    position = _vector(position_m, "xyz", "position")
    quaternion = _vector(quaternion_xyzw, "xyzw", "orientation")
    for axis, value in zip("xyz", position.tolist(), strict=True):
        if abs(value) > FARTHEST_M:
            raise invalid(f"{axis} of the goal's position is {value:g} m, above {FARTHEST_M:g} m: send meters")
    length = math.hypot(*quaternion.tolist())
    if length == 0.0:
        raise invalid("the quaternion of the goal's orientation has length 0: send w 1 for no rotation")
    if abs(length - 1.0) > NORMALIZED_WITHIN:
        raise invalid(f"the quaternion of the goal's orientation has length {length:.6g}: normalize it to length 1")
    return ToolPose(position, quaternion / length)


def _vector(values: Sequence[float] | FloatArray, names: str, what: str) -> FloatArray:
    """Return the values as an array with one finite value for each letter of ``names``. Raises GoalError."""
    found = vector_of(values)
    if found is None:
        raise invalid(f"the goal's {what} must consist of numbers, not {values!r}")
    if len(found) != len(names):
        raise invalid(f"the goal's {what} needs {len(names)} numbers ({', '.join(names)}), not {len(found)}")
    for name, value in zip(names, found.tolist(), strict=True):
        if not math.isfinite(value):
            raise invalid(f"{name} of the goal's {what} is {value}: send a finite number")
    return found


_IDENTITY: Final = np.eye(3)[None]


@dataclass(frozen=True, slots=True)
class PositionSphere:
    """Region of positions around a goal position."""

    radius_m: float

    def check(self) -> None:
        """Check the region. Raises GoalError if the region has no size."""
        _check_tolerance(self.radius_m, "position tolerance", " m")

    def excess(self, offsets: FloatArray, share: float) -> tuple[FloatArray, FloatArray]:
        """Return the vector from the region to each offset. It is zero for an offset inside the region.

        Args:
            offsets: Offsets from the center (k, 3), in m.
            share: Fraction of the region's size that is used.

        Returns:
            The shortest vectors (k, 3) from the region to the offsets, in m, and their derivatives (k or 1, 3, 3).
        """
        if share == 0.0:
            return offsets, _IDENTITY
        distance = np.sqrt((offsets * offsets).sum(axis=1, keepdims=True))
        safe = np.where(distance > 0.0, distance, 1.0)
        outside = np.maximum(1.0 - share * self.radius_m / safe, 0.0)
        normal = offsets / safe
        along = normal[:, :, None] * normal[:, None, :]
        tangent = outside[..., None] * (_IDENTITY - along)
        return outside * offsets, np.where(outside[..., None] > 0.0, along + tangent, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class PositionBox:
    """Box of positions around a goal position."""

    size_m: tuple[float, float, float]
    """Lengths of the edges, in m. The goal is at the center of the box."""
    quaternion_xyzw: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    """Orientation of the box in the base link frame."""

    def check(self) -> None:
        """Check the region. Raises GoalError if an edge has no length, or if the orientation is invalid."""
        for axis, size in zip("xyz", self.size_m, strict=True):
            _check_tolerance(size, f"size of the position region along {axis}", " m")
        checked_pose((0.0, 0.0, 0.0), self.quaternion_xyzw)

    def excess(self, offsets: FloatArray, share: float) -> tuple[FloatArray, FloatArray]:
        """Return vectors from the region to offsets, as in ``PositionSphere.excess``, but along the axes of the box."""
        rotation = matrices(checked_pose((0.0, 0.0, 0.0), self.quaternion_xyzw).quaternion_xyzw)
        own = offsets @ rotation
        beyond = own - np.clip(own, *(np.array(self.size_m) / 2.0 * share * sign for sign in (-1.0, 1.0)))
        active = (beyond != 0.0) | (share == 0.0)
        return beyond, np.where(active[..., None], rotation.T, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class PoseGoal:
    """Region of poses around a tool pose.

    The orientation is inside the region if the angles of the rotation from the goal to the tool are within the
    tolerances.
    """

    pose: ToolPose
    region: PositionSphere | PositionBox
    """Region of positions around the position of the pose."""
    orientation_tolerance_rad: tuple[float, float, float]
    """Tolerances about the x, y and z axes of the goal, in rad. If a tolerance is pi or more, the orientation about
    that axis is free.
    """
    angles: Angles = "rotation_vector"
    """Interpretation of the angles."""
    _target: FloatArray = field(init=False, repr=False)
    """Orientation of the pose as a matrix (3, 3)."""
    _free: NDArray[np.bool_] = field(init=False, repr=False)
    """Whether the orientation is free about each axis (3,)."""

    def __post_init__(self) -> None:
        """Check the goal. Raises GoalError."""
        checked = checked_pose(self.pose.position_m, self.pose.quaternion_xyzw)
        object.__setattr__(self, "pose", checked)
        self.region.check()
        for axis, tolerance in zip("xyz", self.orientation_tolerance_rad, strict=True):
            _check_tolerance(tolerance, f"orientation tolerance about {axis}", " rad")
        object.__setattr__(self, "_target", matrices(checked.quaternion_xyzw))
        object.__setattr__(self, "_free", np.array(self.orientation_tolerance_rad) >= math.pi)

    def excess(self, tools: FloatArray, share: float) -> FloatArray:
        """Return the excess of tool poses (k, 4, 4), which is their distance from the region.

        Args:
            tools: Poses of the tool (k, 4, 4).
            share: Fraction of the tolerances that is used. If 0, the region is the pose itself, except for free axes.

        Returns:
            The excess (k, 6) in m. The last three columns are rotations times ``ROTATION_M``.
        """
        beyond, _ = self._beyond(tools, share)
        return np.concatenate([beyond, self._turned(self._angles(tools, share), share) * ROTATION_M], axis=1)

    def excess_and_slopes(
        self, tools: FloatArray, jacobians: FloatArray, share: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return the excess (k, 6) and its Jacobian (k, 6, n), given the Jacobians (k, 6, n) of the tool."""
        (beyond, slopes), angles = self._beyond(tools, share), self._angles(tools, share)
        turned = self._turned(angles, share)
        active = ((turned != 0.0) | (share == 0.0)) & ~self._free
        rates = euler_rates(angles) if self._are_euler(share) else vector_rates(angles)
        rates = (active[:, :, None] * ROTATION_M * rates) @ tools[:, :3, :3].swapaxes(1, 2)
        excess = np.concatenate([beyond, turned * ROTATION_M], axis=1)
        return excess, np.concatenate([slopes @ jacobians[:, :3], rates @ jacobians[:, 3:]], axis=1)

    def distances(self, tools: FloatArray) -> FloatArray:
        """Return the distances (k, 2) of poses (k, 4, 4) from the goal's pose, in m and rad. Free axes are ignored."""
        excess = self.excess(tools, 0.0)
        return np.stack([np.linalg.norm(excess[:, :3], axis=1), np.linalg.norm(excess[:, 3:], axis=1) / ROTATION_M], 1)

    def contains(self, tools: FloatArray) -> NDArray[np.bool_]:
        """Return whether each pose (k, 4, 4) is inside the region (k,)."""
        return np.asarray(np.abs(self.excess(tools, 1.0)).max(axis=1) <= _ROUNDING_M)

    def _beyond(self, tools: FloatArray, share: float) -> tuple[FloatArray, FloatArray]:
        return self.region.excess(tools[:, :3, 3] - self.pose.position_m, share)

    def _are_euler(self, share: float) -> bool:
        """Return whether to use Euler angles. For the pose itself (share 0), rotation vectors are more direct."""
        return self.angles == "xyz_euler" and (share > 0.0 or bool(self._free.any()))

    def _angles(self, tools: FloatArray, share: float) -> FloatArray:
        """Return the angles (k, 3) from the goal to the tools, in rad."""
        rotations = self._target.T @ tools[:, :3, :3]
        return euler_angles(rotations) if self._are_euler(share) else rotation_vectors(rotations)

    def _turned(self, angles: FloatArray, share: float) -> FloatArray:
        """Return the amounts by which angles (k, 3) exceed the tolerances."""
        limit = np.where(self._free, np.inf, share * np.array(self.orientation_tolerance_rad))
        return angles - np.clip(angles, -limit, limit)


_ROUNDING_M: Final = 1e-9
"""Maximum excess that is considered inside, in m."""


def _check_tolerance(value: float, what: str, unit: str) -> None:
    if not math.isfinite(value) or value <= 0.0:
        raise invalid(f"the {what} is {value:g}{unit}: send a finite number above 0")
