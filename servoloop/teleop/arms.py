"""Build a leader and a follower with one control loop, which reads both arms in the same cycle."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from controller.loop import ControlLoop
from controller.teleop.leader_follower_controller import FollowedJoint, LeaderFollowerController
from drivers.clock import Clock
from drivers.driver_errors import DriverError
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
    """Raised when two arms cannot be used as leader and follower."""


class Latency:
    """Latency from the leader's measurement to the follower's goals, recorded at the end of each cycle."""

    def __init__(self, clock: Clock, measured_s: Callable[[], float]) -> None:
        """``measured_s`` returns the time of the leader's last measurement."""
        self._clock, self._measured_s = clock, measured_s
        self._last_s = 0.0
        self.state: JointState | None = None
        """Latest joint state of both arms."""
        self.ages_s: list[float] = []
        """Latency of each cycle in which the leader was measured, in seconds. One hour at 50 Hz produces 180,000
        values."""

    def on_cycle(self, state: JointState) -> None:
        """Record the latency. The goals of this cycle have been sent."""
        self.state, measured_s = state, self._measured_s()
        if measured_s != self._last_s:
            self._last_s = measured_s
            self.ages_s.append(self._clock.now() - measured_s)

    @property
    def summary(self) -> str:
        """Latency statistics as a sentence."""
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
    """Leader or follower, with its files and the device of each bus. ``lines`` are virtual buses in this process."""

    files: Files
    devices: Mapping[str, str]
    lines: "VirtualLines | None" = None

    @property
    def open_port(self) -> OpenPort:
        """Function that opens a device of this arm."""
        return self.lines.open if self.lines else SerialPort


@dataclass(frozen=True, slots=True)
class Teleop:
    """Leader and follower, not yet configured."""

    stack: ControlStack
    controller: LeaderFollowerController
    latency: Latency
    leader_arm: LeaderArm

    @property
    def loop(self) -> ControlLoop:
        """Control loop that reads both arms and writes to the follower."""
        return self.stack.loop

    @property
    def leader(self) -> Component:
        """Hardware component of the leader."""
        component = self.loop.hardware.component(LEADER)
        assert component is not None
        return component

    @property
    def lost(self) -> list[Component]:
        """Components of the follower that were lost."""
        return [component for component in self.loop.hardware.lost if component is not self.leader]


def build_teleop(
    leader: Side,
    follower: Side,
    clock: Clock,
    worker: BackgroundWorker,
    tap: Callable[[Port, Clock], Port] = lambda port, clock: port,
) -> Teleop:
    """Create the hardware of both arms, the controller, and the loop, which runs at the rate in the follower's
    controllers file.

    Args:
        leader: Files and devices of the leader.
        follower: Files and devices of the follower.
        clock: Clock of the loop.
        worker: Worker for tasks that take longer than a cycle.
        tap: Function that wraps each port, for example to record its bytes.

    Raises:
        TeleopError: The leader lacks a joint of the follower.
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
    """Make the leader limp.

    If torque is enabled on any leader servo, ask ``confirm`` first, because the ports of the leader and the follower
    may be swapped.

    Args:
        both: Leader and follower.
        confirm: Function that asks a question and raises an error unless the answer is yes.

    Raises:
        DriverError: The leader cannot be reached.
        ActivationError: The torque of a servo may still be enabled.
    """
    if servos := both.leader_arm.held():
        confirm(f"The leader must be limp. {release_question(servos)}")
    both.leader_arm.release()


def followed_joints(leader: Files, follower: Files, setup: HardwareSetup) -> list[FollowedJoint]:
    """Map each follower joint to the leader joint with the same name.

    The follower's hand moves to the same fraction of its range as the leader's trigger. All other joints follow the
    angle of the corresponding leader joint. Raises TeleopError if the leader lacks a joint.
    """
    leaders = {joint.name: joint for joint in leader.robot.joints}
    if missing := [joint.name for joint in follower.robot.joints if joint.name not in leaders]:
        raise TeleopError(
            f"{leader.arm} lacks {', '.join(missing)}: a leader must have all joints of its follower ({follower.arm})"
        )
    hands = follower.hand_joints
    made = []
    for joint in follower.robot.joints:
        gain, offset = 1.0, 0.0
        if joint.name in hands:
            own, lead = joint.limits, leaders[joint.name].limits
            gain = (own.upper - own.lower) / (lead.upper - lead.lower)
            offset = own.lower - gain * lead.lower
        made.append(
            FollowedJoint(
                joint.name, leader_joint(joint.name), joint.limits, offset, gain, setup.compliances.get(joint.name)
            )
        )
    return made
