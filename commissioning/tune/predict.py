"""Predict the performance of a measured joint with different gains, from a model of the servo's position loop.

At rest, the error beyond the dead zone produces the drive that balances load and friction. This error is therefore
proportional to 1/P. At constant speed, the error produces the drive that balances the motor's back-EMF. This part of
the delay is therefore also proportional to 1/P. D acts only on changes of the error, so it affects neither the error
nor the delay. The overshoot is simulated in 1 ms steps, with the position loop of an STS and a single inertia. The
inertia is chosen so that the simulated overshoot with the present gains matches the measured overshoot.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import copysign
from typing import Final

from commissioning.tune.figures import JointFigures
from commissioning.tune.gains import with_gains
from commissioning.tune.trial import TrialPlan
from drivers.servos import sts
from hal.compensation.servo_compliance import STS_DRIVE_PER_COUNT, STS_FRICTION_SHARE
from hal.joint import Joint

TICK_S: Final = 0.001
D_EVERY_TICKS: Final = 20
"""Interval at which an STS computes the change of its error, in ticks: the factory value of register 81."""
D_SHARE: Final = 1.0 / 8000.0
"""Drive per unit of D and per count of error change, as a fraction of full drive."""
FULL_DRIVE: Final = 0.97
FRICTION_SHARE: Final = 0.5 * STS_FRICTION_SHARE
SIMULATED_S: Final = 1.0
"""Simulated time from the start of the step, in seconds."""
LIGHTEST, HEAVIEST = 1.0e-6, 1.0e-3
"""Range of inertias, in fractions of full drive per count/s². A bare STS3215 has 7e-6."""
HALVINGS: Final = 24
CLEAR_COUNTS: Final = 2.0
"""Minimum overshoot from which the inertia can be determined. Encoder steps alone may cause an overshoot below this
value."""


@dataclass(frozen=True, slots=True)
class Predicted:
    """Predicted performance figures.

    Figures that cannot be predicted are None. Positions are in rad or m, times in seconds.
    """

    sag: float | None
    rest_error: float | None
    delay_s: float | None
    overshoot: float | None
    """Predicted overshoot; None if the servo is not an STS or uses I."""
    overshoot_at_most: bool = False
    """Whether the overshoot is only an upper limit, because the measured value was too small to determine the inertia.
    """


@dataclass(frozen=True, slots=True)
class Loop:
    """Model of an STS position loop with a single inertia, in counts, seconds and fractions of full drive."""

    position_p: int
    position_d: int
    dead_zone: int
    offset: float
    """Minimum drive (register 24)."""
    no_load_counts_s: float
    inertia: float

    def overshoot(self, way: float, speed: float) -> float:
        """Return the overshoot of a step of ``way`` counts whose set-point moves at ``speed``, in counts."""
        place = rate = setpoint = set_rate = change = then = largest = 0.0
        per_count, brakes = self.position_p * STS_DRIVE_PER_COUNT, sts.GOAL_ACCELERATION * 100.0
        for tick in range(round(SIMULATED_S / TICK_S)):
            left = way - setpoint
            wanted = min(speed, (2.0 * brakes * max(left, 0.0)) ** 0.5)
            set_rate = min(set_rate + brakes * TICK_S, wanted)
            setpoint = min(setpoint + set_rate * TICK_S, way)
            error = setpoint - place
            behind = max(abs(error) - self.dead_zone, 0.0) * (1.0 if error > 0.0 else -1.0)
            if tick % D_EVERY_TICKS == 0:
                change, then = behind - then, behind
            drive = behind * per_count + change * self.position_d * D_SHARE
            if drive:
                drive += self.offset if drive > 0.0 else -self.offset
            drive = min(max(drive, -FULL_DRIVE), FULL_DRIVE) - rate / self.no_load_counts_s
            pushed = rate + drive * TICK_S / self.inertia
            held = FRICTION_SHARE * TICK_S / self.inertia
            rate = pushed - held if pushed > held else pushed + held if pushed < -held else 0.0
            place += rate * TICK_S
            largest = max(largest, place)
        return max(largest - way, 0.0)


def _loop(joint: Joint, inertia: float) -> Loop:
    held = dict(joint.settings)
    return Loop(
        position_p=held["position_p"],
        position_d=held["position_d"],
        dead_zone=max(held["cw_dead_zone"], held["ccw_dead_zone"]),
        offset=held["minimum_startup_force"] * sts.TORQUE_UNIT,
        no_load_counts_s=joint.model.no_load_speed_rad_s * joint.transmission / abs(joint.units_per_count),
        inertia=inertia,
    )


class Law:
    """Prediction model of one joint that was measured with its present gains."""

    def __init__(self, joint: Joint, plan: TrialPlan, measured: JointFigures) -> None:
        """Fit the model. ``joint`` must contain the current settings of its servo, as returned by ``as_held``."""
        self._joint, self._measured = joint, measured
        self._count = abs(joint.units_per_count)
        self._way, self._speed = abs(plan.step) / self._count, plan.speed / self._count
        self._computed = joint.model in sts.MODELS.values() and not dict(joint.settings).get("position_i")
        self._inertia = self._fitted() if self._computed else 0.0

    @property
    def known(self) -> bool:
        """Whether predictions are possible, which requires that the manufacturer publishes the scale of P."""
        return self._joint.compliance is not None

    @property
    def weighed(self) -> bool:
        """Whether the measured overshoot is large enough to determine the inertia."""
        return self._measured.overshoot > CLEAR_COUNTS * self._count

    def predict(self, values: Mapping[str, int]) -> Predicted:
        """Predict the performance figures with these gains. Gains that are not given keep their values."""
        now, then = self._joint, with_gains(self._joint, values)
        before, after = now.compliance, then.compliance
        if before is None or after is None:
            return Predicted(None, None, None, None)

        def at_rest(error: float) -> float:
            driven = max(abs(error) - _dead(now), 0.0) * before.stiffness + _least(now)
            left = _dead(then) + max(driven - _least(then), 0.0) / after.stiffness
            return copysign(left if abs(error) > _dead(now) else min(left, abs(error)), error)

        return Predicted(
            sag=at_rest(self._measured.sag),
            rest_error=at_rest(self._measured.rest_error),
            delay_s=max(self._measured.delay_s + after.lag_s - before.lag_s, 0.0),
            overshoot=self._overshoot(then),
            overshoot_at_most=self._computed and not self.weighed,
        )

    def _overshoot(self, then: Joint) -> float | None:
        if not self._computed or dict(then.settings).get("position_i"):
            return None
        return _loop(then, self._inertia).overshoot(self._way, self._speed) * self._count

    def _fitted(self) -> float:
        """Return the inertia with which the present gains produce the measured overshoot."""
        wanted = max(self._measured.overshoot / self._count, CLEAR_COUNTS)
        low, high = LIGHTEST, HEAVIEST
        for _ in range(HALVINGS):
            middle = (low * high) ** 0.5
            above = _loop(self._joint, middle).overshoot(self._way, self._speed) > wanted
            low, high = (low, middle) if above else (middle, high)
        return low


def _dead(joint: Joint) -> float:
    """Return the dead zone, which is subtracted from the error, in the joint's units."""
    held = dict(joint.settings)
    return max(held.get("cw_dead_zone", 0), held.get("ccw_dead_zone", 0)) * abs(joint.units_per_count)


def _least(joint: Joint) -> float:
    """Return the effort of the minimum drive, which the servo adds to the drive that corrects the error."""
    return dict(joint.settings).get("minimum_startup_force", 0) * sts.TORQUE_UNIT * joint.full_effort
