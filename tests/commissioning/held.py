"""A kinematic arm with random mounting whose joints follow the hand up to their stops.

It simulates the counts and registers of the servos, but no forces.
"""

from collections.abc import Mapping, Sequence
from math import tau

from drivers.servos.register import Register
from drivers.types import Reading, ServoState
from hal.joint import Joint
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.emulator import couplings
from sim_backend.buses.mounting import Mounting
from sim_backend.mechanics.plant import Coupling

STEP_RAD = 0.2
"""Angle that a servo's shaft turns between two reads."""


class HeldArm:
    """The arm, its hand and its bus, combined in one object."""

    def __init__(self, seed: int, name: str) -> None:
        arm = find_arm(name)
        robot = read_arm_files(arm).robot
        self.plan, self.joints = arm.file.calibration, robot.joints
        self.couplings: Sequence[Coupling] = Mounting(seed).couplings(couplings(robot))
        self.registers: dict[tuple[int, str], int] = {}
        """Register values by servo ID and register; 0 by default."""
        self._positions = {joint.name: 0.0 for joint in self.joints}
        self._targets = dict(self._positions)
        self.hand = self.bus = self

    def coupling(self, joint: str) -> Coupling:
        """Return the true mounting of this joint's servo."""
        return next(one for one in self.couplings if one.joint == joint)

    # The hand.

    def position(self, joint: str) -> float:
        return self._positions[joint]

    def move(self, joint: str, position: float) -> None:
        self._targets[joint] = position

    def arrived(self, joint: str) -> bool:
        """Return whether the hand has reached its target. A stop may keep the joint from reaching the target."""
        found = next(one for one in self.joints if one.name == joint)
        return self._positions[joint] == self._held_back(found, self._targets[joint])

    def wait(self) -> None:
        """Move the joints by one step."""
        for joint in self.joints:
            here, step = self._positions[joint.name], STEP_RAD * joint.transmission
            way = self._held_back(joint, self._targets[joint.name]) - here
            self._positions[joint.name] = here + max(-step, min(way, step)) if abs(way) > step else here + way

    def _held_back(self, joint: Joint, position: float) -> float:
        return min(max(position, joint.limits.lower), joint.limits.upper)

    # The bus.

    def read_states(self, servo_ids: Sequence[int]) -> Mapping[int, Reading]:
        counts = {one.servo_id: self._counts(one) for one in self.couplings}
        return {i: ServoState(counts[i], 0, 0.0, 12.0, 30.0, ()) for i in servo_ids}

    def read(self, servo_id: int, register: Register) -> int:
        return self.registers.get((servo_id, register.name), 0)

    def _counts(self, one: Coupling) -> int:
        shaft_rad = one.sign * self._positions[one.joint] / one.transmission
        return (one.zero_counts + round(shaft_rad * one.counts_per_turn / tau)) % one.counts_per_turn
