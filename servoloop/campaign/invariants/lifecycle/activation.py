"""Invariant on activation: the servos have the settings that an independent parser reads from the arm's files."""

import re
from collections.abc import Callable, Sequence
from typing import Any, Final

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from drivers.servos.catalog import series_of
from hal.joint import Joint
from hal.servos.soft_torque import Softening
from hal.types import JointState
from servoloop.api.freedrive import FREEDRIVE
from servoloop.campaign.invariants.invariant import DECEIVING, Invariant
from servoloop.campaign.invariants.reference import ReferenceJoint, read_reference
from servoloop.simulation.faulty_stack import FaultyStack
from sim_backend.faults.settings import WRONG_SETTING

CHANGES: Final = frozenset(
    {
        "brown_out",
        "hardware_error",
        "loose_plug",
        "cable_cut",
        "weak_supply",
        "eeprom_gone",
        "foreign_packets",
        "wrong_mode",
        WRONG_SETTING,
        "wrong_id",
        "wrong_rate",
    }
)
"""Faults after which a servo's registers may differ from the values that the activation wrote."""
OUTSIDE_SHARE: Final = 0.06
"""Maximum distance outside the limits at which a joint may be activated, as a fraction of its range: 0.05 plus
backlash."""
LEAST_SHARE: Final = 0.9
"""Smallest torque limit after an activation, as a fraction of the limit in the robot file or in the servo."""
SOFT: Final = 0.8
"""Largest torque limit of a joint that is guided by hand, as a fraction of its usual limit."""
SWITCH_CYCLES: Final = 2
"""Number of cycles after which all torque limits must be reduced."""
STIFF_S: Final = 3.0
"""Time after which all torque limits must be restored, in seconds."""
RECOVERED_S: Final = 2.0
"""Time after which a fault without lasting effects no longer prevents an activation, in seconds."""
RESTORED_S: Final = 4.0
"""Time after which a fault without lasting effects no longer prevents the stack from changing a torque limit, in
seconds."""
REDUCED: Final = CHANGES - {"wrong_rate"}
"""Faults after which a torque limit may differ from the value that the stack wrote last."""
LOSSES: Final = frozenset({"brown_out", "loose_plug", "cable_cut"})
"""Faults after which an activation writes all values again."""


def wrong_torque_limit(joint: Joint, memory: Any, wanted: ReferenceJoint) -> str:
    """Return a message if the torque limit in a servo's memory differs from the robot file, or an empty string if they
    agree.

    A series without a torque limit raises ValueError.
    """
    series = series_of(joint.model)
    if series.torque_limit is None:
        raise ValueError(f"{joint.model.name} has no torque limit")
    held, most = memory.get(series.torque_limit), round(wanted.torque_limit * series.full_torque)
    if 0 < held <= most and (held >= LEAST_SHARE * most or held >= LEAST_SHARE * memory.get(series.max_torque)):
        return ""
    return f"{joint.name}: the torque limit is {held}, but the robot file has {most}"


class ActivatedAsConfigured(Invariant):
    """After an activation, every servo has the torque limit, gains and settings that the robot file specifies.

    A joint that was far outside its limits must not have been activated. Both conditions also hold for a single servo
    that has lost power and is activated again. Without a fault, an arm within its limits is activated at the start, and
    whenever a client requests it. A failed activation does not release joints that were driven before.

    While an arm is guided by hand, its torque limits are reduced, and they are restored afterward. The stack knows each
    servo whose torque limit is still reduced, so that it can restore this limit later.
    """

    name = "activated as configured"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._reference = read_reference(stack.files, stack.narrowed)
        self._was_active = self._ever_active = False
        self._released: set[str] = set()
        self._held: set[str] = set()
        """Joints that have been driven since before a component began to change its state."""
        self._guided_cycles = self._stiff_cycles = 0
        """Numbers of consecutive cycles in which the arm could, or could not, be guided by hand."""
        self._softened = False
        """Whether the arm has been guided by hand."""

    def on_state(self, state: JointState) -> None:
        self._examine_softness(state)
        self._examine_reductions()
        self._examine_requests()
        driven = {joint.name for joint in self.joints if self.torque(joint)}
        switching = any(component.switching for component in self.stack.loop.hardware.components)
        self._held = self._held & driven if switching else driven
        begins, self._was_active = self.active and not self._was_active, self.active
        self._ever_active = self._ever_active or begins
        released, self._released = self._released, self.released(state)
        if not begins and not released:
            return
        for joint in self.joints:
            again = joint.name in released and self.torque(joint)
            if not (begins or again) or joint.name in state.faults or joint.name not in self._reference:
                continue
            touches = self.stack.touches
            touched = touches.kinds(joint.name) & (CHANGES - LOSSES if again else CHANGES)
            if touched == {WRONG_SETTING} and self._starts_wrong(joint):
                touched = set()
            if not touched and touches.since_s(joint.name, LOSSES) > self.stack.loop.period_s:
                self._examine(joint, self._reference[joint.name])

    def at_end(self) -> None:
        """Check that the arm was activated if nothing prevented it."""
        if self._ever_active or self.stack.player.happened:
            return
        self.examined += 1
        if self._within_limits():
            self.say("the arm was not activated, although all joints are within their limits and no fault has begun")

    def _examine_requests(self) -> None:
        """Check that a requested activation is refused only because of a fault or a joint outside its limits."""
        requests = self.stack.activations
        for request in [request for request in requests if request.done]:
            requests.remove(request)
            if self.stack.ending:
                continue
            try:
                request.result()
            except Exception as error:
                self._examine_held(str(error))
                if self._within_limits() and all(map(self._healthy, self._blamed(str(error)))):
                    self.say(f"{request} was refused without a fault: {error}")
            self.examined += self._within_limits()

    def _examine_held(self, error: str) -> None:
        """Check that a failed activation has not released joints that were driven before."""
        for joint in self.joints:
            if joint.name not in self._held or self.stack.touches.since_s(joint.name, CHANGES) <= RECOVERED_S:
                continue
            self.examined += 1
            if not self.torque(joint) and not self.reports_error(joint):
                self.say(f"{joint.name} was driven, but a failed activation has released it: {error}")

    def _within_limits(self) -> bool:
        true = self.true_positions()
        return all(one.lower <= true[name] <= one.upper for name, one in self._reference.items() if name in true)

    def _blamed(self, text: str) -> Sequence[Joint]:
        """Return the joints that an error names, or all joints if it names none."""
        words = set(re.findall(r"\w+", text))
        return [j for j in self.joints if j.name in words or f"servo {j.servo_id}" in text] or self.joints

    def _healthy(self, joint: Joint) -> bool:
        """Return whether no fault, and no alarm of the servo, can prevent the activation of a joint."""
        name, touches = joint.name, self.stack.touches
        if self.reports_error(joint) or touches.since_s(name) <= RECOVERED_S:
            return False
        return not touches.kinds(name) & (DECEIVING | CHANGES - LOSSES)

    def _examine_reductions(self) -> None:
        """Check that the stack knows each torque limit that it has reduced."""
        if not self._softened or not self.active:
            return
        parts = [one.hardware for one in self.stack.loop.hardware.components]
        known = {name for part in parts if isinstance(part, Softening) for name in part.soft_torque.reduced}
        for joint in self.joints:
            wanted, series = self._reference.get(joint.name), series_of(joint.model)
            if joint.name in known or wanted is None or series.torque_limit is None:
                continue
            memory = self.servos[joint.name].memory
            held, most = memory.get(series.torque_limit), wanted.torque_limit * series.full_torque
            lowest = min(SOFT * most, LEAST_SHARE * memory.get(series.max_torque))
            if self.stack.touches.kinds(joint.name) & REDUCED:
                continue
            self.examined += 1
            if held < lowest:
                self.say(f"{joint.name}: the torque limit is still reduced to {held}, but the stack does not know this")

    def _examine_softness(self, state: JointState) -> None:
        """Check that the torque limits are reduced while the arm is guided by hand, and restored some time later."""
        freedrive = self.stack.manager.registry.loaded.get(FREEDRIVE)
        if freedrive is None or not self.active:
            self._guided_cycles = self._stiff_cycles = 0
            return
        self._softened = self._softened or freedrive.active
        self._guided_cycles = self._guided_cycles + 1 if freedrive.active else 0
        self._stiff_cycles = 0 if freedrive.active else self._stiff_cycles + 1
        guided = self._guided_cycles > SWITCH_CYCLES
        if not guided and self._stiff_cycles * self.stack.loop.period_s < STIFF_S:
            return
        for joint in self.joints:
            wanted, series = self._reference.get(joint.name), series_of(joint.model)
            skipped = joint.name not in self.arm.joints or joint.name in state.faults or self._limit_unknown(joint.name)
            if skipped or wanted is None or series.torque_limit is None:
                continue
            self.examined += 1
            memory = self.servos[joint.name].memory
            if guided and memory.get(series.torque_limit) > SOFT * wanted.torque_limit * series.full_torque:
                self.say(f"{joint.name} is guided by hand, but its torque limit is not reduced")
            elif not guided and (problem := wrong_torque_limit(joint, memory, wanted)):
                self.say(f"{problem}, after the arm was guided by hand")

    def _limit_unknown(self, joint: str) -> bool:
        """Return whether a fault may have changed the torque limit of a joint, or prevented the stack from writing
        it."""
        touches = self.stack.touches
        return bool(touches.kinds(joint) & CHANGES) or touches.since_s(joint) < RESTORED_S

    def _starts_wrong(self, joint: Joint) -> bool:
        """Return whether all wrong settings of a joint existed before the start, so that the activation corrects
        them."""
        wrong = [one for one in self.stack.touches.events(joint.name) if one.kind == WRONG_SETTING]
        return all(one.since == "start" and one.at_s == 0.0 for one in wrong)

    def _examine(self, joint: Joint, wanted: ReferenceJoint) -> None:
        series, memory = series_of(joint.model), self.servos[joint.name].memory
        by_name = {register.name: register for register in series.registers}
        for name, value in wanted.registers.items():
            register = by_name.get(name) or series.position_p
            if register is not None:
                self.examined += 1
                if (held := memory.get(register)) != value:
                    self.say(f"{joint.name}: {name} is {held}, but the robot file has {value}")
        if series.torque_limit is not None:
            self.examined += 1
            if problem := wrong_torque_limit(joint, memory, wanted):
                self.say(problem)
        position, slack = self.true_positions().get(joint.name), OUTSIDE_SHARE * (wanted.upper - wanted.lower)
        if self.deceived(joint.name):
            position = None
        if position is not None and not wanted.lower - slack <= position <= wanted.upper + slack:
            limits = f"{wanted.lower:.4f} to {wanted.upper:.4f}"
            self.say(f"{joint.name} was activated at {position:.4f}, far outside its limits {limits}")
        if not self.torque(joint):
            self.say(f"{joint.name} is active, but its torque is off")
