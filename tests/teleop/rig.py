"""Two virtual arms in simulated time: a leader moved by hand, and its follower."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from controller.component_transitions import run_at_once
from drivers.clock import Clock
from drivers.driver_errors import PortMissing
from drivers.port import Port
from hal.components.component_lifecycle import configure_all
from hal.types import FloatArray, JointState
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.robot_files import Files
from servoloop.stack.virtual_lines import VirtualLines
from servoloop.teleop.arms import Side, Teleop, build_teleop, release_leader
from servoloop.teleop.attendance import HINT, Attendance
from servoloop.teleop.screen import status_line
from sim_backend.buses.build import Build
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock

LEADER, FOLLOWER = read_arm_files(find_arm("so101_leader")), read_arm_files(find_arm("so101"))
REST = {"shoulder_pan": 0.0, "shoulder_lift": -0.9, "elbow_flex": 0.9, "wrist_flex": 0.6, "wrist_roll": 0.0}


class Lines(VirtualLines):
    """Virtual lines whose adapters can be unplugged and plugged in again."""

    def __init__(self, files: Files, pose: Mapping[str, float], on_step: Callable[[float], None]) -> None:
        names = [joint.name for joint in files.robot.joints]
        super().__init__(files, Build(), [pose.get(name, 0.0) for name in names], on_step)
        self.plugged = True
        self.port: VirtualPort | None = None

    def open(self, device: str, baud: int, clock: Clock) -> Port:
        if not self.plugged:
            raise PortMissing(f"{device} is not there: plug it in")
        port = super().open(device, baud, clock)
        assert isinstance(port, VirtualPort)
        self.port = port
        return port

    def unplug(self) -> None:
        self.plugged = False
        if self.port is not None:
            self.port.unplug()


class Watcher:
    """User interface whose keys the test presses. The user interface records the displayed lines."""

    hint = HINT

    def __init__(self) -> None:
        self.held, self.typed = True, list[str]()
        self.shown: list[str] = []

    def allowed(self, now_s: float) -> bool:
        return self.held

    def ended(self) -> bool:
        return False

    def commands(self) -> list[str]:
        typed, self.typed = self.typed, []
        return typed

    def show(self, both: Teleop, notes: Sequence[str]) -> None:
        self.shown.append("; ".join([status_line(both), *notes]))


class Rig:
    """Both arms, configured and active. ``move`` returns the leader positions that the hand sets."""

    def __init__(
        self,
        rate_hz: int = 50,
        leader: Mapping[str, float] = REST,
        follower: Mapping[str, float] = REST,
        arms: tuple[Files, Files] = (LEADER, FOLLOWER),
    ) -> None:
        self.clock = SimulatedClock()
        self.hand: Callable[[float], Mapping[str, float]] = lambda time_s: leader
        self.leader = Lines(arms[0], leader, self._take)
        self.follower = Lines(arms[1], follower, lambda time_s: None)
        files = replace(arms[1], controllers=replace(arms[1].controllers, update_rate_hz=rate_hz))
        sides = [Side(one, lines.devices, lines) for one, lines in ((arms[0], self.leader), (files, self.follower))]
        self.teleop = build_teleop(sides[0], sides[1], self.clock, run_at_once)
        self.loop, self.controller = self.teleop.loop, self.teleop.controller
        self.names = [joint.name for joint in arms[1].robot.joints]
        self.times_s: list[float] = []
        self.commands: list[FloatArray] = []
        self.states: list[JointState] = []
        self.asked: list[str] = []
        self.person, self.ended = Watcher(), False
        self.attendance = Attendance(self.teleop, self.person, self.end)
        count = self.loop.on_cycle

        def on_cycle(state: JointState) -> None:
            count(state)
            self.times_s.append(self.clock.now())
            self.commands.append(self.loop.command)
            self.states.append(state)

        self.loop.on_cycle = on_cycle
        configure_all(self.loop.hardware)
        release_leader(self.teleop, self.asked.append)
        self.loop.activate(keep_inactive=["leader"])

    def run(self, seconds: float) -> None:
        """Run cycles of both worlds for a given time."""
        end_s = self.clock.now() + seconds - 1e-9
        self.loop.run(lambda: self.clock.now() >= end_s)

    def end(self) -> None:
        """End the teleoperation, as the user interface does."""
        self.ended = True

    def attend(self, seconds: float) -> str:
        """Run cycles with the user interface for a given time, and return the last displayed line."""
        for _ in range(round(seconds / 0.1)):
            self.run(0.1)
            self.attendance.update(self.clock.now())
        return self.person.shown[-1]

    def follow(self) -> "Rig":
        """Run until the follower has joined the leader."""
        self.controller.allowed = True
        for _ in range(100):
            self.run(0.1)
            if self.controller.phase == "following":
                return self
        raise AssertionError(self.controller.phase, self.controller.reason)

    def joint(self, name: str) -> int:
        """Return the index of a joint in the follower's commands."""
        return self.names.index(name)

    def _take(self, time_s: float) -> None:
        """Move the leader's joints exactly to the positions of the hand."""
        data = self.leader.world.data
        for name, position in self.hand(time_s).items():
            data.joint(name).qpos[0] = position
            data.joint(name).qvel[0] = 0.0


def sine(joint: str, size: float, hz: float) -> Callable[[float], Mapping[str, float]]:
    """Return the motion of a hand that moves one joint back and forth and holds the others."""

    def hand(time_s: float) -> Mapping[str, float]:
        return {**REST, joint: REST[joint] + size * math.sin(2.0 * math.pi * hz * time_s)}

    return hand


def delay_s(times_s: FloatArray, wanted: Callable[[float], float], measured: FloatArray) -> float:
    """Return the delay at which a curve matches the commanded curve best."""
    shifts = np.arange(-0.05, 0.3, 0.001)
    errors = [np.sum((measured - np.array([wanted(time_s - shift) for time_s in times_s])) ** 2) for shift in shifts]
    return float(shifts[int(np.argmin(errors))])
