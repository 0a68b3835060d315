"""What must hold when servos have been activated: they are set up as the arm's files say, by a second reading."""

from collections.abc import Callable
from typing import Final

from drivers.servos.catalog import series_of
from hal.joint import Joint
from hal.types import JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.campaign.invariants.reference import ReferenceJoint, read_reference
from servoloop.simulation.faulty_stack import FaultyStack

CHANGES: Final = frozenset(
    {"brown_out", "cable_cut", "weak_supply", "eeprom_gone", "wrong_mode", "wrong_setting", "wrong_id", "wrong_rate"}
)
"""Faults after which a servo's registers are no longer those that the activation wrote."""


class ActivatedAsConfigured(Invariant):
    """In the first cycle after an activation every servo has the torque limit, gains and settings of the robot file."""

    name = "activated as configured"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._reference = read_reference(stack.files)
        self._was_active = False

    def on_state(self, state: JointState) -> None:
        begins, self._was_active = self.active and not self._was_active, self.active
        if not begins:
            return
        for joint in self.joints:
            touched = self.stack.touches.kinds(joint.name) & CHANGES
            if joint.name in self._reference and joint.name not in state.faults and not touched:
                self._judge(joint, self._reference[joint.name])

    def _judge(self, joint: Joint, wanted: ReferenceJoint) -> None:
        series, memory = series_of(joint.model), self.servos[joint.name].memory
        by_name = {register.name: register for register in series.registers}
        for name, value in wanted.registers.items():
            register = by_name.get(name) or series.position_p
            if register is not None:
                self.examined += 1
                if (held := memory.get(register)) != value:
                    self.say(f"{joint.name}: {name} is {held}, and the robot file says {value}")
        if series.torque_limit is not None:
            self.examined += 1
            held, most = memory.get(series.torque_limit), round(wanted.torque_limit * series.full_torque)
            if not 0 < held <= most or (held < 0.9 * most and held < 0.9 * memory.get(series.max_torque)):
                self.say(f"{joint.name}: its torque limit is {held}, and the robot file says {most}")
        if not self.torque(joint):
            self.say(f"{joint.name} is active, and its servo has no torque")
