"""Invariant on the state of the arm after the program has ended."""

import re
from collections.abc import Callable, Collection, Iterable
from typing import Final

import numpy as np

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from drivers.servos.catalog import series_of
from hal.joint import Joint
from hal.lifecycle import LifecycleState
from hal.types import FloatArray, JointState
from servoloop.campaign.invariants.invariant import Invariant
from servoloop.campaign.invariants.lifecycle.activation import CHANGES, wrong_torque_limit
from servoloop.campaign.invariants.motion.rest import CREEPS, PRESSES_SHARE
from servoloop.campaign.invariants.reference import read_reference
from servoloop.campaign.invariants.reports.servos import LOSING
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.touches import touched_joints

WRITES_AGAIN_S: Final = 2.0
"""Maximum time, in seconds, that the stack needs to repeat a register write after a fault."""


STOPPED: Final = 0.005
"""Tolerance for the position at which a joint stops before the arm is parked, in rad or m."""
STOPPED_PERIODS: Final = 2.0
"""Number of periods that a joint may move on before it stops, in addition to its braking distance."""
FAILED: Final = "could not "
"""Beginning of the message about a step of the shutdown that failed. Errors of single servos begin differently."""
OF_TORQUE: Final = ("could not switch", "could not release ")
"""Beginnings of the messages about a step that disables torque."""


class EndsAsChosen(Invariant):
    """At the end, the arm is held, or parked and released, as ``on_exit`` specifies, provided that its servos can be
    reached.

    A servo that should hold may still disable its torque to protect itself and report an error. The joints of a held
    arm do not press against an obstacle, and each has the torque limit from the robot file. A joint that is affected by
    a fault while the program ends is exempt, unless the fault is a gear that jammed earlier. No fault exempts a joint
    from the report of the program: if a released joint is still driven, the program has reported this joint. A joint
    that the park pose does not name stays where it stopped. The servos of a lost component of a held arm stay driven.
    """

    name = "ends as chosen"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._reference = read_reference(stack.files, stack.narrowed)
        self._driven: set[str] = set()
        """Joints without a fault that were driven in the last cycle."""
        self._lost: set[str] = set()
        """Joints of lost components that were driven in the last cycle."""
        self._inactive = False
        """Whether a client had deactivated the hardware by the last cycle, in which case the torque is left
        unchanged."""
        self._begin: tuple[FloatArray, FloatArray] | None = None
        """Command of each joint in the last cycle before the end, in rad or m, and its velocity."""
        self._ran = False
        """Whether the hardware was active in any cycle. If not, the failed start has been reported."""
        self._happened = 0
        """Number of faults that had begun or ended by the last cycle."""

    def on_state(self, state: JointState) -> None:
        self._happened = len(self.stack.player.happened)
        self._inactive = self.stack.loop.hardware.state is LifecycleState.INACTIVE
        healthy = {joint.name for joint in self.joints if joint.name not in state.faults and self.torque(joint)}
        self._driven = healthy if self.active else set()
        lost = {joint for component in self.stack.loop.hardware.lost for joint in component.hardware.joints}
        self._lost = {joint.name for joint in self.joints if joint.name in lost and self.torque(joint)}

        self._ran = self._ran or self.active
        if not self.stack.ending:
            loop = self.stack.loop
            self._begin = loop.command.copy(), (loop.command - loop.previous_command) / loop.period_s

    def at_end(self) -> None:
        affected = self._affected_at_the_end({"jammed"})
        on = {joint.name for joint in self.joints if self.torque(joint)}
        driven = self._driven - affected
        self.examined += len(driven)
        if not self.stack.control_stack.releases:
            without_error = {joint.name for joint in self.joints if not self.reports_error(joint)}
            self._report("released instead of held", (driven & without_error) - on)
            lost = (self._lost & without_error) - self._affected_at_the_end({"jammed", LOSING})
            self.examined += len(lost)
            self._report("released instead of held, although its component was lost", lost - on)
            for joint in self.joints:
                if joint.name in driven & on:
                    self._examine_limit(joint)
            arms = [one for one in self.stack.arms if driven >= set(one.joints) and not self._has_failed(one.name)]
            relieved = {joint for arm in arms for joint in arm.joints} & without_error
            self._report("pressing", {joint for joint in relieved if self._presses(joint)})
            return
        reached = {joint.name for joint in self.joints if self.stack.adapters[joint.bus].reachable} - affected
        if not self._inactive:
            self.examined += len(reached)
            self._report("torque still enabled", on & reached)
            if self._ran:
                self._report("torque still enabled, which was not reported", on - self._reported() - self.sharing_id)
        self._report("not parked", self._not_parked() & driven)
        self._report("moved while the arm was parked", self._moved() & driven)

    def _reported(self) -> set[str]:
        """Return the joints that the program has reported because their torque may still be enabled.

        A failure names a joint, its servo, its port or its component. A robot with one component does not name this
        component.
        """
        components = self.stack.loop.hardware.components
        texts = [text for text in self.stack.end_problems if text.startswith(OF_TORQUE) or not text.startswith(FAILED)]
        reported = {joint for one in components if _named(one.name, texts) for joint in one.hardware.joints}
        if len(components) == 1 and any(text.startswith(OF_TORQUE) for text in texts):
            reported.update(components[0].hardware.joints)
        for joint in self.joints:
            names = joint.name, f"servo {joint.servo_id}", self.stack.ports[joint.bus].name
            if any(_named(name, texts) for name in names):
                reported.add(joint.name)
        return reported

    def _has_failed(self, controller: str) -> bool:
        """Return whether a fault prevents a trajectory controller from relieving its joints.

        The controller has failed, or its commands are not finite at the end.
        """
        failed = [one for one in self.stack.player.happened if one.kind == "controller_raises"]
        failed += [one for one in self.stack.player.active.values() if one.kind == "controller_nan"]
        return any(getattr(one, "controller", None) in (None, controller) for one in failed)

    def _settings_changed(self, joint: str) -> bool:
        """Return whether a fault may have changed the registers of a joint's servo, or prevented writes to them."""
        kinds = self.stack.touches.kinds(joint)
        return bool(kinds & CHANGES) or self.stack.touches.since_s(joint) < WRITES_AGAIN_S

    def _examine_limit(self, joint: Joint) -> None:
        limited = joint.name in self._reference and series_of(joint.model).torque_limit is not None
        if not limited or self._settings_changed(joint.name):
            return
        self.examined += 1
        if problem := wrong_torque_limit(joint, self.servos[joint.name].memory, self._reference[joint.name]):
            self.say(problem)

    def _presses(self, joint: str) -> bool:
        """Return whether a joint of the arm is held far from its command although it was not moved by hand.

        A joint that still moves is pushed by a neighbor, such as a limp joint that sinks.
        """
        if joint not in self.driven_joints or self.deceived(joint):
            return False
        world = self.stack.world
        if abs(float(world.velocity()[world.joints.index(joint)])) > CREEPS:
            return False
        limit = self.stack.loop.limits[self.commanded.index(joint)]
        off = self.off_command(joint, self.true_positions()[joint])
        return off > PRESSES_SHARE * (limit.upper - limit.lower)

    def _affected_at_the_end(self, lasting: Collection[str]) -> set[str]:
        """Return the joints that faults have affected since the last cycle.

        Faults of the kinds ``lasting`` that began earlier are not an excuse. For example, the stack must relieve a
        joint whose gears have jammed.
        """
        active = (event for event in self.stack.player.active.values() if event.kind not in lasting)
        events = (*self.stack.player.happened[self._happened :], *active)
        if any(event.kind == "stall" for event in events):
            return {joint.name for joint in self.joints}
        return {name for event in events for name in touched_joints(event, self.joints)}

    def _not_parked(self) -> set[str]:
        park = None if self.stack.hurried else self.stack.files.robot.file.park
        commands = dict(zip(self.commanded, self.stack.loop.command, strict=True))
        pose = park.pose if park else {}
        return {name for name, position in pose.items() if not np.isclose(commands[name], position, atol=1e-6)}

    def _moved(self) -> set[str]:
        """Return the joints that the park pose does not name and that do not stay where they stop."""
        park = None if self.stack.hurried else self.stack.files.robot.file.park
        if park is None or self._begin is None:
            return set()
        moved = set[str]()
        ends = zip(self.commanded, *self._begin, self.stack.loop.command, self.stack.loop.limits, strict=True)
        for name, start, velocity, end, limit in ends:
            stop = start + velocity * abs(velocity) / (2.0 * limit.acceleration)
            low, high = sorted(min(max(one, limit.lower), limit.upper) for one in (start, stop))
            slack = STOPPED + STOPPED_PERIODS * abs(velocity) * self.stack.loop.period_s
            if name not in park.pose and not low - slack <= end <= high + slack:
                moved.add(name)
        return moved

    def _report(self, state: str, joints: set[str]) -> None:
        if joints:
            self.say(f"{state}: {', '.join(sorted(joints))}")


def _named(name: str, texts: Iterable[str]) -> bool:
    """Return whether one of the texts contains a name as a whole word."""
    return any(re.search(rf"\b{re.escape(name)}\b", text) for text in texts)
