"""Leader and follower under one loop: both are read in the same cycle."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from controller.loop import ControlLoop
from controller.teleop.leader_follower_controller import FollowedJoint, LeaderFollowerController
from drivers.clock import Clock
from drivers.errors import DriverError
from drivers.port import Port
from drivers.port.serial_port import SerialPort
from hal.components.component import Component
from hal.components.component_set import ComponentSet
from hal.servos.leader_arm import LEADER, LeaderArm, leader_joint
from hal.servos.limp_arm import release_question
from hal.types import JointState
from servoloop.stack import hardware
from servoloop.stack.background_worker import BackgroundWorker
from servoloop.stack.control_stack import ControlStack
from servoloop.stack.hardware import HardwareKind, HardwareSetup, OpenPort, open_buses
from servoloop.stack.robot_files import Files

if TYPE_CHECKING:
    from servoloop.stack.virtual_lines import VirtualLines


class TeleopError(DriverError):
    """The two arms cannot be leader and follower."""


class Latency:
    """Counts, at the end of each cycle, how old the leader's angles are whose goals have just been sent."""

    def __init__(self, clock: Clock, measured_s: Callable[[], float]) -> None:
        """``measured_s``: when the leader was measured last, on the clock."""
        self._clock, self._measured_s = clock, measured_s
        self._last_s = 0.0
        self.state: JointState | None = None
        """The newest measurement of both arms."""
        self.ages_s: list[float] = []
        """One for each cycle in which the leader was measured: 50 Hz for an hour are 180,000."""

    def on_cycle(self, state: JointState) -> None:
        """The goals are on the wire by now."""
        self.state, measured_s = state, self._measured_s()
        if measured_s != self._last_s:
            self._last_s = measured_s
            self.ages_s.append(self._clock.now() - measured_s)

    @property
    def summary(self) -> str:
        """For people."""
        if not self.ages_s:
            return "the leader was never measured"
        ages_ms = np.array(self.ages_s) * 1e3
        return (
            f"from the leader's angles to the follower's goals: median {np.median(ages_ms):.1f} ms, "
            f"99 % within {np.percentile(ages_ms, 99):.1f} ms, at most {ages_ms.max():.1f} ms"
        )


NAME: Final = "leader_follower_controller"


@dataclass(frozen=True, slots=True)
class Side:
    """One of the two arms: its files, and its devices by bus. ``lines``: virtual ones in this process."""

    files: Files
    devices: Mapping[str, str]
    lines: "VirtualLines | None" = None

    @property
    def open_port(self) -> OpenPort:
        """Opens a device of this side."""
        return self.lines.open if self.lines else SerialPort


@dataclass(frozen=True, slots=True)
class Teleop:
    """Both arms, not yet configured."""

    stack: ControlStack
    controller: LeaderFollowerController
    latency: Latency
    leader_arm: LeaderArm

    @property
    def loop(self) -> ControlLoop:
        """The loop that reads both arms and writes to the follower."""
        return self.stack.loop

    @property
    def leader(self) -> Component:
        """The component of the leader."""
        component = self.loop.hardware.component(LEADER)
        assert component is not None
        return component

    @property
    def lost(self) -> list[Component]:
        """The follower's components that are lost."""
        return [component for component in self.loop.hardware.lost if component is not self.leader]


def build_teleop(
    leader: Side,
    follower: Side,
    clock: Clock,
    worker: BackgroundWorker,
    tap: Callable[[Port, Clock], Port] = lambda port, clock: port,
) -> Teleop:
    """Make both arms' hardware, the controller and the loop, at the rate of the follower's controllers file.

    ``tap`` may put something around each port. Raises TeleopError where a joint of the follower has none to follow.
    """
    files = follower.files

    def open_leader(device: str, baud: int, clock: Clock) -> Port:
        return tap(leader.open_port(device, baud, clock), clock)

    setup = hardware.build(HardwareKind.SERVOS, files, follower.devices, clock, follower.lines, tap)
    read = LeaderArm(
        leader.files.robot.joints,
        lambda: open_buses(leader.files.robot.file, leader.devices, clock, open_port=open_leader),
        clock,
    )
    components = ComponentSet([*(one.hardware for one in setup.hardware.components), read], clock)
    stack = ControlStack.build(replace(setup, hardware=components), files, clock, worker, keep_alive=True)
    controller = LeaderFollowerController(NAME, followed_joints(leader.files, files, setup), components.joints)
    stack.loop.manager.registry.add(controller)
    latency = Latency(clock, lambda: read.measured_s)
    stack.loop.on_cycle = latency.on_cycle
    return Teleop(stack, controller, latency, read)


def release_leader(both: Teleop, confirm: Callable[[str], None]) -> None:
    """Make the leader limp. ``confirm`` is asked first if its servos hold torque: it may be the follower's port.

    Raises what ``confirm`` raises, DriverError, and ActivationError if a servo may still hold torque.
    """
    if servos := both.leader_arm.held():
        confirm(f"The leader must be limp. {release_question(servos)}")
    both.leader_arm.release()


def followed_joints(leader: Files, follower: Files, setup: HardwareSetup) -> list[FollowedJoint]:
    """Each of the follower's joints with the leader's of the same name.

    The hand opens by as large a share of its range as the leader's, for a trigger is no jaw; all others turn by the
    same angle. Raises TeleopError.
    """
    theirs = {joint.name: joint for joint in leader.robot.joints}
    if missing := [joint.name for joint in follower.robot.joints if joint.name not in theirs]:
        raise TeleopError(
            f"{leader.arm} has no {', '.join(missing)}, which {follower.arm} has: a leader has joints of the same names"
        )
    hands = hand_joints(follower)
    made = []
    for joint in follower.robot.joints:
        gain, offset, theirs_too = 1.0, 0.0, theirs[joint.name]
        if joint.name in hands:
            ours, its = joint.limits, theirs_too.limits
            gain = (ours.upper - ours.lower) / (its.upper - its.lower)
            offset = ours.lower - gain * its.lower
        made.append(
            FollowedJoint(
                joint.name, leader_joint(joint.name), joint.limits, offset, gain, setup.compliances.get(joint.name)
            )
        )
    return made


def hand_joints(files: Files) -> set[str]:
    """The joints of controllers that are no arm's: of grippers and forward commands."""
    arm = {
        joint
        for spec in files.controllers.controllers
        if spec.kind.endswith("JointTrajectoryController")
        for joint in getattr(spec.parameters, "joints", ())
    }
    return {joint for component in files.description.components for joint in component.joints} - arm
