"""forward_command_controller/ForwardCommandController: the newest message is the command."""

import logging
from collections import deque
from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from controller.interface import Surroundings, indices, limits_of
from controller.parameters import Parameters
from hal.types import FloatArray, JointLimits, JointState

LOG = logging.getLogger("servoloop.controller")

ARRIVED_SHARE = 0.02
"""Share of a joint's range within which it has arrived."""
STILL_SHARE = 0.03
"""Share of a joint's velocity limit below which it stands still."""
STILL_S = 0.1
"""So long it must stand still short of its goal to count as stalled (fingers on an object)."""


class ForwardParameters(Parameters):
    """Of a forward command controller."""

    joints: tuple[str, ...] = Field(min_length=1)
    interface_name: Literal["position"]

    def claims(self) -> tuple[str, ...]:
        return tuple(f"{joint}/{self.interface_name}" for joint in self.joints)


class ForwardCommandController:
    """Holds the measured position until the first command comes; then repeats the last one."""

    kind: ClassVar[str] = "forward_command_controller/ForwardCommandController"
    parameters_type: ClassVar[type[Parameters]] = ForwardParameters

    def __init__(
        self,
        name: str,
        joints: Sequence[str],
        limits: Sequence[JointLimits],
        hardware_joints: Sequence[str],
    ) -> None:
        self.name = name
        self.parameters = Parameters()
        self.joints = tuple(joints)
        self.command_interfaces = tuple(f"{joint}/position" for joint in joints)
        self.state_interfaces = tuple(f"{joint}/{name}" for joint in joints for name in ("position", "velocity"))
        self.command: FloatArray = np.full(len(joints), np.nan)
        self._index = indices(joints, hardware_joints)
        self._range = np.array([limit.upper - limit.lower for limit in limits])
        self._lower = np.array([limit.lower for limit in limits])
        self._upper = np.array([limit.upper for limit in limits])
        self._velocity = np.array([limit.velocity for limit in limits])
        self._inbox: deque[FloatArray] = deque(maxlen=1)
        self._still_s = 0.0
        self._settled = True

    @classmethod
    def build(cls, name: str, parameters: ForwardParameters, surroundings: Surroundings) -> "ForwardCommandController":
        """As the controllers file wants it."""
        limits = limits_of(parameters.joints, surroundings.limits)
        made = cls(name, parameters.joints, limits, surroundings.component.joints)
        made.parameters = parameters
        return made

    def submit(self, values: Sequence[float]) -> str | None:
        """A command from any thread. Returns why it is dropped, or None; empty ones mean nothing."""
        if not values:
            return None
        if len(values) != len(self.joints):
            return f"command size ({len(values)}) does not match number of interfaces ({len(self.joints)}): dropped"
        if not np.isfinite(values).all():
            return "Non-finite value received. Dropping message"
        self._inbox.append(np.array(values, dtype=np.float64))
        return None

    def activate(self, state: JointState, command: FloatArray) -> None:
        self._inbox.clear()
        self.command = command.copy()
        self._settled = True

    def deactivate(self) -> None:
        self._inbox.clear()

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        changed = False
        if self._inbox:
            wanted = self._inbox.popleft()
            clipped = np.clip(wanted, self._lower, self._upper)
            if (clipped != wanted).any():
                LOG.warning("%s: %s is outside the limits, going to %s", self.name, wanted, clipped)
            changed = bool((clipped != self.command).any())
            if changed:
                self._settled, self._still_s = False, 0.0
            self.command = clipped
        if not self._settled:
            # A state that is older than the command says nothing of a stall.
            self._settled = self._arrived(state) or (not changed and self._stalled(state, period_s))

    def settled(self) -> bool:
        return self._settled and not self._inbox

    def _arrived(self, state: JointState) -> bool:
        error = np.abs(state.position[self._index] - self.command)
        return bool((error <= ARRIVED_SHARE * self._range).all())

    def _stalled(self, state: JointState, period_s: float) -> bool:
        slow = np.abs(state.velocity[self._index]) <= STILL_SHARE * self._velocity
        self._still_s = self._still_s + period_s if bool(slow.all()) else 0.0
        # The first cycles after a command are still because nothing has begun to move yet.
        return self._still_s > STILL_S
