"""Pose of an arm's tool, used as a motion goal or as a measurement."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from servoloop.api.checks import checked_numbers, number_of


@dataclass(frozen=True, slots=True)
class ArmPose:
    """Pose of a tool in the frame of the arm's base, with tolerances that apply if the pose is used as a goal."""

    position_m: Sequence[float]
    """Position (3,), in m."""
    quaternion_xyzw: Sequence[float] | None = None
    """Orientation (4,), as a unit quaternion. If None, any orientation is accepted."""
    tolerance_m: float = 0.005
    """Maximum distance from the position, in m."""
    tolerance_rad: float | Sequence[float] = 0.05
    """Maximum rotation from the orientation, in rad: one value for all tool axes, or one each for x, y and z (3,).

    A value of pi or more leaves the rotation about an axis free, which is useful for arms with five joints.
    """
    tool: str | None = None
    """Link or site that is moved to the pose. If None, the arm's tool is moved."""

    def tolerances_rad(self) -> tuple[float, float, float]:
        """Return the tolerance about each axis (3,), in rad. Raises ArmInputError if there are not one or three
        numbers."""
        if self.quaternion_xyzw is None:
            return (math.pi, math.pi, math.pi)
        if (one := number_of(self.tolerance_rad)) is not None:
            return (one, one, one)
        x, y, z = checked_numbers("tolerance_rad", self.tolerance_rad, 3)
        return x, y, z
