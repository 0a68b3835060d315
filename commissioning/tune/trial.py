"""Plan and run the motions that measure a joint: a slow pass, steps, and a sine."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos, pi, sqrt
from typing import Final

from commissioning.slow_arm import SPEED_SHARE, SlowArm
from commissioning.tune.figures import TuneTrace, rest_error
from commissioning.tune.gains import TuneError
from hal.joint import Joint

LIFT_RAD: Final = 0.35
"""Distance by which a joint first moves away from its start, so that nothing supports it, in rad of the servo's shaft.
The distance is larger than the sag of a servo."""
STEP_RAD: Final = 0.15
"""Size of a step in rad (98 counts of an STS)."""
LEAST_RAD: Final = 0.03
"""Minimum size of a step. Smaller steps show only the effects of dead band and friction."""
ROOM_SHARE: Final = 0.4
"""Maximum length of the lift and of the step, each as a fraction of the distance to the farther limit."""
FASTEST_RAD_S: Final = 1.0
"""Maximum speed of a servo's shaft, unless the URDF's limit is lower."""
SINE_HZ: Final = 1.0
SPEED_MARGIN: Final = 0.8
"""Maximum speed of the sine, as a fraction of the speed limit, so that the safety gate does not distort it."""


@dataclass(frozen=True, slots=True)
class TrialPlan:
    """Motion of a joint, in rad or m: from ``start`` to ``near``, then back and forth between ``near`` and ``far``."""

    joint: str
    start: float
    near: float
    far: float
    speed: float
    """Maximum speed, in rad/s or m/s."""
    sine_hz: float

    @property
    def step(self) -> float:
        """Signed distance from near to far."""
        return self.far - self.near


def plan_for(joint: Joint, start: float, at: float | None = None) -> TrialPlan:
    """Return a plan that moves the joint toward its farther limit. The motions are smaller if space is limited.

    Args:
        joint: The joint.
        start: Present position of the joint.
        at: Position at which to measure; if None, a position slightly away from the start is used.

    Raises:
        TuneError: There is not enough room.
    """
    limits, unit = joint.limits, joint.transmission
    if at is not None and not limits.lower <= at <= limits.upper:
        raise TuneError(
            f"{joint.name} cannot move to {at:.3f}: its limits are {limits.lower:.3f} to {limits.upper:.3f}"
        )
    begin = min(max(start if at is None else at, limits.lower), limits.upper)
    upwards = limits.upper - begin >= begin - limits.lower
    way, room = (1.0, limits.upper - begin) if upwards else (-1.0, begin - limits.lower)
    near = begin if at is not None else begin + way * min(LIFT_RAD * unit, ROOM_SHARE * room)
    step = min(STEP_RAD * unit, ROOM_SHARE * room)
    if step < LEAST_RAD * unit:
        raise TuneError(
            f"{joint.name} does not have enough room to move between its limits {limits.lower:.3f} and "
            f"{limits.upper:.3f}"
        )
    speed = min(SPEED_SHARE * limits.velocity, FASTEST_RAD_S * unit)
    return TrialPlan(joint.name, start, near, near + way * step, speed, _sine_hz(joint, step, speed))


def _sine_hz(joint: Joint, step: float, speed: float) -> float:
    """Return the frequency of a sine whose amplitude is half the step, within the speed and acceleration limits."""
    by_speed = SPEED_MARGIN * speed / (pi * step)
    by_acceleration = sqrt(SPEED_MARGIN * joint.limits.acceleration / (0.5 * step)) / (2.0 * pi)
    return min(SINE_HZ, by_speed, by_acceleration)


def plan_question(joint: Joint, plan: TrialPlan, others: Sequence[str], end: str) -> str:
    """Return the plan as a question for the user. ``end`` is a sentence that describes the state of the arm at the
    end."""
    unit, counts = joint.unit, abs(plan.step / joint.units_per_count)
    held = f" {', '.join(others)} will hold their positions." if others else ""
    return (
        f"{joint.name} (servo {joint.servo_id}) will move with torque enabled: from {plan.start:.3f} to "
        f"{plan.near:.3f} {unit}, then back and forth between {plan.near:.3f} and {plan.far:.3f} {unit} "
        f"({counts:.0f} counts), in steps and as a sine of {plan.sine_hz:.2g} Hz, at most {plan.speed:.3g} {unit}/s "
        f"(its limit is {joint.limits.velocity:g}).{held} {end} Make sure that the arm does not touch its table and "
        "has room to move. If it could fall, support it until the torque is enabled. Continue?"
    )


REST_S: Final = 1.5
"""Time at rest after each step, in seconds."""
SHORT_REST_S: Final = 0.8
PERIODS: Final = 3
"""Number of periods of the sine. The first period is not evaluated."""
BEHIND_RAD: Final = 0.35
"""Maximum following error, in rad of the servo's shaft. At this error, half the factory P results in almost full
drive."""
HEARD_SHARE: Final = 0.8
"""Minimum fraction of a motion's cycles in which the joint must be measured."""
MOVED_SHARE: Final = 0.5
"""Minimum motion in the slow pass, as a fraction of the step. A joint that moves less is blocked."""


class TuneTrial:
    """Motions of one joint, which stop if the joint does not follow its goals or its servo reports an alarm."""

    def __init__(self, arm: SlowArm, index: int, plan: TrialPlan) -> None:
        self._arm, self._index, self._plan = arm, index, plan
        self._joint = arm.joints[index]

    def look_for_room(self) -> tuple[float, float]:
        """Move the joint slowly back and forth once, so that it touches any obstacle gently.

        The joint also stops in the middle in each direction. Return the command minus the position in the middle for
        both directions, starting with the motion from near to far.
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
                f"{self._called} should have moved by {self._plan.step:+.3f}, but it moved by {moved:+.3f}. Check "
                "whether something is in its way, whether it lies on something, or whether it is too weak for its load"
            )
        return from_near, from_far

    def _slowly(self, target: float) -> float:
        """Move slowly to the target, rest, and return the command minus the position."""
        targets = self._arm.command.copy()
        targets[self._index] = target
        self._arm.go_all(targets, self._check)
        return rest_error(self._for(SHORT_REST_S, lambda time_s: target))

    def step(self, target: float) -> TuneTrace:
        """Command a step, which the safety gate turns into a ramp at the planned speed, and wait at the target."""
        ramp_s = abs(target - float(self._arm.command[self._index])) / self._plan.speed
        return self._for(ramp_s + REST_S, lambda time_s: target)

    def sine(self) -> TuneTrace:
        """Move along a sine between the near and far positions. The trace does not include the first period."""
        near, half, hz = self._plan.near, 0.5 * self._plan.step, self._plan.sine_hz
        whole = self._for(PERIODS / hz, lambda time_s: near + half * (1.0 - cos(2.0 * pi * hz * time_s)))
        later = whole.time_s >= 1.0 / hz
        self._for(SHORT_REST_S, lambda time_s: near)
        return TuneTrace(whole.time_s[later], whole.command[later], whole.position[later])

    def _for(self, seconds: float, position: Callable[[float], float]) -> TuneTrace:
        """Run cycles for the given number of seconds. ``position`` returns the goal for the expected end of each
        cycle."""
        rows, cycles, begin_s = [self._row()], 1, self._arm.asked_s
        while (elapsed_s := self._arm.asked_s - begin_s) < seconds:
            self._arm.cycle(self._index, position(elapsed_s + self._arm.period_s))
            self._check()
            cycles += 1
            if self._joint.name not in self._arm.state.faults:  # Otherwise, the position is outdated.
                rows.append(self._row())
        if len(rows) < HEARD_SHARE * cycles:
            raise TuneError(
                f"{self._called} responded in only {len(rows)} of {cycles} cycles, too few to measure its motion. Run "
                "`servoloop doctor` to find the problem of the bus"
            )
        return TuneTrace.of(rows)

    def _row(self) -> tuple[float, float, float]:
        return self._arm.asked_s, float(self._arm.command[self._index]), self._arm.measured(self._index)

    def _check(self) -> None:
        behind = float(self._arm.command[self._index]) - self._arm.measured(self._index)
        alarms = self._arm.state.health[self._joint.name].alarms
        if alarms:
            raise TuneError(f"{self._called} reports an alarm: {', '.join(alarms)}. Run `servoloop doctor` for advice")
        if abs(behind) > BEHIND_RAD * self._joint.transmission:
            raise TuneError(
                f"{self._called} is not following its commands: its following error is {behind:+.3f}. Check whether "
                "something is in its way, or whether it is too weak for its load"
            )

    @property
    def _called(self) -> str:
        return f"{self._joint.name} (servo {self._joint.servo_id})"
