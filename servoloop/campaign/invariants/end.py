"""Invariant on the state of the arm after the program has ended."""

from collections.abc import Callable
from typing import Final

import numpy as np

from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from drivers.servos.catalog import series_of
from hal.joint import Joint
from hal.lifecycle import LifecycleState
from hal.types import JointState
from servoloop.campaign.invariants.activation import CHANGES, wrong_torque_limit
from servoloop.campaign.invariants.invariant import Invariant, reports_error
from servoloop.campaign.invariants.reference import read_reference
from servoloop.campaign.invariants.rest import CREEPS, PRESSES_SHARE
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.touches import touched_joints

WRITES_AGAIN_S: Final = 2.0
"""Maximum time, in seconds, that the stack needs to repeat a register write after a fault."""


class EndsAsChosen(Invariant):
    """At the end, the arm is held, or parked and released, as ``on_exit`` specifies, provided that its servos can be
    reached.

    A servo that should hold may still disable its torque to protect itself and report an error. The joints of a held
    arm do not press against an obstacle, and each has the torque limit from the robot file. A joint that is affected by
    a fault while the program ends is exempt, unless the fault is a gear that jammed earlier.
    """

    name = "ends as chosen"

    def __init__(self, stack: FaultyStack, say: Callable[[str], None], arm: JointTrajectoryController) -> None:
        super().__init__(stack, say, arm)
        self._reference = read_reference(stack.files, stack.narrowed)
        self._driven: set[str] = set()
        """Joints without a fault that were driven in the last cycle."""
        self._inactive = False
        """Whether a client had deactivated the hardware by the last cycle, in which case the torque is left
        unchanged."""
        self._happened = 0
        """Number of faults that had begun or ended by the last cycle."""

    def on_state(self, state: JointState) -> None:
        self._happened = len(self.stack.player.happened)
        self._inactive = self.stack.loop.hardware.state is LifecycleState.INACTIVE
        healthy = {joint.name for joint in self.joints if joint.name not in state.faults and self.torque(joint)}
        self._driven = healthy if self.active else set()

    def at_end(self) -> None:
        affected = self._affected_at_the_end()
        on = {joint.name for joint in self.joints if self.torque(joint)}
        driven = self._driven - affected
        self.examined += len(driven)
        if not self.stack.control_stack.releases:
            without_error = {joint.name for joint in self.joints if not reports_error(joint, self.servos[joint.name])}
            self._report("released instead of held", (driven & without_error) - on)
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
        self._report("not parked", self._not_parked() & driven)

    def _has_failed(self, controller: str) -> bool:
        """Return whether a fault has made a trajectory controller fail, so that it can no longer relieve its joints."""
        faults = (one for one in self.stack.player.happened if one.kind == "controller_raises")
        return any(getattr(one, "controller", None) in (None, controller) for one in faults)

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

    def _affected_at_the_end(self) -> set[str]:
        """Return the joints that faults have affected since the last cycle.

        Gears that jammed earlier are not an excuse, because the stack must relieve the joint.
        """
        lasting = (event for event in self.stack.player.active.values() if event.kind != "jammed")
        events = (*self.stack.player.happened[self._happened :], *lasting)
        if any(event.kind == "stall" for event in events):
            return {joint.name for joint in self.joints}
        return {name for event in events for name in touched_joints(event, self.joints)}

    def _not_parked(self) -> set[str]:
        park = self.stack.files.robot.file.park
        commands = dict(zip(self.commanded, self.stack.loop.command, strict=True))
        pose = park.pose if park else {}
        return {name for name, position in pose.items() if not np.isclose(commands[name], position, atol=1e-6)}

    def _report(self, state: str, joints: set[str]) -> None:
        if joints:
            self.say(f"{state}: {', '.join(sorted(joints))}")
