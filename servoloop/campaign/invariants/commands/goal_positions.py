"""Invariant that compares the goals on the buses with the commands of the joints."""

import math
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.types import JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.campaign.invariants.reference import read_reference
from servoloop.simulation.faulty_stack import FaultyStack

READING_COUNTS: Final = 4.0
"""Tolerance for the resolution and noise of a servo reading, in counts."""
OFFSET_SHARE: Final = 0.03
"""Largest gravity offset between goal and command, as a fraction of the joint's range."""
OFFSET: Final = 0.006
"""Smallest compensation offset whose direction is checked, in rad or m: several counts of a servo."""
LOADED: Final = 0.15
"""Minimum holding effort at which the direction of the offset is checked, as a fraction of the full effort. A joint
with a smaller holding effort may also have an offset against friction.
"""
NEAR_COMMAND: Final = 0.05
"""Maximum following error at which a joint counts as free, in rad or m."""
CONTACT: Final = 0.5
"""Maximum effort of contacts and friction on a free joint, as a fraction of its holding effort."""
BLOCKED_CYCLES: Final = 5
"""Minimum number of cycles for which a joint must be at rest away from its goal before the distance to the goal is
checked."""
LEAD: Final = 0.05
"""Allowed distance between a goal and a blocked joint, in rad or m, beyond the distance for full drive and two cycles
of motion."""
CYCLES_WITHOUT_GOAL: Final = 3
"""Maximum number of cycles for which a driven joint receives no goal."""
STANDS: Final = 0.01
"""Speed below which a joint is at rest, in rad/s or m/s."""
STANDS_CYCLES: Final = 10
"""Minimum number of cycles for which a joint must be at rest before the direction of its offset is checked."""


class GoalsMeanCommands(Invariant):
    """A goal on the bus, when converted independently, equals the joint's command or lies between the command and the
    joint.

    Every driven joint receives a goal in each cycle.

    The goal may differ by the compensation for the servo's compliance, within narrow bounds. Goals change at a limited
    speed, so a goal outside this range may still be approaching it. The compensation for a joint at rest acts against
    the gravity torque in the simulated world.
    """

    name = "goals mean commands"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        reference = read_reference(stack.files)
        self._joints = {
            bus: {joint.servo_id: joint for joint in reference.values() if joint.bus == bus} for bus in stack.lines
        }
        self._known = reference
        self._places = {joint: place for place, joint in enumerate(self.commanded)}
        self._offsets = {
            joint.name: OFFSET_SHARE * (joint.limits.upper - joint.limits.lower)
            + (joint.compliance.uncorrected if joint.compliance else 0.0)
            for joint in self.joints
        }
        """Largest compensation offset of each joint, in rad or m: the gravity offset and the slow correction."""
        self._last: dict[str, float] = {}
        """Position of each joint's last goal."""
        self._dofs = dict(zip(stack.world.joints, stack.world.arrays.velocity_at, strict=True))
        """Index of each joint in MuJoCo's arrays of forces."""
        self._loaded = {joint.name: LOADED * joint.full_effort for joint in self.joints}
        period_s = stack.loop.period_s
        self._lead = {
            joint.name: joint.full_effort / joint.compliance.stiffness + 2.0 * joint.limits.velocity * period_s + LEAD
            for joint in self.joints
            if joint.compliance is not None and joint.name in self.driven_joints
        }
        """Maximum distance of a goal from a blocked joint, in rad or m, keyed by joint name."""
        self._ahead: dict[str, float] = {}
        """Distance of each joint's goal from the joint in the previous cycle, in rad or m."""
        self._approach = {joint.name: 0.5 * joint.limits.velocity * period_s for joint in self.joints}
        """Minimum decrease of the distance ``_ahead`` in a cycle at which a goal counts as approaching its joint, in
        rad or m."""
        self._blocked = Counter[str]()
        """Number of cycles in which the goal of each joint at rest has been farther from the joint than ``_lead``."""
        self._stands = Counter[str]()
        """Number of cycles for which each joint of the arm has been at rest near its command."""
        self._without_goal = Counter[str]()
        """Number of cycles since each driven joint received a goal."""
        self._without_goal_cycles = {
            joint: CYCLES_WITHOUT_GOAL * component.cycles_per_update
            for component in stack.loop.hardware.components
            for joint in component.hardware.joints
        }
        """Maximum number of cycles without a goal, keyed by joint name."""

    def on_state(self, state: JointState) -> None:
        self._examine_rate(state)
        if not self.active:
            self._stands.clear()
            self._blocked.clear()
            return
        world, true = self.stack.world, self.true_positions()
        speeds = dict(zip(world.joints, np.abs(world.velocity()).tolist(), strict=True))
        weights, contacts = world.data.qfrc_bias, world.data.qfrc_constraint
        for joint in self.driven_joints:
            if joint in state.faults:
                self._stands[joint] = self._blocked[joint] = 0
                continue
            self._examine_lead(joint, true[joint], speeds[joint])
            command = float(self.stack.loop.command[self._places[joint]])
            offset = self._last.get(joint, command) - command
            holding, contact = float(weights[self._dofs[joint]]), float(contacts[self._dofs[joint]])
            free = abs(true[joint] - command) < NEAR_COMMAND and abs(contact) < CONTACT * abs(holding)
            free = free and not self.deceived(joint)
            if speeds[joint] > STANDS or not free or abs(offset) < OFFSET or abs(holding) < self._loaded[joint]:
                self._stands[joint] = 0
                continue
            self._stands[joint] += 1
            if self._stands[joint] > STANDS_CYCLES and holding * offset < 0.0:
                self.say(
                    f"the goal of {joint} is offset by {offset:+.4f}, but the holding effort, {holding:+.3f}, has the "
                    "opposite sign"
                )

    def _examine_rate(self, state: JointState) -> None:
        """Check that every driven joint received a goal in the latest cycles."""
        active = self.active
        for joint in self.joints:
            driven = active and joint.name not in state.faults and self.torque(joint)
            self._without_goal[joint.name] = self._without_goal[joint.name] + 1 if driven else 0
            if self._without_goal[joint.name] > self._without_goal_cycles[joint.name]:
                self.say(f"{joint.name} has received no goal for {self._without_goal[joint.name]} cycles")

    def _examine_lead(self, joint: str, true: float, speed: float) -> None:
        """Check that the goal of a blocked joint is not further ahead than full drive requires.

        Otherwise, the joint would jump as soon as it is free. A joint that was turned beyond its limits is skipped,
        because its servo may press in the direction of the other limit. A goal that approaches a joint that was thrown
        far away is also skipped, because goals change at a limited speed. Such a goal may approach the long way around.
        """
        known, goal = self._known.get(joint), self._last.get(joint)
        inside = known is not None and known.lower - LEAD <= true <= known.upper + LEAD and not known.turned(true)
        ahead = known.apart(goal, true) if known is not None and inside and goal is not None else 0.0
        straight = abs(goal - true) if goal is not None else 0.0
        approaches = self._ahead.get(joint, straight) - straight > self._approach[joint]
        self._ahead[joint] = straight
        if speed > STANDS or ahead <= self._lead.get(joint, math.inf) or approaches or self.deceived(joint):
            self._blocked[joint] = 0
            return
        self._blocked[joint] += 1
        if self._blocked[joint] > BLOCKED_CYCLES:
            self.say(f"{joint} is blocked at {true:.4f}, but its goal is {ahead:.4f} ahead")

    def on_goals(self, bus: str, goals: Mapping[int, int]) -> None:
        if not self.active:
            return
        commands, before = self.stack.loop.command.tolist(), self.stack.loop.previous_command.tolist()
        true = self.true_positions()
        for servo_id, counts in goals.items():
            joint = self._joints[bus].get(servo_id)
            if joint is not None:
                self._without_goal[joint.name] = 0
            if joint is None or self.deceived(joint.name):
                continue
            self.examined += 1
            place = self._places[joint.name]
            meant, command = joint.position(counts), commands[place]
            reported = joint.readings(true[joint.name], READING_COUNTS)
            ends = (command, before[place], *reported)
            slack = self._offsets[joint.name]
            low, high = min(ends) - slack, max(ends) + slack
            last, self._last[joint.name] = self._last.get(joint.name, command), meant
            if _outside(meant, low, high) > _outside(last, low, high):
                self.say(f"{joint.name}: goal {counts} stands for {meant:.4f}, but the command is {command:.4f}")


def _outside(value: float, low: float, high: float) -> float:
    """Return the distance between a value and a range."""
    return max(low - value, value - high, 0.0)
