"""What must hold of the arm when the program has ended."""

from collections.abc import Callable
from typing import Final

import numpy as np

from hal.lifecycle import LifecycleState
from hal.types import JointState
from servoloop.campaign.invariants.invariant import Invariant, complains
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.touches import touched_joints

LASTING: Final = frozenset({"eeprom_gone", "wrong_id", "wrong_rate", "wrong_mode", "wrong_setting", "collision"})
"""Faults after which a component may not be activated again: it is left as it is."""


class EndsAsChosen(Invariant):
    """At the end the arm is held, or parked and released, as its robot file says, as far as its servos are reached.

    A servo that holds may still release itself, to protect itself, and complains. Faults that begin while the program
    ends, or last until then, excuse the joints that they touch.
    """

    name = "ends as chosen"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None]) -> None:
        super().__init__(stack, say)
        self._driven: set[str] = set()
        """Joints that were driven in the last cycle, and nothing wrong with them."""
        self._inactive = False
        """Whether a client had deactivated the hardware by then: its torque stays as it is."""
        self._happened = 0
        """So many faults had begun or ended by then."""

    def on_state(self, state: JointState) -> None:
        self._happened = len(self.stack.player.happened)
        self._inactive = self.stack.loop.hardware.state is LifecycleState.INACTIVE
        sound = {joint.name for joint in self.joints if joint.name not in state.faults and self.torque(joint)}
        self._driven = sound if self.active else set()

    def at_end(self) -> None:
        touched = self._touched_at_the_end()
        on = {joint.name for joint in self.joints if self.torque(joint)}
        judged = self._driven - touched
        self.examined += len(judged)
        if not self.stack.relaxes:
            quiet = {joint.name for joint in self.joints if not complains(joint, self.servos[joint.name])}
            self._tell("released", (judged & quiet) - on)
            return
        reached = {joint.name for joint in self.joints if self.stack.adapters[joint.bus].reachable} - touched
        if not self._unfit() and not self._inactive and len(reached) == len(self.joints):
            self.examined += len(reached)
            self._tell("under torque", on & reached)
        if len(judged) == len(self.joints):
            self._tell("not parked", self._not_parked())

    def _unfit(self) -> bool:
        """Whether a servo is not as the robot file has it: then no component that was lost comes back."""
        return self.shared_id or any(self.stack.touches.kinds(joint.name) & LASTING for joint in self.joints)

    def _touched_at_the_end(self) -> set[str]:
        """The joints that faults touch now, or have touched since the last cycle."""
        events = (*self.stack.player.happened[self._happened :], *self.stack.player.active.values())
        if any(event.kind == "stall" for event in events):
            return {joint.name for joint in self.joints}
        return {name for event in events for name in touched_joints(event, self.joints)}

    def _not_parked(self) -> set[str]:
        park = self.stack.files.robot.file.park
        commands = dict(zip(self.commanded, self.stack.loop.command, strict=True))
        pose = park.pose if park else {}
        return {name for name, position in pose.items() if not np.isclose(commands[name], position, atol=1e-6)}

    def _tell(self, what: str, joints: set[str]) -> None:
        if joints:
            self.say(f"{what}: {', '.join(sorted(joints))}")
