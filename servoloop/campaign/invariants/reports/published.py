"""Invariant on published messages: joint states and diagnostics agree with the measurement."""

import math
from collections.abc import Callable, Sequence
from typing import Any, Final

from controller.broadcasters.joint_state_broadcaster import JointStateBroadcaster, JointStates
from controller.broadcasters.state_values import MOVEMENT
from controller.diagnostics import Level, Status, statuses
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.types import JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.simulation.faulty_stack import FaultyStack

CLIPPED_SHARE: Final = 0.0015
"""Largest distance from a limit at which a position beyond it may be published as the limit, as a fraction of the
range."""
PUBLISHED_CYCLES: Final = 4
"""Number of cycles between two checks of the published states."""
DIAGNOSED_CYCLES: Final = 10
"""Number of cycles between two checks of the diagnostics."""


class PublishedAsMeasured(Invariant):
    """Joint states are published with the values and the time of the measurement, and diagnostics report each fault.

    A position slightly beyond a limit may be published as the limit. The diagnostics of a joint with a fault are errors
    with the text of the fault. Alarms are reported, and a joint without a fault, an alarm or a wrong voltage is not
    reported as an error. Because the checks are slow, published states are checked in every fourth cycle, and
    diagnostics in every tenth.
    """

    name = "published as measured"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._limits = dict(zip(self.commanded, stack.loop.limits, strict=True))
        self._servo_ids = {joint.name: str(joint.servo_id) for joint in self.joints}
        self._cycles = 0

    def on_state(self, state: JointState) -> None:
        self._cycles += 1
        for entry in self.stack.manager.registry.loaded.values() if self._cycles % PUBLISHED_CYCLES == 0 else ():
            broadcaster: Any = entry.controller
            if entry.active and entry.spec.kind == JointStateBroadcaster.kind and broadcaster.state is not None:
                self._examine_states(broadcaster.sample(broadcaster.state), state, broadcaster.state_interfaces)
        if self._cycles % DIAGNOSED_CYCLES == 0:
            self._examine_diagnostics(state)

    def _examine_states(self, published: JointStates, state: JointState, interfaces: Sequence[str]) -> None:
        """Compare one message with the measurement. Only these state interfaces have values in the message."""
        self.examined += 1
        if published.stamp_s != state.stamp_s:
            self.say(f"the states published at {state.stamp_s:.3f} s were measured at {published.stamp_s:.3f} s")
        for field in MOVEMENT:
            found = dict(zip(published.names, getattr(published, field).tolist(), strict=True))
            for name, value in zip(self.stack.loop.hardware.joints, getattr(state, field).tolist(), strict=True):
                if f"{name}/{field}" not in interfaces:
                    continue
                if name not in found:
                    self.say(f"the {field} of {name} is not published")
                elif not self._agrees(name, field, value, found[name]):
                    self.say(f"the {field} of {name} is {value:.4f}, but {found[name]:.4f} is published")

    def _agrees(self, name: str, field: str, measured: float, published: float) -> bool:
        """Return whether a published value is the measured value, or the limit if a position is slightly beyond it."""
        if published == measured or (math.isnan(measured) and math.isnan(published)):
            return True
        limit = self._limits.get(name)
        if limit is None or field != "position":
            return False
        near = abs(published - measured) <= CLIPPED_SHARE * (limit.upper - limit.lower)
        return near and published == min(max(measured, limit.lower), limit.upper)

    def _examine_diagnostics(self, state: JointState) -> None:
        found = {one.name: one for one in statuses(self.stack.loop, "", self._servo_ids, state)}
        for joint in self.joints:
            self.examined += 1
            status = found.get(f"servoloop: {joint.name} (servo {joint.servo_id})")
            if status is None:
                self.say(f"the diagnostics do not contain {joint.name}")
            elif wrong := self._wrong(status, state, joint.name):
                self.say(f"the diagnostics of {joint.name} are {status.level.name} {status.message!r}, but {wrong}")
        for component in self.stack.loop.hardware.components:
            status = found.get(f"servoloop: {component.name}")
            level = Level.OK if status is None else status.level
            if (level is Level.ERROR) != (component.error is not None):
                self.say(f"the diagnostics of {component.name} are {level.name}, but its error is {component.error}")

    @staticmethod
    def _wrong(status: Status, state: JointState, joint: str) -> str:
        """Return a fact that contradicts the status of a joint, or an empty string."""
        fault, health = state.faults.get(joint), state.health.get(joint)
        if fault is not None:
            right = status.level is Level.ERROR and status.message == fault.text
            return "" if right else f"it is reported as faulty: {fault.text}"
        alarms = health.alarms if health is not None else ()
        if missing := [alarm for alarm in alarms if alarm not in status.message]:
            return f"its servo has the {missing[0]} alarm"
        outside = health is not None and health.supply is not None and health.supply.outside
        if (status.level is Level.ERROR) != outside or (alarms and status.level is Level.OK):
            return f"its alarms are {list(alarms)} and its supply voltage is {'wrong' if outside else 'right'}"
        return ""
