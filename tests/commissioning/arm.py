"""A virtual arm with random mounting, and simulated people who move it by hand or watch it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import tau
from pathlib import Path
from typing import Any

import numpy as np

from commissioning.calibrate.by_hand import CalibrationTask
from commissioning.calibrate.plan import ArmPlan, JointPlan
from commissioning.calibrate.result import FoundZero, JointCalibration, calibration_of, unit
from drivers.bus.bus import Bus
from drivers.servos.angles import Travel
from hal.joint import Joint
from hal.types import FloatArray
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.emulator import couplings, virtual_bus
from sim_backend.buses.build import Build
from sim_backend.buses.mounting import Mounting
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import Coupling, WorldPlant
from sim_backend.scene.hand import SceneHand
from sim_backend.scene.world import World

FILES = read_arm_files(find_arm())
JOINTS: Sequence[Joint] = FILES.robot.joints
PLAN = ArmPlan(
    joints={joint.name: JointPlan(positive="towards larger positions") for joint in JOINTS}
    | {
        "joint1": JointPlan(positive="to the left", zero="pose", pose="pointing forward", at=0.1),
        "hand_right_joint": JointPlan(positive="closing", zero="lower_stop"),
    }
)
LOOK_S = 0.05
LOOK_STEPS = 1000
OVER_THE_STOP_RAD = 0.05
"""Distance beyond a stop to which the hand moves a joint."""


class UnalignedArm:
    """Arm with random zeros and directions on a virtual bus in simulated time, held by a hand."""

    def __init__(
        self,
        seed: int,
        backlash_deg: float = 0.0,
        name: str = "robot_arm",
        start: Sequence[float] | None = None,
        robot: Path | None = None,
    ) -> None:
        """Create the arm with its joints at ``start``. If ``start`` is None, all joints are at 0 and collisions are
        disabled.

        ``robot`` replaces the robot file of the arm.
        """
        self.clock = SimulatedClock()
        self.plan = find_arm(name).file.calibration
        self.files = read_arm_files(find_arm(name), robot=robot)
        self.joints = self.files.robot.joints
        self.couplings: list[Coupling] = Mounting(seed).couplings(couplings(self.files.robot))
        gaps = Build(backlash_deg).gaps(self.couplings)
        at = [0.0] * len(self.joints) if start is None else start
        self.world = World(self.files.scene, backlash=gaps, initial_position=at)
        self.world.clear_table()
        if start is None:
            self.world.model.geom_contype[:] = 0
        self.hand = SceneHand(self.world, {joint.name: joint.transmission for joint in self.joints})
        self._fastest_rad_s = 0.0
        self._passed: list[tuple[FloatArray, FloatArray]] = []
        """Positions and velocities after each step that are not evaluated yet."""
        self._reach = np.array([one.transmission for one in self.couplings])
        self.mark()
        plant = WorldPlant(self.world, self.couplings, self._after_step)
        self.line = virtual_bus(self.files.robot, plant)
        self.bus = self.open_bus(self.joints)
        self.hand.hold()

    def open_bus(self, joints: Sequence[Joint]) -> Bus:
        """Open the bus again, as another program would."""
        self.port = VirtualPort(self.line, self.clock)
        gains = {joint.servo_id: joint.position_p for joint in joints if joint.position_p is not None}
        return Bus(self.port, self.clock, {joint.servo_id: joint.model for joint in joints}, position_p=gains)

    @property
    def fastest_rad_s(self) -> float:
        """Highest speed of a servo's shaft since the last reset of this value."""
        self._look()
        return self._fastest_rad_s

    @fastest_rad_s.setter
    def fastest_rad_s(self, value: float) -> None:
        self._passed.clear()
        self._fastest_rad_s = value

    def mark(self) -> None:
        """Begin to record how far the joints move."""
        self._look()
        self._marked = self.world.position()
        self._farthest = np.zeros(len(self._marked))

    def went(self, joint: str) -> float:
        """Return the largest signed distance of the joint since ``mark``."""
        self._look()
        return float(self._farthest[self.world.joints.index(joint)])

    def _after_step(self, time_s: float) -> None:
        self.hand.update()
        self._passed.append((self.world.position(), self.world.velocity()))
        if len(self._passed) >= LOOK_STEPS:
            self._look()

    def _look(self) -> None:
        """Evaluate all recorded steps at once, because single evaluations are slow."""
        if not self._passed:
            return
        positions, velocities = map(np.array, zip(*self._passed, strict=True))
        self._passed.clear()
        self._fastest_rad_s = max(self._fastest_rad_s, float(np.abs(velocities / self._reach).max()))
        away = np.vstack((self._farthest, positions - self._marked))
        self._farthest = away[np.abs(away).argmax(axis=0), range(away.shape[1])]

    def coupling(self, joint: str) -> Coupling:
        """Return the true mounting of this joint's servo."""
        return next(one for one in self.couplings if one.joint == joint)

    def as_mounted(self) -> dict[str, JointCalibration]:
        """Return the exact calibration."""
        found: dict[str, JointCalibration] = {}
        for joint, true in zip(self.joints, self.couplings, strict=True):
            at = [true.zero_counts + true.sign * end / unit(joint) for end in (joint.limits.lower, joint.limits.upper)]
            travel = Travel(round(min(at)), round(max(at)))
            found[joint.name] = calibration_of(joint, FoundZero(travel, true.sign, true.zero_counts, 0.0, 0))
        return found

    def wait(self) -> None:
        self.clock.sleep_until(self.clock.now() + LOOK_S)


def off_rad(arm: Any, joint: Joint, made: JointCalibration) -> float:
    """Return the error of a calibrated zero, rad of the servo's shaft."""
    turn = joint.model.counts_per_turn
    true = arm.coupling(joint.name).zero_counts
    off = (made.zero_counts + (made.counting.seam(joint.model) or 0) - true + turn // 2) % turn - turn // 2
    return abs(off) * tau / turn


@dataclass
class Person:
    """A person who does every task with the virtual hand."""

    arm: UnalignedArm
    plans: Mapping[str, JointPlan] = field(default_factory=lambda: PLAN.joints)
    heard: list[str] = field(default_factory=list)
    lazy: Callable[[CalibrationTask], bool] = lambda task: False
    """Returns whether the person ignores a task."""
    skipped: set[str] = field(default_factory=set)
    """Joints that are not swept."""

    def say(self, text: str) -> None:
        self.heard.append(text)

    def until_done(self, task: CalibrationTask, update: Callable[[], None]) -> None:
        self.heard.append(task.text)
        if self.lazy(task):
            return
        left = [name for name in task.joints if name not in self.skipped or task.kind != "sweep"]
        self.move(task.kind, left, update)

    def move(self, kind: str, joints: Sequence[str], update: Callable[[], None]) -> None:
        """Do one kind of task with these joints, one after the other."""
        for name in joints:
            joint = next(joint for joint in self.arm.joints if joint.name == name)
            for position in self._ways(kind, joint):
                self._take(name, position, update)

    def _ways(self, kind: str, joint: Joint) -> list[float]:
        lower, upper, here = joint.limits.lower, joint.limits.upper, self.arm.hand.position(joint.name)
        over = OVER_THE_STOP_RAD * joint.transmission
        if kind == "sweep":
            return [lower - over, upper + over, 0.5 * (lower + upper)]
        if kind == "direction":
            back = max(here - 0.3 * joint.transmission, lower)
            return [back, back + 0.6 * joint.transmission]
        return [self.plans[joint.name].at or 0.0]

    def _take(self, joint: str, position: float, update: Callable[[], None]) -> None:
        hand = self.arm.hand
        hand.move(joint, position)
        while not hand.arrived(joint):
            self.arm.wait()
            update()
        for _ in range(6):  # wait until the joint has come to rest
            self.arm.wait()
            update()


@dataclass
class Onlooker(Person):
    """A person who watches the arm, answers questions, and moves joints only to poses."""

    asked: list[str] = field(default_factory=list)
    """Joints for which the person was asked about the direction of motion."""

    def say(self, text: str) -> None:
        super().say(text)
        if text.startswith("Take your hands off"):
            self.arm.hand.release()
        self.arm.mark()

    def moved_so(self, joint: str, text: str) -> bool:
        self.asked.append(joint)
        return self.arm.went(joint) > 0.0
