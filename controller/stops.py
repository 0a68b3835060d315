"""Stop joints within their limits when their controller is deactivated during a motion. Joints outside their limits
return to the limits before a controller commands them."""

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.motion import Kinematics, MotionError, RuckigMotion, plan_stop
from hal.gate import RETURN_SHARE
from hal.types import FloatArray, Interface, JointLimits

LOG = logging.getLogger("servoloop.controller")

STANDING: Final = 1e-6
"""Maximum speed of a joint that counts as at rest, in rad/s or m/s."""


def return_s(position: float, limit: JointLimits) -> float:
    """Return the time in which a position outside its limits returns to them, in seconds. The time is 0 for a position
    within its limits, and for NaN."""
    away = max(limit.lower - position, position - limit.upper)
    return away / (RETURN_SHARE * limit.velocity) if away > 0.0 else 0.0


class StopMotion:
    """A motion that brings command interfaces to rest as fast as the acceleration and jerk limits allow.

    Velocity commands become 0, and the safety gate applies the acceleration limit. Effort commands become 0
    immediately.
    """

    def __init__(
        self, command: FloatArray, velocity: FloatArray, limits: Sequence[JointLimits], kinds: Sequence[str]
    ) -> None:
        """Plan the stop from the last command sent to the hardware and its rate of change, both of shape (k,)."""
        positions = np.array([kind == "position" for kind in kinds], dtype=bool)
        self._command = np.where(positions, command, 0.0)
        self._moved = np.flatnonzero(positions & np.isfinite(command) & np.isfinite(velocity)).tolist()
        self._motion = self._plan(velocity, [limits[i] for i in self._moved]) if self._moved else None
        ramps = [abs(command[i]) / limits[i].acceleration for i, kind in enumerate(kinds) if kind == "velocity"]
        self.duration_s = max([self._motion.duration_s if self._motion else 0.0, *ramps])
        """Time until all joints are at rest, in seconds."""

    def _plan(self, velocity: FloatArray, limits: Sequence[JointLimits]) -> RuckigMotion:
        bound = np.array([limit.velocity for limit in limits])
        speed = np.clip(velocity[self._moved], -bound, bound)
        return plan_stop(Kinematics(self._command[self._moved], speed, np.zeros_like(speed)), limits)

    def sample(self, elapsed_s: float) -> FloatArray:
        """Return the command (k,) at ``elapsed_s`` after the start. Unknown positions remain unknown."""
        command = self._command.copy()
        if self._motion is not None:
            command[self._moved] = self._motion.sample(elapsed_s).position
        return command


class ReturnMotion:
    """The return of one position to its limits. The safety gate keeps the return slow, so the command is the limit
    itself."""

    def __init__(self, position: float, limit: JointLimits) -> None:
        self.duration_s = return_s(position, limit)
        """Time until the position is within its limits, in seconds."""
        self._end = np.array([min(max(position, limit.lower), limit.upper)])

    def sample(self, elapsed_s: float) -> FloatArray:
        """Return the command, of shape (1,)."""
        return self._end


@dataclass(slots=True)
class _Stopping:
    """A stop or a return in progress. ``places`` maps each command interface to its index in the motion's command."""

    places: dict[int, int]
    stop: StopMotion | ReturnMotion
    elapsed_s: float = 0.0


class DecelerationStops:
    """Stops of joints whose controller was deactivated during a motion, and returns of joints outside their limits.

    No other controller commands a joint until the joint is at rest within its limits.
    """

    def __init__(self, interfaces: Sequence[str], limits: Mapping[str, JointLimits]) -> None:
        """Store the limits of each joint, keyed by joint name. A joint without limits stops immediately."""
        self._limits = limits
        self._interfaces = [Interface.parse(name) for name in interfaces]
        self.moving: list[_Stopping] = []
        """Stops in progress. While this list is empty, the cycle calls no method of this class."""

    def begin(self, index: Sequence[int], command: FloatArray, velocity: FloatArray) -> None:
        """Stop the command interfaces whose controller was deactivated. Positions outside their limits return to them.

        Args:
            index: Indices of the command interfaces.
            command: Last command of all n command interfaces, of shape (n,).
            velocity: Rate of change of the last command, of shape (n,).
        """
        returning = self.begin_return(index, command)
        known = [i for i in index if i not in returning and self._interfaces[i].joint in self._limits]
        moving = [i for i in known if self._moves(i, command, velocity)]
        if not moving:
            return
        limits = [self._limits[self._interfaces[i].joint] for i in moving]
        kinds = [self._interfaces[i].kind for i in moving]
        try:
            stop = StopMotion(command[moving], velocity[moving], limits, kinds)
        except MotionError as error:
            LOG.error("joints without a controller stop abruptly instead of braking within their limits: %s", error)
            return
        self._add({i: k for k, i in enumerate(moving)}, stop)

    def begin_return(self, index: Iterable[int], command: FloatArray) -> set[int]:
        """Let positions outside their limits return to them, and return the indices of these positions.

        If a controller moved its joints in the meantime, its commands would run ahead of a slowly returning joint. The
        joint would then jump as soon as it is within its limits.

        Args:
            index: Indices of the command interfaces.
            command: Last command of all n command interfaces, of shape (n,).
        """
        returning = set()
        for i in index:
            limit = self._limits.get(self._interfaces[i].joint)
            if limit is not None and self._interfaces[i].kind == "position":
                back = ReturnMotion(float(command[i]), limit)
                if back.duration_s > 0.0:
                    self._add({i: 0}, back)
                    returning.add(i)
        return returning

    def _add(self, places: dict[int, int], stop: StopMotion | ReturnMotion) -> None:
        for former in self.moving:
            for i in places:
                former.places.pop(i, None)
        self.moving.append(_Stopping(places, stop))

    def _moves(self, i: int, command: FloatArray, velocity: FloatArray) -> bool:
        speed = velocity[i] if self._interfaces[i].kind == "position" else command[i]
        return bool(np.isfinite(command[i]) and abs(speed) > STANDING)

    def holds(self, index: Sequence[int]) -> bool:
        """Return whether any of these command interfaces is still coming to rest."""
        return any(i in stopping.places for stopping in self.moving for i in index)

    def ends(self, command: FloatArray) -> FloatArray:
        """Return ``command`` (n,) with the final positions of joints that are still coming to rest."""
        rest = command.copy()
        for stopping in self.moving:
            self._put(rest, stopping, stopping.stop.duration_s)
        return rest

    def fill(self, wanted: FloatArray, period_s: float) -> None:
        """Set the commands of stopping joints in ``wanted`` (n,) for the end of the next period."""
        for stopping in self.moving:
            stopping.elapsed_s += period_s
            self._put(wanted, stopping, stopping.elapsed_s)
        self.moving = [
            stopping for stopping in self.moving if stopping.places and stopping.elapsed_s < stopping.stop.duration_s
        ]

    @staticmethod
    def _put(values: FloatArray, stopping: _Stopping, elapsed_s: float) -> None:
        sample = stopping.stop.sample(elapsed_s)
        for i, k in stopping.places.items():
            values[i] = sample[k]
