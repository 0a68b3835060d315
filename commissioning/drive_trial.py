"""The drive trial of one joint: it goes there and back, slowly, at two speeds, and the drive that they need is noted.

The difference of two speeds' drives is that of the motor and its gear, without friction and without gravity.
"""

from dataclasses import dataclass
from statistics import fmean
from typing import Final, NamedTuple

from commissioning.slow_arm import SlowArm
from hal.joint import Joint

STUCK_SHARE: Final = 0.3
"""Of the way: a joint that moved by less is held by something, or has no force."""
BEHIND_RAD: Final = 0.25
"""Of a servo's shaft: with the factory's gains it drives with all it has from 0.19 on."""
LEAST_DRIVE: Final = 0.04
"""Of full drive: what is less is lost in the steps in which goals are sent."""


@dataclass(frozen=True, slots=True)
class Pace:
    """The pace of a trial: a joint of an arm has less room, and takes longer to come to rest, than a loose servo."""

    slow: float = 0.4
    """The lower speed as a share of the joint's slow limit, which is the higher one."""
    ramp_s: float = 0.1
    """At each end of a way its drive is that of acceleration."""
    rest_s: float = 0.8
    """In the first half of it the joint comes to rest, or swings."""

    @property
    def speeds(self) -> tuple[float, float]:
        """Both speeds as shares of the slow limit."""
        return self.slow, 1.0


@dataclass(frozen=True, slots=True)
class JointMotion:
    """What one joint did when it was moved a little, slowly. Positions in rad or m, speeds in rad/s or m/s."""

    joint: Joint
    asked: float
    """The way that it was to go, with its direction."""
    moved: float
    speed: float
    """The difference of two speeds at which it went there and back,"""
    drive: float
    """and of the mean drives, as shares of full drive at the rated voltage: friction and gravity are in both, and drop
    out."""
    pull: float
    """The drive that was the same on both ways: gravity's, or that of whatever pulls at the joint."""
    error: float
    """The largest distance from where it was sent, at rest."""
    swing: float
    """The distance between the outermost positions at rest."""
    lowest_v: float
    """The lowest voltage meanwhile."""
    expected_sag: float = 0.0
    """How far gravity's torque pulls it off by its servo's stiffness; 0 where one of them is unknown."""

    @property
    def faster(self) -> float | None:
        """How many times faster the servo turns for its drive than its model; None where that cannot be told."""
        expected = self.speed / (self.joint.model.no_load_speed_rad_s * self.joint.transmission)
        return expected / self.drive if expected >= LEAST_DRIVE and self.drive > 0.0 else None


class _Pass(NamedTuple):
    """The mean of one way."""

    drive: float
    """As a share of full drive at the rated voltage."""
    speed: float


class _Sample(NamedTuple):
    """One cycle's measurement."""

    time_s: float
    drive: float
    place: float


class DriveTrial:
    """One joint goes there and back at two speeds."""

    def __init__(self, arm: SlowArm, index: int, way: float, pace: Pace = Pace()) -> None:
        """``way``: how far it goes from where it was sent, rad or m, with its direction."""
        self.way = way
        self._pace = pace
        self._arm, self._index = arm, index
        self._joint = arm.joints[index]
        self._passes: dict[float, _Pass] = {}
        self._lowest_v = arm.state.health[self._joint.name].voltage_v
        self._error = self._swing = self._moved = self._pull = 0.0

    def run(self) -> None:
        """Both speeds; at rest it is looked at on both ends. A joint that does not follow is taken back at once."""
        start = float(self._arm.command[self._index])
        self._rest()
        for share in self._pace.speeds:
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
            self._pull = max(self._pull, 0.5 * (there.drive + back.drive), key=abs)

    def _pass(self, target: float, share: float) -> "_Pass | None":
        """One way at a constant speed, without its beginning and its end; None where the joint stays behind."""
        start, period_s = float(self._arm.command[self._index]), self._arm.period_s
        ramp = round(self._pace.ramp_s / period_s)
        cycles = max(round(abs(target - start) / (share * self._joint.limits.velocity) / period_s), 2 * ramp + 2)
        samples: list[_Sample] = []
        for cycle in range(1, cycles + 1):
            self._cycle(start + (target - start) * cycle / cycles)
            place = self._arm.measured(self._index)
            if abs(place - float(self._arm.command[self._index])) > BEHIND_RAD * self._joint.transmission:
                return None  # pushed any longer, the servo would let go to protect itself
            # The same places on both ways: gravity drops out. A servo that gave no answer has its old values.
            if ramp < cycle <= cycles - ramp and self._joint.name not in self._arm.state.faults:
                samples.append(_Sample(cycle * period_s, self._drive(), place))
        return _mean(samples)

    def _drive(self) -> float:
        health = self._arm.state.health[self._joint.name]
        return health.load * health.voltage_v / self._joint.model.rated_voltage_v

    def _rest(self) -> None:
        target = float(self._arm.command[self._index])
        places: list[float] = []
        cycles = round(self._pace.rest_s / self._arm.period_s)
        for _ in range(cycles):
            self._cycle(target)
            places.append(self._arm.measured(self._index))
        settled = places[cycles // 2 :]
        self._swing = max(self._swing, max(settled) - min(settled))
        self._error = max(self._error, abs(fmean(settled) - target))

    def _cycle(self, position: float) -> None:
        self._arm.cycle(self._index, position)
        self._lowest_v = min(self._lowest_v, self._arm.state.health[self._joint.name].voltage_v)

    def motion(self, expected_sag: float = 0.0) -> JointMotion:
        """What it did."""
        still = _Pass(0.0, 0.0)
        slow, fast = (self._passes.get(share, still) for share in self._pace.speeds)
        return JointMotion(
            joint=self._joint,
            asked=self.way,
            moved=self._moved,
            speed=fast.speed - slow.speed,
            drive=fast.drive - slow.drive,
            pull=self._pull,
            error=self._error,
            swing=self._swing,
            lowest_v=self._lowest_v,
            expected_sag=expected_sag,
        )


def _mean(samples: list[_Sample]) -> _Pass | None:
    """The mean of a way; None where hardly anything of it was seen."""
    if len(samples) < 2:
        return None
    first, last = samples[0], samples[-1]
    return _Pass(fmean(one.drive for one in samples), (last.place - first.place) / (last.time_s - first.time_s))
