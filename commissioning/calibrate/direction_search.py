"""The search for a joint's direction: the joint turns a little, and a stop beside it or the user shows which way."""

from collections.abc import Sequence
from math import ceil
from typing import Final, Protocol

import numpy as np

from commissioning.calibrate.by_hand import Guide
from commissioning.calibrate.plan import ArmPlan
from commissioning.calibrate.result import CalibrationError
from commissioning.calibrate.stop_search import SEEK_RAD_S
from commissioning.slow_arm import PERIOD_S, SlowArm
from hal.joint import Joint

WIGGLE_RAD: Final = 0.15
NEAR_RAD: Final = 0.3
"""The largest distance to a stop, in the folded pose, at which the stop shows the joint's direction."""
ARRIVED_RAD: Final = 0.12
"""A joint that is farther behind its goal is held up by an obstacle."""


class Watcher(Guide, Protocol):
    """A person who watches the arm move by itself, and brings joints that turn freely into their marked poses."""

    def moved_so(self, joint: str, text: str) -> bool:
        """Whether the joint just turned the way that ``text`` says (and not the other way), and came back."""
        ...


class DirectionSearch:
    """The directions of the joints of an arm that lies folded, as its plan has it."""

    def __init__(self, arm: SlowArm, joints: Sequence[Joint], plan: ArmPlan, watcher: Watcher) -> None:
        """``joints``: in the order of the arm's."""
        self._arm = arm
        self._joints = tuple(joints)
        self._plan = plan
        self._watcher = watcher

    def direction(self, index: int) -> int:
        """Return the sign of a joint, from the stop beside it or from the user's answer. Raises CalibrationError."""
        return self._shown_by_stop(index) or self._seen(index, 1)

    def cleared(self, index: int, sign: int) -> int:
        """Move a joint out of the way of the others; returns its sign. Asks for it again if the joint is held up.

        Raises CalibrationError if the joint is held up either way.
        """
        joint, auto = self._joints[index], self._plan.auto
        target = sign * (auto.clear[joint.name] - auto.start[joint.name])
        if self._arrives(index, target):
            return sign
        self._arm.go(index, 0.0)
        self._watcher.say(f"{joint.name} did not get to where it was sent: once more")
        seen = self._seen(index, -1 if target > 0.0 else 1)
        if self._arrives(index, target * sign * seen):
            return seen
        raise CalibrationError(
            f"{joint.name} (servo {joint.servo_id}) does not get to where it is to be out of the way: lay the arm down "
            "folded with nothing around it, and begin again"
        )

    def _arrives(self, index: int, target: float) -> bool:
        """Move a joint from 0 to the target; returns whether it arrives. A joint that is held up stops at once."""
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
        """Turn the joint a little, the ``first`` way if it can, and return the sign that the user's answer gives."""
        joint = self._joints[index]
        for way in (first, -first):
            if self._wiggled(index, way, WIGGLE_RAD) >= 0.5 * WIGGLE_RAD * joint.transmission:
                return way if self._watcher.moved_so(joint.name, self._plan.joints[joint.name].positive) else -way
        raise CalibrationError(
            f"{joint.name} (servo {joint.servo_id}) turns neither way: is it blocked, or too weak for what it carries?"
        )

    def _shown_by_stop(self, index: int) -> int:
        """Return the sign of a joint near a stop, from which it turns farther than towards it; 0 for other joints."""
        joint = self._joints[index]
        start, limits = self._plan.auto.start.get(joint.name), joint.limits
        if start is None:
            return 0
        near = min(start - limits.lower, limits.upper - start) / joint.transmission
        if near > NEAR_RAD:
            return 0
        up, down = (self._wiggled(index, way, max(near, 0.0) + WIGGLE_RAD) for way in (1, -1))
        if abs(up - down) < 0.5 * WIGGLE_RAD * joint.transmission:
            return 0  # it does not lie as the plan has it
        away = 1 if up > down else -1
        return away if start - limits.lower < limits.upper - start else -away

    def _wiggled(self, index: int, way: int, angle_rad: float) -> float:
        """Turn a joint a little and back; returns the angle that it turned."""
        joint = self._joints[index]
        self._watcher.say(f"{joint.name} turns a little, and back")
        self._arm.go(index, way * angle_rad * joint.transmission)
        moved = self._arm.measured_near(index, 0.0) * way
        self._arm.go(index, 0.0)
        return moved
