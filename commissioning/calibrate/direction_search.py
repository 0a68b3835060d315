"""Find the direction of a joint: turn it slightly, and use a nearby stop or the user's answer."""

from collections.abc import Sequence
from math import ceil
from typing import Final, Protocol

import numpy as np

from commissioning.calibrate.by_hand import CalibrationDialog
from commissioning.calibrate.plan import ArmPlan
from commissioning.calibrate.stop_search import SEEK_RAD_S
from commissioning.commissioning_errors import CalibrationError
from commissioning.slow_arm import PERIOD_S, SlowArm
from hal.joint import Joint

WIGGLE_RAD: Final = 0.15
"""Angle by which a joint turns to determine its direction, in rad of the servo's shaft."""
NEAR_RAD: Final = 0.3
"""Maximum distance to a stop, in the folded pose, at which the stop can reveal the joint's direction, in rad."""
ARRIVED_RAD: Final = 0.12
"""Minimum following error at which a joint counts as blocked by an obstacle, in rad of the servo's shaft."""


class Watcher(CalibrationDialog, Protocol):
    """A person who watches the automatic calibration and moves joints that turn freely to their marked poses."""

    def moved_so(self, joint: str, text: str) -> bool:
        """Ask whether the joint first turned in the direction that ``text`` describes, before it came back."""
        ...


class DirectionSearch:
    """Search for the directions of all joints, starting from the folded pose in the plan."""

    def __init__(self, arm: SlowArm, joints: Sequence[Joint], plan: ArmPlan, watcher: Watcher) -> None:
        """Prepare the search. ``joints`` must be in the same order as the joints of ``arm``."""
        self._arm = arm
        self._joints = tuple(joints)
        self._plan = plan
        self._watcher = watcher

    def direction(self, index: int) -> int:
        """Return a joint's sign, as determined by a nearby stop or the user's answer. Raises CalibrationError."""
        return self._shown_by_stop(index) or self._seen(index, 1)

    def cleared(self, index: int, sign: int) -> int:
        """Move a joint out of the way of the other joints, and return its sign.

        If the joint is blocked, ask the user for its direction again. Raises CalibrationError if the joint is blocked
        in both directions.
        """
        joint, auto = self._joints[index], self._plan.auto
        target = sign * (auto.clear[joint.name] - auto.start[joint.name])
        if self._arrives(index, target):
            return sign
        self._arm.go(index, 0.0)
        self._watcher.say(f"{joint.name} did not reach its goal, so its direction is checked again")
        seen = self._seen(index, -1 if target > 0.0 else 1)
        if self._arrives(index, target * sign * seen):
            return seen
        raise CalibrationError(
            f"{joint.name} (servo {joint.servo_id}) is blocked before it reaches the position that leaves room for "
            "the other joints. Fold the arm, clear the space around it, and calibrate again"
        )

    def _arrives(self, index: int, target: float) -> bool:
        """Move a joint from 0 to the target, and return whether the joint reaches it. A blocked joint stops
        immediately."""
        joint = self._joints[index]
        step, allowed = SEEK_RAD_S * joint.transmission * PERIOD_S, ARRIVED_RAD * joint.transmission
        for goal in np.linspace(0.0, target, ceil(abs(target) / step) + 1):
            self._arm.cycle(index, float(goal))
            here = self._arm.measured_near(index, float(goal))
            if abs(here - goal) > allowed:
                self._arm.go(index, here)
                return False
        self._arm.go(index, target)
        return True

    def _seen(self, index: int, first: int) -> int:
        """Turn the joint slightly, if possible in direction ``first``, and return the sign from the user's answer."""
        joint = self._joints[index]
        for way in (first, -first):
            if self._wiggled(index, way, WIGGLE_RAD) >= 0.5 * WIGGLE_RAD * joint.transmission:
                return way if self._watcher.moved_so(joint.name, self._plan.joints[joint.name].positive) else -way
        raise CalibrationError(
            f"{joint.name} (servo {joint.servo_id}) does not turn in either direction. Check whether it is blocked or "
            "too weak for its load"
        )

    def _shown_by_stop(self, index: int) -> int:
        """Return the sign of a joint near a stop. Such a joint can turn through a larger angle away from the stop than
        toward it.

        Return 0 for other joints.
        """
        joint = self._joints[index]
        start, limits = self._plan.auto.start.get(joint.name), joint.limits
        if start is None:
            return 0
        near = min(start - limits.lower, limits.upper - start) / joint.transmission
        if near > NEAR_RAD:
            return 0
        up, down = (self._wiggled(index, way, max(near, 0.0) + WIGGLE_RAD) for way in (1, -1))
        if abs(up - down) < 0.5 * WIGGLE_RAD * joint.transmission:
            return 0  # The joint is not where the plan expects it.
        away = 1 if up > down else -1
        return away if start - limits.lower < limits.upper - start else -away

    def _wiggled(self, index: int, way: int, angle_rad: float) -> float:
        """Turn a joint slightly and back. Return the angle by which the joint turned."""
        joint = self._joints[index]
        self._watcher.say(f"{joint.name} turns a little and back")
        self._arm.go(index, way * angle_rad * joint.transmission)
        moved = self._arm.measured_near(index, 0.0) * way
        self._arm.go(index, 0.0)
        return moved
