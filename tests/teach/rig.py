"""Virtual arm under gravity in simulated time, which is moved by a hand with limited force."""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from controller.component_transitions import run_at_once
from drivers.servos.register import Register
from hal.components.component_lifecycle import configure_all
from hal.types import FloatArray, JointState
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.robot_files import Files
from servoloop.teach.arm import add_freedrive, build_arm
from servoloop.teach.record import TeachRecording
from servoloop.teach.taught import RecordedMotion
from servoloop.teleop.arms import Side
from sim_backend.clock import SimulatedClock
from sim_backend.scene.hand import DAMPING_NM_S, STIFFNESS_NM_RAD, STRONGEST_NM
from tests.teleop.rig import Lines

SO101 = read_arm_files(find_arm("so101"))
FREE: Mapping[str, float] = {"shoulder_lift": -0.9, "elbow_flex": 0.3, "wrist_flex": 0.6}
"""Collision-free pose."""
RATE_HZ = 50

Pose = Mapping[str, float]


class Rig:
    """Arm with its loop, which is not configured yet, so that a controller can be added first."""

    def __init__(self, soft: bool = False, pose: Pose = FREE, files: Files = SO101) -> None:
        self.clock = SimulatedClock()
        self.take_to: Callable[[float], Pose] = lambda time_s: {}
        """Positions to which the hand moves the joints at a given time. Other joints are free."""
        self._moved = [joint.name for joint in files.robot.joints]
        self.lines = Lines(files, pose, self._push)
        self.arm = build_arm(Side(files, self.lines.devices, self.lines), RATE_HZ, self.clock, run_at_once, soft)
        self.loop, self.names = self.arm.loop, self.arm.joints
        self.states: list[JointState] = []
        self.commands: list[FloatArray] = []

    def configure(self, take: Callable[[JointState], None] = lambda state: None) -> None:
        """Configure the arm. ``take`` is called at the end of each cycle."""

        def on_cycle(state: JointState) -> None:
            self.states.append(state)
            self.commands.append(self.loop.command)
            take(state)

        self.loop.on_cycle = on_cycle
        configure_all(self.loop.hardware)

    def run(self, seconds: float, poll: Callable[[], bool] = lambda: True) -> bool:
        """Run cycles for a given time, or until the callback between cycles returns False. Return its last result."""
        end_s = self.clock.now() + seconds - 1e-9
        going = True

        def stop() -> bool:
            nonlocal going
            going = going and poll()
            return not going or self.clock.now() >= end_s

        self.loop.run(stop)
        return going

    @property
    def places(self) -> FloatArray:
        """Joint positions (n,) in the world."""
        return np.array([float(self.lines.world.data.joint(name).qpos[0]) for name in self.names])

    def push(self, joint: str) -> float:
        """Return the current torque of the hand on a joint, in N m."""
        return float(self.lines.world.data.joint(joint).qfrc_applied[0])

    def register(self, joint: str, register: Register) -> int:
        """Return the value of a register in a joint's servo."""
        one = next(one for one in self.arm.files.robot.joints if one.name == joint)
        return int(self.lines.lines[one.bus].servo(one.servo_id).memory.get(register))

    def measured(self, since: int = 0) -> FloatArray:
        """Return the positions in each cycle (k, n)."""
        return np.array([state.position for state in self.states[since:]])

    def speeds(self, since: int = 0) -> FloatArray:
        """Return the velocity of the commands in each cycle (k, n)."""
        return np.abs(np.diff(np.array(self.commands[since:]), axis=0)) * RATE_HZ

    def _push(self, time_s: float) -> None:
        """Apply the force of the hand, a spring with a limited force."""
        taken = self.take_to(time_s)
        for joint in self._moved:
            data = self.lines.world.data.joint(joint)
            pull = STIFFNESS_NM_RAD * (taken.get(joint, 0.0) - data.qpos[0]) - DAMPING_NM_S * data.qvel[0]
            pull *= joint in taken
            data.qfrc_applied[0] = min(max(pull, -STRONGEST_NM), STRONGEST_NM)


class Lesson:
    """Recording with its own rig. ``kept`` contains the saved motions and their warnings."""

    def __init__(self, soft: bool, poses: bool = False, pose: Pose = FREE) -> None:
        self.rig = Rig(soft, pose)
        self.kept: list[tuple[RecordedMotion, Sequence[str]]] = []
        self.asked: list[str] = []
        freedrive = add_freedrive(self.rig.arm) if soft else None
        self.recording = TeachRecording(self.rig.arm, freedrive, poses, lambda *found: self.kept.append(found))

    def begin(self) -> "Lesson":
        """Start the recording. The hand holds the arm still while the arm becomes free."""
        self.rig.configure(self.recording.take)
        here = dict(zip(self.rig.names, self.rig.places.tolist(), strict=True))
        self.rig.take_to = lambda time_s: here
        self.recording.ask(self.asked.append)
        self.recording.begin()
        self.go_on(1.1)
        return self

    def go_on(self, seconds: float) -> bool:
        """Run for a given time or until the end of the recording. Return whether the recording is still running."""
        return self.rig.run(seconds, lambda: self.recording.update(self.rig.clock.now()))

    def show(self, seconds: float, size: float = 1.0) -> None:
        """Move the hand along a path in a given time, and then hold it still."""
        begun_s = self.rig.clock.now()
        here = dict(zip(self.rig.names, self.rig.places.tolist(), strict=True))
        self.rig.take_to = lambda time_s: way(here, min((time_s - begun_s) / seconds, 1.0), size)
        self.go_on(seconds + 0.4)


def way(here: Pose, share: float, size: float = 1.0) -> Pose:
    """Return a collision-free motion from the pose ``here``, which starts and ends at rest, evaluated at a share (0 to
    1) of its duration."""
    rests = math.sin(math.pi * share) ** 2
    arrives = 0.2 * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    return {
        **here,
        "shoulder_pan": here["shoulder_pan"] + size * (0.5 * rests * math.sin(4.0 * math.pi * share) + arrives),
        "shoulder_lift": here["shoulder_lift"] - size * 0.4 * rests,
        "elbow_flex": here["elbow_flex"] - size * 0.5 * rests * math.sin(2.0 * math.pi * share),
    }
