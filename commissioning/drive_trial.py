"""Measure the drive that a joint needs by moving it back and forth at two low speeds.

The difference between the two drives depends only on the motor and the gear, because friction and gravity cancel out.
"""

from dataclasses import dataclass
from statistics import fmean
from typing import Final, NamedTuple

from commissioning.slow_arm import SlowArm
from hal.joint import Joint

STUCK_SHARE: Final = 0.3
"""Minimum motion, as a fraction of the commanded motion. A joint that moves less is blocked or has no torque."""
BEHIND_RAD: Final = 0.25
"""Following error at which a motion is aborted, in rad of the servo's shaft. With the factory gains, a servo applies
full drive if its following error is 0.19 rad or more.
"""
LEAST_DRIVE: Final = 0.04
"""Minimum drive that can be evaluated, as a fraction of full drive. A smaller drive cannot be distinguished from the
effect of the steps between goals.
"""


@dataclass(frozen=True, slots=True)
class TrialPace:
    """Speeds and durations of a trial. A joint in an arm has less room and settles more slowly than a loose servo."""

    slow: float = 0.4
    """Lower speed, as a fraction of the higher speed. The higher speed is the joint's slow velocity limit."""
    ramp_s: float = 0.1
    """Time at each end of a motion that is excluded because the joint is accelerating, in seconds."""
    rest_s: float = 0.8
    """Time at rest after each motion, in seconds. The joint settles in the first half, and only the second half is
    evaluated.
    """

    @property
    def speeds(self) -> tuple[float, float]:
        """Both speeds, as fractions of the slow velocity limit."""
        return self.slow, 1.0


@dataclass(frozen=True, slots=True)
class TrialMotion:
    """Result of the drive trial of one joint. Positions are in rad or m, speeds in rad/s or m/s."""

    joint: Joint
    asked: float
    """Commanded motion (signed)."""
    moved: float
    """Measured motion."""
    speed: float
    """Difference between the two speeds of the trial."""
    drive: float
    """Difference between the mean drives at the two speeds, as a fraction of full drive at the rated voltage.

    Friction and gravity are the same at both speeds and cancel out.
    """
    pull: float
    """Drive that is the same in both directions, from gravity or another force on the joint."""
    error: float
    """Largest position error at rest."""
    swing: float
    """Distance between the outermost positions at rest."""
    lowest_v: float
    """Lowest voltage during the trial."""
    expected_sag: float = 0.0
    """Position error that is expected from gravity and the stiffness of the servo; 0 if gravity or stiffness is
    unknown.
    """

    @property
    def faster(self) -> float | None:
        """Ratio of speed to drive, as a multiple of the model's value; None if the drive is too small to evaluate."""
        expected = self.speed / (self.joint.model.no_load_speed_rad_s * self.joint.transmission)
        return expected / self.drive if expected >= LEAST_DRIVE and self.drive > 0.0 else None


class _Pass(NamedTuple):
    """Mean values of one motion in one direction."""

    drive: float
    """Mean drive, as a fraction of full drive at the rated voltage."""
    speed: float


class _Sample(NamedTuple):
    """Values measured in one cycle."""

    time_s: float
    drive: float
    place: float


class DriveTrial:
    """Trial in which one joint moves back and forth at two speeds."""

    def __init__(self, arm: SlowArm, index: int, way: float, pace: TrialPace = TrialPace()) -> None:
        """Prepare the trial. ``way`` is the signed distance from the current goal, in rad or m."""
        self.way = way
        self._pace = pace
        self._arm, self._index = arm, index
        self._joint = arm.joints[index]
        self._passes: dict[float, _Pass] = {}
        self._lowest_v = arm.state.health[self._joint.name].voltage_v
        self._error = self._swing = self._moved = self._pull = 0.0

    def run(self) -> None:
        """Run the trial at both speeds. A joint that does not follow its goals returns to its start immediately."""
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
        """Move at a constant speed and return the mean values, excluding both ends of the motion.

        Return None if the joint does not follow its goals.
        """
        start, period_s = float(self._arm.command[self._index]), self._arm.period_s
        ramp = round(self._pace.ramp_s / period_s)
        cycles = max(round(abs(target - start) / (share * self._joint.limits.velocity) / period_s), 2 * ramp + 2)
        samples: list[_Sample] = []
        for cycle in range(1, cycles + 1):
            self._cycle(start + (target - start) * cycle / cycles)
            place = self._arm.measured(self._index)
            if abs(place - float(self._arm.command[self._index])) > BEHIND_RAD * self._joint.transmission:
                return None  # If the servo were driven any longer, it would release its torque to protect itself.
            # Both directions cover the same positions, so gravity cancels out. A silent servo provides only old values.
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

    def motion(self, expected_sag: float = 0.0) -> TrialMotion:
        """Return the result of the trial."""
        still = _Pass(0.0, 0.0)
        slow, fast = (self._passes.get(share, still) for share in self._pace.speeds)
        return TrialMotion(
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
    """Return the mean values of a motion; None if there are fewer than two samples."""
    if len(samples) < 2:
        return None
    first, last = samples[0], samples[-1]
    return _Pass(fmean(one.drive for one in samples), (last.place - first.place) / (last.time_s - first.time_s))
