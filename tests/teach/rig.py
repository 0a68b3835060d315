"""Virtual arm under gravity in simulated time, which is moved by a hand with limited force."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from controller.teach.freedrive_controller import FreedriveController
from drivers.servos.register import Register
from hal.components.component_lifecycle import configure_all
from hal.types import FloatArray, JointState
from servoloop.api.arm import Arm
from servoloop.api.arm_errors import ArmEndedError
from servoloop.api.freedrive import FREEDRIVE
from servoloop.api.own_loop import describe
from servoloop.api.pace import SimulatedPace
from servoloop.api.stack_backend import StackBackend
from servoloop.recording.stack_recording import StackRecording
from servoloop.stack import hardware
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.control_stack import ControlStack
from servoloop.stack.robot_files import Files, initial_states
from servoloop.teach.motion_files import RecordedMotion, TeachError
from servoloop.teach.record import Keep, RecordPhase, TeachRecording
from sim_backend.clock import SimulatedClock
from sim_backend.scene.hand import DAMPING_NM_S, STIFFNESS_NM_RAD, STRONGEST_NM
from tests.teleop.rig import Lines

SO101 = read_arm_files(find_arm("so101"))
FREE: Mapping[str, float] = {"shoulder_lift": -0.9, "elbow_flex": 0.3, "wrist_flex": 0.6}
"""Collision-free pose."""
RATE_HZ = 50

Pose = Mapping[str, float]


class Rig:
    """Active arm with its controllers."""

    def __init__(self, pose: Pose = FREE, files: Files = SO101) -> None:
        files = replace(files, controllers=replace(files.controllers, update_rate_hz=RATE_HZ))
        self.clock = SimulatedClock()
        self.take_to: Callable[[float], Pose] = lambda time_s: {}
        """Positions to which the hand moves the joints at a given time. Other joints are free."""
        self._moved = [joint.name for joint in files.robot.joints]
        self.lines = Lines(files, pose, self._push)
        setup = hardware.build(None, files, self.lines.devices, self.clock, self.lines)
        self.stack = ControlStack.build(setup, files, self.clock)
        self.stack.load_controllers()
        self.loop = self.stack.loop
        self.states: list[JointState] = []
        self.commands: list[FloatArray] = []
        self.loop.on_cycle = self._on_cycle
        self._why: Exception | None = None
        pace = SimulatedPace(self.loop, self._ended, self._fail)
        self.backend = StackBackend(self.stack, describe(self.stack), pace, self._ended, StackRecording(None))
        self.arm = Arm.__new__(Arm)
        self.arm._use(self.backend, lambda: None, files.arm)
        configure_all(self.loop.hardware)
        self.loop.activate(initial_states(files).inactive)
        self.names = self.loop.hardware.joints
        self.arm.step()

    def run(self, seconds: float, poll: Callable[[], bool] = lambda: True) -> bool:
        """Run cycles for a given time, or until the callback between cycles returns False. Return its last result."""
        end_s = self.clock.now() + seconds - 1e-9
        while self.clock.now() < end_s:
            if not poll():
                return False
            self.arm.step()
        return True

    def guided(self) -> FreedriveController:
        """Let a hand move the arm, and return the controller."""
        self.backend.begin_freedrive()
        controller = self.loop.manager.registry.loaded[FREEDRIVE].controller
        assert isinstance(controller, FreedriveController) and controller.free
        return controller

    @property
    def places(self) -> FloatArray:
        """Joint positions (n,) in the world."""
        return np.array([float(self.lines.world.data.joint(name).qpos[0]) for name in self.names])

    def push(self, joint: str) -> float:
        """Return the current torque of the hand on a joint, in N m."""
        return float(self.lines.world.data.joint(joint).qfrc_applied[0])

    def register(self, joint: str, register: Register) -> int:
        """Return the value of a register in a joint's servo."""
        one = next(one for one in self.stack.files.robot.joints if one.name == joint)
        return int(self.lines.lines[one.bus].servo(one.servo_id).memory.get(register))

    def measured(self, since: int = 0) -> FloatArray:
        """Return the positions in each cycle (k, n)."""
        return np.array([state.position for state in self.states[since:]])

    def speeds(self, since: int = 0) -> FloatArray:
        """Return the velocity of the commands in each cycle (k, n)."""
        return np.abs(np.diff(np.array(self.commands[since:]), axis=0)) * RATE_HZ

    def _on_cycle(self, state: JointState) -> None:
        self.states.append(state)
        self.commands.append(self.loop.command)

    def _ended(self) -> ArmEndedError | None:
        return ArmEndedError(str(self._why)) if self._why else None

    def _fail(self, error: Exception) -> None:
        self._why = error

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
        self.rig = Rig(pose)
        self.kept: list[tuple[RecordedMotion, Sequence[str]]] = []
        self.keep: Keep = lambda *found: self.kept.append(found)
        self.recording = TeachRecording(self.rig.arm, soft, poses, lambda *found: self.keep(*found))

    def begin(self) -> "Lesson":
        """Start the recording. The hand holds the arm still while the arm becomes free."""
        here = dict(zip(self.rig.names, self.rig.places.tolist(), strict=True))
        self.rig.take_to = lambda time_s: here
        self.recording.begin()
        assert self.recording.phase is RecordPhase.BY_HAND
        self.go_on(0.1)
        return self

    def go_on(self, seconds: float) -> bool:
        """Run for a given time or until the end of the recording. Return whether the recording is still running."""
        return self.rig.run(seconds, self.recording.update)

    def show(self, seconds: float, size: float = 1.0) -> None:
        """Move the hand along a path in a given time, and then hold it still."""
        begun_s = self.rig.clock.now()
        here = dict(zip(self.rig.names, self.rig.places.tolist(), strict=True))
        self.rig.take_to = lambda time_s: way(here, min((time_s - begun_s) / seconds, 1.0), size)
        self.go_on(seconds + 0.4)

    def failure(self) -> str:
        """End the recording, and return the error of the arm."""
        try:
            self.recording.press("q")
        except TeachError as error:
            return str(error)
        return ""


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
