"""Invariant on prolonged pressing: if a joint presses without moving, its drive is reduced."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.types import JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.campaign.invariants.reference import read_reference
from servoloop.simulation.faulty_stack import FaultyStack

REDUCED_S: Final = 1.7
"""Maximum time until the drive of a joint that presses without moving is reduced, in seconds. The overload protection
of an STS servo would reduce the drive after 2 s.
"""
PRESSES: Final = 0.9
"""Minimum drive at which a joint counts as pressing, as a fraction of its torque limit. The stack starts to reduce the
drive at 0.8. The reported drive must also reach this value, because a strong motor has up to 1.2 times the torque that
its servo reports.
"""
OUTSIDE_TURNS: Final = 0.02
"""Minimum distance from its limits at which a joint counts as outside them, in turns of its servo."""
STILL_TURNS: Final = 0.003
"""Largest motion of a joint, or change of its command, while it presses, in turns of its servo."""


@dataclass(slots=True)
class _Press:
    """Position and command of a joint (rad or m) when it began to press, and the number of cycles since then."""

    position: float
    command: float
    cycles: int = 0


class LongPressesAreReduced(Invariant):
    """If a joint with a torque limit below 1 presses without moving, its drive is reduced within ``REDUCED_S``.

    The drive is computed from the joint's effort in the simulated world. The time starts again when the joint or its
    command moves, when the joint is reported as faulty, and during each fault of the joint. A joint that is reported
    far outside its limits is skipped, because its goal cannot come closer to it than the limit.
    """

    name = "long presses are reduced"
    promised = False

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        reference, world = read_reference(stack.files), stack.world
        self._limited = [
            (joint, world.arrays.effort_at[world.joints.index(joint.name)], self.commanded.index(joint.name))
            for joint in self.joints
            if joint.name in reference and reference[joint.name].torque_limit < 1.0 and joint.name in self.commanded
        ]
        self._turns = {name: abs(joint.units_per_count) * joint.counts_per_turn for name, joint in reference.items()}
        self._limits = {name: joint.torque_limit for name, joint in reference.items()}
        self._presses: dict[str, _Press] = {}

    def on_state(self, state: JointState) -> None:
        true, period_s = self.true_positions(), self.stack.loop.period_s
        for joint, effort_at, place in self._limited:
            name, command = joint.name, float(self.stack.loop.command[place])
            drive = abs(float(self.stack.world.arrays.effort[effort_at])) / joint.full_effort
            at = self.stack.loop.hardware.joints.index(name)
            reported = abs(float(state.effort[at])) / joint.full_effort
            limit, position = self.stack.loop.limits[place], float(state.position[at])
            outside = max(limit.lower - position, position - limit.upper) > OUTSIDE_TURNS * self._turns[name]
            excused = outside or name in state.faults or self.stack.touches.since_s(name) < REDUCED_S
            if not self.active or excused or min(drive, reported) < PRESSES * self._limits[name]:
                self._presses.pop(name, None)
                continue
            press = self._presses.setdefault(name, _Press(true[name], command))
            still = STILL_TURNS * self._turns[name]
            if abs(true[name] - press.position) > still or not abs(command - press.command) <= still:
                press = self._presses[name] = _Press(true[name], command)
            press.cycles += 1
            self.examined += 1
            if press.cycles * period_s > REDUCED_S:
                share = drive / self._limits[name]
                self.say(f"{name} has pressed without motion for {REDUCED_S:g} s at {share:.0%} of its torque limit")
