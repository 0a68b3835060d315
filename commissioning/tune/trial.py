"""The motions of one joint that is measured: a slow pass first, steps, a sine."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos, pi, sqrt
from typing import Final

from commissioning.slow_arm import SPEED_SHARE, SlowArm
from commissioning.tune.figures import Trace, rest_error
from commissioning.tune.gains import TuneError
from hal.joint import Joint

LIFT_RAD: Final = 0.35
"""So far a joint leaves the place where it stood, and whatever it may lie on there: more than a soft servo sags."""
STEP_RAD: Final = 0.15
"""98 counts of an STS."""
LEAST_RAD: Final = 0.03
"""With smaller steps a servo's dead band and friction are all that there is to see."""
ROOM_SHARE: Final = 0.4
"""Of the way to the limit that is further away, for either of the two."""
FASTEST_RAD_S: Final = 1.0
"""Of a servo's shaft: without a limit in the URDF that is slower."""
SINE_HZ: Final = 1.0
SPEED_MARGIN: Final = 0.8
"""Share of the speed that the gate lets through: where it holds a sine back, it is none."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Where a joint goes, in rad or m: from ``start`` to ``near``, then to and fro between ``near`` and ``far``."""

    joint: str
    start: float
    near: float
    far: float
    speed: float
    """Per second; the gate lets nothing faster through."""
    sine_hz: float

    @property
    def step(self) -> float:
        """From near to far, with its sign."""
        return self.far - self.near


def plan_for(joint: Joint, start: float, at: float | None = None) -> Plan:
    """The plan for a joint that stands at ``start``: towards the limit that is further away, less where room is short.

    ``at``: where to measure, instead of a little beside the start. Raises TuneError where there is no room.
    """
    limits, unit = joint.limits, joint.transmission
    if at is not None and not limits.lower <= at <= limits.upper:
        raise TuneError(f"{joint.name} cannot go to {at:.3f}: its limits are {limits.lower:.3f} to {limits.upper:.3f}")
    begin = min(max(start if at is None else at, limits.lower), limits.upper)
    upwards = limits.upper - begin >= begin - limits.lower
    way, room = (1.0, limits.upper - begin) if upwards else (-1.0, begin - limits.lower)
    near = begin if at is not None else begin + way * min(LIFT_RAD * unit, ROOM_SHARE * room)
    step = min(STEP_RAD * unit, ROOM_SHARE * room)
    if step < LEAST_RAD * unit:
        raise TuneError(f"{joint.name} has no room to move in: its limits are {limits.lower:.3f} to {limits.upper:.3f}")
    speed = min(SPEED_SHARE * limits.velocity, FASTEST_RAD_S * unit)
    return Plan(joint.name, start, near, near + way * step, speed, _sine_hz(joint, step, speed))


def _sine_hz(joint: Joint, step: float, speed: float) -> float:
    """The frequency at which the sine (half the step to either side) stays within speed and acceleration."""
    by_speed = SPEED_MARGIN * speed / (pi * step)
    by_acceleration = sqrt(SPEED_MARGIN * joint.limits.acceleration / (0.5 * step)) / (2.0 * pi)
    return min(SINE_HZ, by_speed, by_acceleration)


def said(joint: Joint, plan: Plan, others: Sequence[str], end: str) -> str:
    """The plan for whoever is asked; ``end``: how the arm is left."""
    unit, counts = ("rad" if joint.transmission == 1.0 else "m"), abs(plan.step / joint.units_per_count)
    held = f" {', '.join(others)} will be held where they are." if others else ""
    return (
        f"{joint.name} (servo {joint.servo_id}) will move under torque: from {plan.start:.3f} to {plan.near:.3f} "
        f"{unit}, then to and fro between there and {plan.far:.3f} ({counts:.0f} counts) as steps and as a sine of "
        f"{plan.sine_hz:.2g} Hz, no faster than {plan.speed:.3g} {unit}/s (its limit is {joint.limits.velocity:g})."
        f"{held} {end} See that it has room, off its table, and hold the arm while the torque goes on if it could "
        "fall. Go on?"
    )


REST_S: Final = 1.5
"""Behind each step."""
SHORT_REST_S: Final = 0.8
PERIODS: Final = 3
"""Of the sine; the first is not looked at."""
BEHIND_RAD: Final = 0.35
"""Of a servo's shaft: an STS with half of the factory's P drives with nearly all it has then."""
HEARD_SHARE: Final = 0.8
"""Of the cycles of a motion, in which the joint must have been measured."""
MOVED_SHARE: Final = 0.5
"""Of the way: one that moved by less on the slow pass is held by something; a soft one sags more as it is lifted."""


class Trial:
    """The motions of one joint; it is stopped where it stays behind or its servo protects itself."""

    def __init__(self, arm: SlowArm, index: int, plan: Plan) -> None:
        self._arm, self._index, self._plan = arm, index, plan
        self._joint = arm.joints[index]

    def look_for_room(self) -> tuple[float, float]:
        """Go there, and once to and fro, slowly: what is in the way is met softly.

        Half-way it rests, coming from either side; returns command less position there, first from near.
        """
        near, far = self._plan.near, self._plan.far
        half_way = 0.5 * (near + far)
        self._slowly(near)
        before = self._arm.measured(self._index)
        from_near = self._slowly(half_way)
        self._slowly(far)
        moved = self._arm.measured(self._index) - before
        from_far = self._slowly(half_way)
        self._slowly(near)
        if abs(moved) < MOVED_SHARE * abs(self._plan.step) or moved * self._plan.step < 0.0:
            raise TuneError(
                f"{self._called} was to move by {self._plan.step:+.3f} and moved by {moved:+.3f}: something is in its "
                "way, it lies on something, or it is too weak for its load"
            )
        return from_near, from_far

    def _slowly(self, target: float) -> float:
        """Go there, and rest; command less position then."""
        targets = self._arm.command.copy()
        targets[self._index] = target
        self._arm.go_all(targets, self._look)
        return rest_error(self._for(SHORT_REST_S, lambda time_s: target))

    def step(self, target: float) -> Trace:
        """Send the joint there at once; the gate makes a ramp of it at the joint's slow speed. Then it rests."""
        ramp_s = abs(target - float(self._arm.command[self._index])) / self._plan.speed
        return self._for(ramp_s + REST_S, lambda time_s: target)

    def sine(self) -> Trace:
        """To and fro between near and far, from rest to rest; the first period is left out."""
        near, half, hz = self._plan.near, 0.5 * self._plan.step, self._plan.sine_hz
        whole = self._for(PERIODS / hz, lambda time_s: near + half * (1.0 - cos(2.0 * pi * hz * time_s)))
        later = whole.time_s >= 1.0 / hz
        self._for(SHORT_REST_S, lambda time_s: near)
        return Trace(whole.time_s[later], whole.command[later], whole.position[later])

    def _for(self, seconds: float, position: Callable[[float], float]) -> Trace:
        """Cycles for so long, each towards the ``position`` for the time at its end: cycles may come late."""
        rows, cycles, begin_s = [self._row()], 1, self._arm.asked_s
        while (elapsed_s := self._arm.asked_s - begin_s) < seconds:
            self._arm.cycle(self._index, position(elapsed_s + self._arm.period_s))
            self._look()
            cycles += 1
            if self._joint.name not in self._arm.state.faults:  # else it is the last known place
                rows.append(self._row())
        if len(rows) < HEARD_SHARE * cycles:
            raise TuneError(
                f"{self._called} answered in {len(rows)} of {cycles} cycles, which says nothing of how it moves: "
                "`servoloop doctor` says what is wrong with the line"
            )
        return Trace.of(rows)

    def _row(self) -> tuple[float, float, float]:
        return self._arm.asked_s, float(self._arm.command[self._index]), self._arm.measured(self._index)

    def _look(self) -> None:
        behind = float(self._arm.command[self._index]) - self._arm.measured(self._index)
        alarms = self._arm.state.health[self._joint.name].alarms
        if alarms:
            raise TuneError(f"{self._called} protects itself: {', '.join(alarms)}")
        if abs(behind) > BEHIND_RAD * self._joint.transmission:
            raise TuneError(f"{self._called} stays {behind:+.3f} behind: something is in its way, or it is too weak")

    @property
    def _called(self) -> str:
        return f"{self._joint.name} (servo {self._joint.servo_id})"
