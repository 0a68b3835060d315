"""Invariant on activation: the servos have the settings that an independent reader finds in the arm's files."""

from collections.abc import Callable
from typing import Final

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from drivers.servos.catalog import series_of
from hal.joint import Joint
from hal.types import JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.campaign.invariants.reference import ReferenceJoint, read_reference
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.touches import touched_joints

CHANGES: Final = frozenset(
    {
        "brown_out",
        "loose_plug",
        "cable_cut",
        "weak_supply",
        "eeprom_gone",
        "foreign_packets",
        "wrong_mode",
        "wrong_setting",
        "wrong_id",
        "wrong_rate",
    }
)
"""Faults after which a servo's registers may differ from the values written by the activation."""
OUTSIDE_SHARE: Final = 0.06
"""Maximum distance outside the limits at which a joint may be activated, as a fraction of its range: 0.05 plus
backlash."""
WRONG_SETTING: Final = "wrong_setting"
LOSSES: Final = frozenset({"brown_out", "loose_plug", "cable_cut"})
"""Faults after which an activation writes all values again."""


class ActivatedAsConfigured(Invariant):
    """After an activation, every servo has the torque limit, gains and settings of the robot file.

    A joint that was far outside its limits has not been activated.

    Both conditions also hold for a single servo that has lost its power and is activated again.
    """

    name = "activated as configured"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._reference = read_reference(stack.files, stack.narrowed)
        self._was_active = False
        self._released: set[str] = set()

    def on_state(self, state: JointState) -> None:
        begins, self._was_active = self.active and not self._was_active, self.active
        released, self._released = self._released, self.released(state)
        if not begins and not released:
            return
        for joint in self.joints:
            again = joint.name in released and self.torque(joint)
            if not (begins or again) or joint.name in state.faults or joint.name not in self._reference:
                continue
            touches = self.stack.touches
            touched = touches.kinds(joint.name) & (CHANGES - LOSSES if again else CHANGES) - self._corrected(joint)
            if not touched and touches.since_s(joint.name, LOSSES) > self.stack.loop.period_s:
                self._examine(joint, self._reference[joint.name])

    def _corrected(self, joint: Joint) -> set[str]:
        """Return the kinds of faults of a joint that began before the stack started, which activation corrects."""
        faults = (*self.stack.player.active.values(), *self.stack.player.happened)
        own = [one for one in faults if joint.name in touched_joints(one, self.joints)]
        early = {one.kind for one in own if one.kind == WRONG_SETTING and one.since == "start" and one.at_s == 0.0}
        return early - {one.kind for one in own if one.since != "start" or one.at_s > 0.0}

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
            held, most = memory.get(series.torque_limit), round(wanted.torque_limit * series.full_torque)
            if not 0 < held <= most or (held < 0.9 * most and held < 0.9 * memory.get(series.max_torque)):
                self.say(f"{joint.name}: the torque limit is {held}, but the robot file has {most}")
        position, slack = self.true_positions().get(joint.name), OUTSIDE_SHARE * (wanted.upper - wanted.lower)
        if position is not None and not wanted.lower - slack <= position <= wanted.upper + slack:
            limits = f"{wanted.lower:.4f} to {wanted.upper:.4f}"
            self.say(f"{joint.name} was activated at {position:.4f}, far outside its limits {limits}")
        if not self.torque(joint):
            self.say(f"{joint.name} is active, but its torque is off")
