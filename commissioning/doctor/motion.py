"""The motion that some checks need: each joint moves a little, slowly, and the arm is limp before it and behind it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from statistics import fmean
from typing import Final, NamedTuple

import numpy as np

from commissioning.doctor.finding import Finding
from commissioning.doctor.measure import OpenPort
from commissioning.doctor.snapshot import BusSnapshot, JointMotion, Snapshot
from commissioning.slow_arm import PERIOD_S, SlowArm
from drivers.bus.bus import Bus
from drivers.clock import Clock
from drivers.errors import DriverError
from hal.compensation.gravity import Gravity
from hal.errors import HalError
from hal.joint import Joint

Move = Callable[[Snapshot, tuple[Finding, ...]], tuple[tuple[JointMotion, ...], str]]
"""Is given what is known so far; returns the motions, or why there are none."""

WAY_RAD: Final = 0.4
"""How far each servo turns, there and back, twice."""
FASTEST_RAD_S: Final = 1.0
SPEEDS: Final = (0.4, 1.0)
"""Shares of the joint's slow limit: the difference of two speeds' drives is that of the motor, without friction."""
RAMP_CYCLES: Final = 2
"""At each end of a way its drive is that of acceleration."""
STUCK_SHARE: Final = 0.3
"""Of the way: a joint that moved by less is held by something, or has no force."""
BEHIND_RAD: Final = 0.25
"""Of a servo's shaft: with the factory's gains it drives with all it has from 0.19 on."""
REST_CYCLES: Final = 16
SETTLED_CYCLES: Final = 8
"""The last of these: the joint has come to rest by then, or swings."""


def no_move(snapshot: Snapshot, findings: tuple[Finding, ...]) -> tuple[tuple[JointMotion, ...], str]:
    """Nothing is moved, and nobody wanted it."""
    return (), ""


@dataclass(frozen=True, slots=True)
class SmallMotions:
    """A ``Move`` of all joints, one after the other, bus by bus. It does nothing where faults were found."""

    open_port: OpenPort
    clock: Clock
    gravity: Gravity | None = None
    stopped: Callable[[], bool] = field(default=lambda: False)

    def __call__(self, snapshot: Snapshot, findings: tuple[Finding, ...]) -> tuple[tuple[JointMotion, ...], str]:
        """Move, or say why not."""
        servos = [servo for bus in snapshot.buses for servo in bus.servos]
        if any(finding.severity == "fault" for finding in findings):
            return (), "nothing is moved as long as there are faults: mend those first"
        if held := [servo.joint.name for servo in servos if servo.registers.get("torque_enable") != 0]:
            return (), f"{', '.join(held)} is not limp: switch the torque off first, so that it can be left as it was"
        motions: list[JointMotion] = []
        try:
            for bus in snapshot.buses:
                motions += self._bus(bus, [servo.joint for servo in servos])
        except (DriverError, HalError) as error:
            return tuple(motions), str(error)
        return tuple(motions), ""

    def _bus(self, bus: BusSnapshot, all_joints: Sequence[Joint]) -> list[JointMotion]:
        joints = [servo.joint for servo in bus.servos]
        models = {joint.servo_id: joint.model for joint in joints}

        def open_bus() -> Bus:
            return Bus(self.open_port(bus.port, bus.baud), self.clock, models)

        with SlowArm(open_bus, joints, self.clock, self.stopped, FASTEST_RAD_S) as arm:
            return [self._joint(arm, index, all_joints) for index in range(len(joints))]

    def _joint(self, arm: SlowArm, index: int, all_joints: Sequence[Joint]) -> JointMotion:
        trial = _Trial(arm, index)
        trial.run()
        ends = (0.0, trial.way)
        return trial.motion(max((self._sag(arm, index, way, all_joints) for way in ends), key=abs))

    def _sag(self, arm: SlowArm, index: int, way: float, all_joints: Sequence[Joint]) -> float:
        """Of one joint, ``way`` beyond the present pose. Joints of other buses count as standing at zero."""
        joint = arm.joints[index]
        if self.gravity is None or joint.compliance is None:
            return 0.0
        at = {one.name: float(arm.state.position[i]) for i, one in enumerate(arm.joints)}
        at[joint.name] += way
        torques = self.gravity.torques(np.array([at.get(one.name, 0.0) for one in all_joints]))
        return float(torques[[one.name for one in all_joints].index(joint.name)]) / joint.compliance.stiffness


class _Pass(NamedTuple):
    """The mean of one way."""

    drive: float
    """As a share of full drive at the rated voltage."""
    speed: float


class _Trial:
    """One joint goes there and back at two speeds."""

    def __init__(self, arm: SlowArm, index: int) -> None:
        self._arm, self._index = arm, index
        self._joint = arm.joints[index]
        self._passes: dict[float, _Pass] = {}
        self._lowest_v = arm.state.health[self._joint.name].voltage_v
        self._error = self._swing = self._moved = 0.0
        start, limits = float(arm.command[index]), self._joint.limits
        middle = 0.5 * (limits.lower + limits.upper)
        longest = min(WAY_RAD * self._joint.transmission, 0.5 * (limits.upper - limits.lower))
        self.way = longest if start < middle else -longest

    def run(self) -> None:
        """Both speeds; at rest it is looked at on both ends. A joint that does not follow is taken back at once."""
        start = float(self._arm.command[self._index])
        self._rest()
        for share in SPEEDS:
            before = self._arm.measured(self._index)
            there = self._pass(start + self.way, share)
            if there is not None:
                self._rest()
            self._moved = self._arm.measured(self._index) - before
            back = self._pass(start, share)
            if there is None or back is None:
                return
            self._rest()
            direction = 1.0 if self.way > 0.0 else -1.0
            self._passes[share] = _Pass(*(0.5 * direction * (a - b) for a, b in zip(there, back, strict=True)))

    def _pass(self, target: float, share: float) -> "_Pass | None":
        """One way at a constant speed, without its beginning and its end; None where the joint stays behind."""
        start, speed = float(self._arm.command[self._index]), share * self._joint.limits.velocity
        cycles = max(round(abs(target - start) / speed / PERIOD_S), 2 * RAMP_CYCLES + 2)
        drives: list[float] = []
        places: list[float] = []
        for cycle in range(1, cycles + 1):
            self._cycle(start + (target - start) * cycle / cycles)
            health = self._arm.state.health[self._joint.name]
            drives.append(health.load * health.voltage_v / self._joint.model.rated_voltage_v)
            places.append(self._arm.measured(self._index))
            if abs(places[-1] - float(self._arm.command[self._index])) > BEHIND_RAD * self._joint.transmission:
                return None  # pushed any longer, the servo would let go to protect itself
        # The same places on both ways: gravity drops out.
        first, last = RAMP_CYCLES, cycles - RAMP_CYCLES - 1
        return _Pass(fmean(drives[first : last + 1]), (places[last] - places[first]) / ((last - first) * PERIOD_S))

    def _rest(self) -> None:
        target = float(self._arm.command[self._index])
        places: list[float] = []
        for _ in range(REST_CYCLES):
            self._cycle(target)
            places.append(self._arm.measured(self._index))
        settled = places[-SETTLED_CYCLES:]
        self._swing = max(self._swing, max(settled) - min(settled))
        self._error = max(self._error, abs(fmean(settled) - target))

    def _cycle(self, position: float) -> None:
        self._arm.cycle(self._index, position)
        self._lowest_v = min(self._lowest_v, self._arm.state.health[self._joint.name].voltage_v)

    def motion(self, expected_sag: float) -> JointMotion:
        """What it did."""
        still = _Pass(0.0, 0.0)
        slow, fast = (self._passes.get(share, still) for share in SPEEDS)
        return JointMotion(
            joint=self._joint,
            asked=self.way,
            moved=self._moved,
            speed=fast.speed - slow.speed,
            drive=fast.drive - slow.drive,
            error=self._error,
            expected_sag=expected_sag,
            swing=self._swing,
            lowest_v=self._lowest_v,
        )
