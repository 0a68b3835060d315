"""A virtual arm that nobody aligned, limp on its bus, and a hand that moves it as it is asked to."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from commissioning.calibrate.flow import Task
from commissioning.calibrate.plan import JointPlan
from drivers.bus.bus import Bus
from hal.joint import Joint
from servoloop.emulator import couplings, virtual_bus
from servoloop.files import read_files
from sim_backend.build import Build
from sim_backend.clock import SimulatedClock
from sim_backend.hand import Hand
from sim_backend.mounting import Mounting
from sim_backend.plant import Coupling, WorldPlant
from sim_backend.port import VirtualPort
from sim_backend.world import World

FILES = read_files()
JOINTS: Sequence[Joint] = FILES.robot.joints
PLANS = {joint.name: JointPlan(positive="towards larger positions", zero="middle") for joint in JOINTS} | {
    "joint1": JointPlan(positive="to the left", zero="pose", pose="pointing forward", at=0.1),
    "hand_right_joint": JointPlan(positive="closing", zero="lower_stop"),
}
LOOK_S = 0.05


class UnalignedArm:
    """The arm with random zeros and directions on a virtual bus, on simulated time."""

    def __init__(self, seed: int, backlash_deg: float = 0.0) -> None:
        self.clock = SimulatedClock()
        self.couplings: list[Coupling] = Mounting(seed).couplings(couplings(FILES.robot))
        self.world = World(backlash=Build(backlash_deg).gaps(self.couplings), initial_position=[0.0] * len(JOINTS))
        self.world.model.geom_contype[:] = 0  # nothing is in its way
        self.hand = Hand(self.world, {joint.name: joint.transmission for joint in JOINTS})
        self.fastest_rad_s = 0.0
        """Of the servos' shafts, so far."""
        plant = WorldPlant(self.world, self.couplings, self._after_step)
        self.line = virtual_bus(FILES.robot, plant)
        self.bus = self.open_bus(JOINTS)
        self.hand.hold()

    def open_bus(self, joints: Sequence[Joint]) -> Bus:
        """The same line, opened by another program."""
        self.port = VirtualPort(self.line, self.clock)
        return Bus(self.port, self.clock, {joint.servo_id: joint.model for joint in joints})

    def _after_step(self, time_s: float) -> None:
        self.hand.update()
        reach = [one.transmission for one in self.couplings]
        self.fastest_rad_s = max(self.fastest_rad_s, float(np.abs(self.world.velocity() / reach).max()))

    def coupling(self, joint: str) -> Coupling:
        """How this joint's servo is really mounted."""
        return next(one for one in self.couplings if one.joint == joint)

    def wait(self) -> None:
        self.clock.sleep_until(self.clock.now() + LOOK_S)


@dataclass
class Person:
    """Does what it is asked to, with the virtual hand."""

    arm: UnalignedArm
    heard: list[str] = field(default_factory=list)
    lazy: Callable[[Task], bool] = lambda task: False
    """Tasks at which nothing is done."""
    skipped: set[str] = field(default_factory=set)
    """Joints that are not swept."""

    def say(self, text: str) -> None:
        self.heard.append(text)

    def until_done(self, task: Task, look: Callable[[], None]) -> None:
        self.heard.append(task.text)
        if self.lazy(task):
            return
        for name in task.joints:
            if name in self.skipped and task.kind == "sweep":
                continue
            joint = next(joint for joint in JOINTS if joint.name == name)
            for position in self._ways(task.kind, joint):
                self._take(name, position, look)

    def _ways(self, kind: str, joint: Joint) -> list[float]:
        lower, upper, here = joint.limits.lower, joint.limits.upper, self.arm.hand.position(joint.name)
        if kind == "sweep":
            return [lower - 0.05 * joint.transmission, upper + 0.05 * joint.transmission, 0.5 * (lower + upper)]
        if kind == "direction":
            back = max(here - 0.3 * joint.transmission, lower)
            return [back, back + 0.6 * joint.transmission]
        return [PLANS[joint.name].at or 0.0]

    def _take(self, joint: str, position: float, look: Callable[[], None]) -> None:
        hand = self.arm.hand
        hand.move(joint, position)
        while not hand.arrived(joint):
            self.arm.wait()
            look()
        for _ in range(6):  # until the joint has come to rest behind it
            self.arm.wait()
            look()
