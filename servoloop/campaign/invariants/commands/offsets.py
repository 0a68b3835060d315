"""Invariant on the offsets between goals and commands: they carry the weight of the arm, and they do not jump."""

import copy
import math
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from hal.lifecycle import LifecycleState
from hal.types import JointState
from servoloop.api.freedrive import FREEDRIVE
from servoloop.campaign.invariants.invariant import UNREAD, Invariant
from servoloop.campaign.invariants.reference import ReferenceJoint, read_reference
from servoloop.simulation.faulty_stack import FaultyStack
from sim_backend.line.spread import Quantity, Spread

STEADY_CYCLES: Final = 5
"""Minimum number of cycles for which a joint must be free before its offset is examined, and for which its command must
be constant before a jump of the offset is examined."""
SAME: Final = 1e-6
"""Largest change of a constant command per cycle, in rad or m."""
JUMP_COUNTS: Final = 8.0
"""Largest change of an offset per cycle while the command is constant, in counts. The damping of an oscillation changes
an offset by up to six counts."""
SLACK_COUNTS: Final = 4.0
"""Largest difference between an offset and its bounds that is due to damping and rounding, in counts."""
SAG_CYCLES: Final = 4
"""Number of cycles in which the sag of a joint is compared with a jump of its offset."""
AHEAD: Final = 2.0
"""Largest change of an offset, as a multiple of the change of the sag, because offsets are computed ahead of time."""
CARRIED: Final = 2.0
"""Minimum sag at which gravity holds a joint at one end of its backlash, as a multiple of the servo's dead band. A
joint with a smaller sag may oscillate. Its correction is then discarded at once."""
ROUNDED: Final = 0.51
"""Largest difference between a goal and its exact value, in counts."""
WEIGHT_SHARE: Final = 0.1
"""Largest difference between an offset and the sag due to the joint's weight, as a fraction of the sag."""
LEVER: Final = 0.1
"""Largest change of a joint's sag, in rad or m, per rad or m of the arm's joints."""
FADES_IN_S: Final = 1.0
"""Minimum time after its activation until the offset of a joint reaches its full size, in seconds."""
GUIDED_SHARE: Final = 0.8
"""Largest offset of a joint that is guided by hand, as a fraction of its sag."""
FORGETS_S: Final = 0.5
"""Time constant with which the correction of a joint decays while the arm is guided by hand, in seconds."""
MISSED_CYCLES: Final = 3
"""Maximum number of cycles without a reading of a joint in which its offset must not jump."""
NEAR_COUNTS: Final = 20.0
"""Largest distance of a joint from its command at which the joint counts as free, in counts."""


@dataclass(slots=True)
class _Goal:
    """Latest goal of a joint."""

    counts: int
    offset: float
    """Difference between the goal and the command, in counts of the servo, positive in the joint's direction."""


class OffsetsCarryTheWeight(Invariant):
    """The goal of a joint is offset from its command by the sag due to the joint's weight and a small correction.

    The weight is computed with MuJoCo, from the nominal masses of the scene and the commanded pose. The correction may
    cancel the sag of a joint that is held above its command. The offset of a joint that carries weight does not jump
    while the command is constant, for example when other joints are activated again. Each goal is the count that is
    nearest to the command plus the offset that the stack has computed. After an activation, the offset grows slowly
    from zero, so that the arm does not jump. While the arm is guided by hand, the offset carries only a part of the
    weight, so that the arm does not rise by itself. If a servo cannot be read for a few cycles, the offset of its joint
    does not jump. Otherwise, a joint with a fault, a joint that is far from its command and a joint whose servo may
    report a wrong position are skipped.
    """

    name = "offsets carry the weight"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        reference = read_reference(stack.files)
        self._reference = reference
        self._by_id = {
            bus: {joint.servo_id: joint for joint in reference.values() if joint.bus == bus} for bus in stack.lines
        }
        self._weight = _Weight(stack)
        known = {joint.name: joint.compliance for joint in self.joints if joint.name in self.driven_joints}
        self._compliances = {name: one for name, one in known.items() if one is not None}
        self._sagging = [name for name in self._compliances if name in reference]
        """Joints of the trajectory controllers whose sag is known."""
        self._goals: dict[str, _Goal] = {}
        self._jumps: dict[str, float] = {}
        """Largest change of each offset since the last cycle, in counts."""
        self._recent_sags = deque[Mapping[str, float]](maxlen=SAG_CYCLES)
        """Sags of the joints at their commands in the latest cycles, in rad or m, keyed by joint name."""
        self._errors: dict[str, float] = {}
        """Following error of each joint whose sag is known, in rad or m."""
        self._driven_cycles = Counter[str]()
        """Number of cycles since each joint was activated."""
        self._guided_cycles = 0
        """Number of cycles for which the arm has been guided by hand."""
        self._steady, self._free = Counter[str](), Counter[str]()
        """Number of cycles for which each command was constant, and number of cycles for which each joint was near its
        command, had no fault and was not stalled."""
        self._unread_cycles, self._kept = Counter[str](), Counter[str]()
        """Number of cycles for which each joint's servo could not be read, and for which each joint was free or missed
        only a few readings."""

    def on_goals(self, bus: str, goals: Mapping[int, int]) -> None:
        for servo_id, counts in goals.items():
            joint = self._by_id[bus].get(servo_id)
            if joint is None:
                continue
            command = float(self.stack.loop.command[self.commanded.index(joint.name)])
            offset = math.copysign(1.0, joint.units_per_count) * (
                counts - joint.zero_counts - command / joint.units_per_count
            )
            self._examine_rounding(joint, counts, command)
            last, self._goals[joint.name] = self._goals.get(joint.name), _Goal(counts, offset)
            if last is not None:
                self._jumps[joint.name] = max(self._jumps.get(joint.name, 0.0), abs(offset - last.offset))

    def _examine_rounding(self, joint: ReferenceJoint, counts: int, command: float) -> None:
        """Check that a goal that is not limited is the count that is nearest to command plus offset."""
        last, wanted = self._goals.get(joint.name), command + self._offset(joint.name)
        exact = joint.zero_counts + wanted / joint.units_per_count
        limit, unit = self.stack.loop.limits[self.commanded.index(joint.name)], abs(joint.units_per_count)
        reach = limit.velocity * self.stack.loop.period_s / unit
        free = last is not None and abs(exact - last.counts) < reach and self._free[joint.name] > STEADY_CYCLES
        if not free or self.stack.ending or not limit.lower + unit < wanted < limit.upper - unit:
            return
        self.examined += 1
        if abs(counts - exact) > ROUNDED:
            self.say(f"{joint.name} has the goal {counts}, but its command plus offset is {exact:.2f} counts")

    def _offset(self, joint: str) -> float:
        """Return the offset that the stack adds to the next command of a joint, in rad or m."""
        own = (one for one in self.stack.made if joint in one.joints)
        hardware = next((one for one in own if one.compensation is not None), None)
        if hardware is None or hardware.compensation is None:
            return 0.0
        return float(hardware.compensation.offsets[hardware.joints.index(joint)])

    def on_state(self, state: JointState) -> None:
        jumps, self._jumps = self._jumps, {}
        active = self.stack.loop.hardware.state is LifecycleState.ACTIVE
        guided = active and self._guided()
        if self._guided_cycles and not guided:
            self._forget()
        self._guided_cycles = self._guided_cycles + 1 if guided else 0
        released = self.released(state)
        for name in self._sagging:
            self._driven_cycles[name] = self._driven_cycles[name] + 1 if active and name not in released else 0
        if not active:
            self._goals.clear()
            self._forget()
            return
        self._count(state)
        near = {name for name in self._goals.keys() & self._sagging if self._free[name]}
        free = {name for name in near if self._free[name] > STEADY_CYCLES}
        kept = {name for name in jumps.keys() & self._sagging if self._kept[name] > STEADY_CYCLES}
        small = {name for name in near if self._steady[name] > 1 and (guided or self._fades_in(name))}
        if not free and not small and not kept:
            self._recent_sags.clear()
            return
        sags = self._sags()
        self._recent_sags.append(sags)
        for name in small:
            self._examine_size(name, [one[name] for one in self._recent_sags])
        if guided:
            return
        for name in kept:
            recent = [one[name] for one in self._recent_sags]
            if min(map(abs, recent)) > CARRIED * self._compliances[name].dead_band:
                self._examine_jump(name, jumps[name], max(recent) - min(recent))
        if all(self._free[name] > STEADY_CYCLES for name in self._sagging):
            for name in free:
                self._examine_weight(name, sags[name], sum(self._errors.values()))

    def _forget(self) -> None:
        self._steady.clear()
        self._free.clear()
        self._kept.clear()
        self._recent_sags.clear()

    def _fades_in(self, name: str) -> bool:
        """Return whether a joint was activated so recently that its offset is still growing."""
        return self._driven_cycles[name] * self.stack.loop.period_s < FADES_IN_S

    def _examine_size(self, name: str, recent: Sequence[float]) -> None:
        """Check that the offset of a joint is small after its activation and while the arm is guided by hand.

        ``recent`` contains the latest sags of the joint, in rad or m.
        """
        period_s, unit = self.stack.loop.period_s, abs(self._reference[name].units_per_count)
        most, spare = max(map(abs, recent)), self._compliances[name].uncorrected
        allowed = min((self._driven_cycles[name] + 2) * period_s / FADES_IN_S, 1.0) * (most + spare)
        guided_s = self._guided_cycles * period_s
        if guided_s > FADES_IN_S * (1.0 - GUIDED_SHARE):
            allowed = min(allowed, GUIDED_SHARE * most + spare * math.exp(-guided_s / FORGETS_S))
        allowed += SLACK_COUNTS * unit + AHEAD * (max(recent) - min(recent))
        offset = abs(self._goals[name].offset) * unit
        self.examined += 1
        if offset > allowed:
            when = "while it is guided by hand" if self._guided_cycles else "soon after its activation"
            self.say(f"the goal of {name} is offset by {offset:.4f}, but at most {allowed:.4f} is allowed {when}")

    def _examine_jump(self, name: str, jump: float, change: float) -> None:
        """Check that an offset changes only with the sag of its joint. ``change`` is the change of the sag, in rad or
        m."""
        if self._steady[name] <= STEADY_CYCLES or len(self._recent_sags) < SAG_CYCLES:
            return
        self.examined += 1
        if jump > JUMP_COUNTS + AHEAD * change / abs(self._reference[name].units_per_count):
            self.say(f"the command of {name} is constant, but its goal jumps by {jump:.1f} counts")

    def _sags(self) -> Mapping[str, float]:
        """Return the distance by which each joint would sag at its command without an offset, in rad or m."""
        torques = self._weight.torques(dict(zip(self.commanded, self.stack.loop.command.tolist(), strict=True)))
        return {name: torques[name] / self._compliances[name].stiffness for name in self._sagging}

    def _guided(self) -> bool:
        freedrive = self.stack.manager.registry.loaded.get(FREEDRIVE)
        return freedrive is not None and freedrive.active

    def _count(self, state: JointState) -> None:
        """Count the cycles in which each command was constant and each joint was free."""
        true, loop = self.true_positions(), self.stack.loop
        for place, name in enumerate(self.commanded):
            joint = self._reference.get(name)
            if joint is None:
                continue
            now, before = float(loop.command[place]), float(loop.previous_command[place])
            self._steady[name] = self._steady[name] + 1 if abs(now - before) <= SAME else 0
            health, apart = state.health.get(name), abs(true[name] - now)
            unknown = health is None or health.stall is not None
            near = apart <= NEAR_COUNTS * abs(joint.units_per_count) and not self.deceived(name)
            free = near and not unknown and name not in state.faults
            self._free[name] = self._free[name] + 1 if free else 0
            unread = name in state.faults and state.faults[name].kind in UNREAD
            self._unread_cycles[name] = self._unread_cycles[name] + 1 if unread else 0
            missed = near and 0 < self._unread_cycles[name] <= MISSED_CYCLES
            self._kept[name] = self._kept[name] + 1 if free or missed else 0
            if name in self._sagging:
                self._errors[name] = apart

    def _examine_weight(self, name: str, sag: float, apart: float) -> None:
        """Compare the offset of a joint with its weight. ``apart`` is the sum of all following errors, in rad or m."""
        self.examined += 1
        unit, spare = abs(self._reference[name].units_per_count), self._compliances[name].uncorrected
        offset = self._goals[name].offset * unit
        slack = SLACK_COUNTS * unit + WEIGHT_SHARE * abs(sag) + LEVER * apart
        low, high = (min(sag - spare, 0.0), sag + spare) if sag >= 0.0 else (sag - spare, max(sag + spare, 0.0))
        if not low - slack <= offset <= high + slack:
            self.say(f"the goal of {name} is offset by {offset:+.4f}, but its weight makes it sag by {-sag:+.4f}")


class _Weight:
    """Weights of the arm, computed by MuJoCo for the nominal masses of the scene."""

    def __init__(self, stack: FaultyStack) -> None:
        self._world = stack.world
        self._model: Any = copy.copy(stack.world.model)
        if stack.build.seed is not None:
            spread = Spread(stack.build.seed)
            self._model.body_mass /= [spread.factor(Quantity.MASS, body) for body in range(self._model.nbody)]
        self._data: Any = mujoco.MjData(self._model)
        described = {name: self._model.joint(name) for name in stack.world.joints}
        self._positions = {name: int(one.qposadr[0]) for name, one in described.items()}
        self._velocities = {name: int(one.dofadr[0]) for name, one in described.items()}

    def torques(self, positions: Mapping[str, float]) -> Mapping[str, float]:
        """Return the torque or force that carries each joint's weight at these joint positions, in N m or N."""
        self._data.qpos[:] = self._world.data.qpos
        for name, position in positions.items():
            if name in self._positions and math.isfinite(position):
                self._data.qpos[self._positions[name]] = position
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_comVel(self._model, self._data)
        torques = np.zeros(self._model.nv)
        mujoco.mj_rne(self._model, self._data, 0, torques)
        return {name: float(torques[place]) for name, place in self._velocities.items()}
