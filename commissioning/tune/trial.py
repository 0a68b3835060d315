"""The motions of one joint that is measured: a slow pass first, steps, a sine."""

from collections.abc import Callable
from math import cos, pi
from typing import Final

from commissioning.slow_arm import SlowArm
from commissioning.tune.errors import TuneError
from commissioning.tune.figures import Trace
from commissioning.tune.plan import Plan

REST_S: Final = 1.5
"""Behind each step."""
PERIODS: Final = 3
"""Of the sine; the first is not looked at."""
BEHIND_RAD: Final = 0.35
"""Of a servo's shaft: an STS with half of the factory's P drives with nearly all it has then."""
MOVED_SHARE: Final = 0.7
"""Of the way: a joint that moved by less on the first slow pass is held by something, or lies on something."""


class Trial:
    """The motions of one joint; it is stopped where it stays behind or its servo protects itself."""

    def __init__(self, arm: SlowArm, index: int, plan: Plan) -> None:
        self._arm, self._index, self._plan = arm, index, plan
        self._joint = arm.joints[index]

    def look_for_room(self) -> None:
        """Go there, and once to and fro, slowly: what is in the way is met softly."""
        self._slowly(self._plan.near)
        before = self._arm.measured(self._index)
        self._slowly(self._plan.far)
        moved = self._arm.measured(self._index) - before
        self._slowly(self._plan.near)
        if abs(moved) < MOVED_SHARE * abs(self._plan.step) or moved * self._plan.step < 0.0:
            raise TuneError(
                f"{self._joint.name} (servo {self._joint.servo_id}) was to move by {self._plan.step:+.3f} and moved by "
                f"{moved:+.3f}: something is in its way, it lies on something, or it is too weak for its load"
            )

    def _slowly(self, target: float) -> None:
        targets = self._arm.command.copy()
        targets[self._index] = target
        self._arm.go_all(targets, self._look)
        self._for(REST_S / 2.0, lambda time_s: target)

    def step(self, target: float) -> Trace:
        """Send the joint there at once; the gate makes a ramp of it at the joint's slow speed. Then it rests."""
        ramp_s = abs(target - float(self._arm.command[self._index])) / self._plan.speed
        return self._for(ramp_s + REST_S, lambda time_s: target)

    def sine(self) -> Trace:
        """To and fro between near and far, from rest to rest; the first period is left out."""
        near, half, hz = self._plan.near, 0.5 * self._plan.step, self._plan.sine_hz
        whole = self._for(PERIODS / hz, lambda time_s: near + half * (1.0 - cos(2.0 * pi * hz * time_s)))
        later = whole.time_s >= 1.0 / hz
        self._for(REST_S / 2.0, lambda time_s: near)
        return Trace(whole.time_s[later], whole.command[later], whole.position[later])

    def _for(self, seconds: float, position: Callable[[float], float]) -> Trace:
        """Cycles for so long, each towards the ``position`` for the time at its end: cycles may come late."""
        rows, begin_s = [self._row()], self._arm.asked_s
        while (elapsed_s := self._arm.asked_s - begin_s) < seconds:
            self._arm.cycle(self._index, position(elapsed_s + self._arm.period_s))
            self._look()
            rows.append(self._row())
        return Trace.of(rows)

    def _row(self) -> tuple[float, float, float]:
        return self._arm.asked_s, float(self._arm.command[self._index]), self._arm.measured(self._index)

    def _look(self) -> None:
        behind = float(self._arm.command[self._index]) - self._arm.measured(self._index)
        alarms = self._arm.state.health[self._joint.name].alarms
        called = f"{self._joint.name} (servo {self._joint.servo_id})"
        if alarms:
            raise TuneError(f"{called} protects itself: {', '.join(alarms)}")
        if abs(behind) > BEHIND_RAD * self._joint.transmission:
            raise TuneError(f"{called} stays {behind:+.3f} behind: something is in its way, or it is too weak")
