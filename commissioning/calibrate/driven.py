"""The calibration by itself: each joint is driven softly to its stops, which it finds by coming to a stand.

Only STS servos: while it lasts, their own position limits are off (in RAM, behind the closed lock), so that the
encoder's seam may lie anywhere; a restart brings them back.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from math import ceil, floor, tau
from typing import Final, Protocol

import numpy as np

from calibration.angles import Travel
from commissioning.calibrate.flow import ByHand, Guide, anchor_counts, require_poses
from commissioning.calibrate.plan import ArmPlan, JointPlan
from commissioning.calibrate.result import CalibrationError, Found, JointCalibration, calibration_of, turns_freely, unit
from commissioning.calibrate.store import restart
from commissioning.slow_arm import PERIOD_S, SlowArm
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.bus.types import ServoState
from drivers.clock import Clock
from drivers.errors import DriverError
from drivers.servos import sts
from hal.joint import Joint
from hal.types import JointLimits

SEEK_RAD_S: Final = 0.3
STAND_RAD: Final = 0.01
"""A servo that turns by less in ``STAND_S`` stands."""
STAND_S: Final = 0.4
AHEAD_RAD: Final = 0.1
"""So far its goal must be ahead of a servo that stands for it to be at a stop: friction alone does not hold it then."""
REACH: Final = 1.25
"""Without a stop within so many times the URDF's range there is none."""
WIGGLE_RAD: Final = 0.15
NEAR_RAD: Final = 0.3
"""The largest distance to a stop, in the folded pose, at which the stop shows the joint's direction."""
ARRIVED_RAD: Final = 0.12
"""A joint that is farther behind its goal is held up by an obstacle."""
DRIVE: Final = 0.5


class Watcher(Guide, Protocol):
    """A person who watches the arm move by itself, and brings joints that turn freely into their marked poses."""

    def moved_so(self, joint: str, text: str) -> bool:
        """Whether the joint just turned the way that ``text`` says (and not the other way), and came back."""
        ...


def by_itself(
    open_bus: Callable[[], Bus], plan: ArmPlan, watcher: Watcher, clock: Clock, stopped: Callable[[], bool]
) -> Callable[[Bus, Sequence[Joint], Mapping[str, JointPlan]], dict[str, JointCalibration]]:
    """Measuring by the arm itself, for ``calibrate``, which holds the line and lends it."""

    def measure(bus: Bus, joints: Sequence[Joint], plans: Mapping[str, JointPlan]) -> dict[str, JointCalibration]:
        bus.close()
        return ByItself(open_bus, joints, plan, watcher, clock, stopped).run()

    return measure


class ByItself:
    """A calibration of the joints on one bus without hands."""

    def __init__(
        self,
        open_bus: Callable[[], Bus],
        joints: Sequence[Joint],
        plan: ArmPlan,
        watcher: Watcher,
        clock: Clock,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        self._open_bus = open_bus
        self._joints = tuple(joints)
        self._plan = plan
        self._watcher = watcher
        self._clock = clock
        self._stopped = stopped
        self._free = tuple(joint for joint in joints if turns_freely(joint))
        self._poses: dict[str, float] = {}

    def run(self) -> dict[str, JointCalibration]:
        """Find all stops and directions; the arm is back where it lay, limp. Raises CalibrationError, StoppedError."""
        self._require_able()
        with closing(self._open_bus()) as bus:
            self._poses = ByHand(bus, self._free, self._plan.joints, self._watcher).poses()
            if self._poses:
                self._watcher.say("Let the arm go: it moves by itself now")
            restart(bus, self._joints, self._clock)  # so that goals are counted from the turn that the servo says
            here = _readings(bus, self._joints)
            offsets = {j.name: retry(partial(bus.read, j.servo_id, sts.homing_offset)) for j in self._joints}
            self._limits_off(bus)
        try:
            found = self._found(here, offsets)
        except BaseException as error:
            try:
                self._restart()
            except DriverError as second:  # what went wrong before it matters more
                error.add_note(f"the servos' own limits are off until their supply is switched off and on: {second}")
            raise
        self._restart()
        return found

    def _require_able(self) -> None:
        """Raise CalibrationError where a joint cannot be driven to its stops, or has none and no pose."""
        others = [joint.name for joint in self._joints if joint.model not in sts.MODELS.values()]
        if others:
            raise CalibrationError(
                f"{', '.join(others)}: only STS servos calibrate themselves. Others have their position limits in "
                "EEPROM, which is not written before you have seen what was found: calibrate by hand"
            )
        require_poses(self._joints, self._plan.joints)

    def _restart(self) -> None:
        """Have the servos come up with what their EEPROM says."""
        with closing(self._open_bus()) as bus:
            restart(bus, self._joints, self._clock)

    def _limits_off(self, bus: Bus) -> None:
        for joint in self._joints:
            if bus.read(joint.servo_id, sts.lock) != 1:
                bus.write(joint.servo_id, sts.lock, 1)
            for register in (sts.min_position, sts.max_position):
                bus.write(joint.servo_id, register, 0)

    def _found(self, here: Mapping[str, int], offsets: Mapping[str, int]) -> dict[str, JointCalibration]:
        """Everything with the arm under torque."""
        auto = self._plan.auto
        counted = [_counted_from(joint, here[joint.name], auto.drive.get(joint.name, DRIVE)) for joint in self._joints]
        named = {joint.name: index for index, joint in enumerate(self._joints)}
        order = [*auto.stops, *(name for name in named if name not in auto.stops)]
        made: dict[str, JointCalibration] = {}
        with SlowArm(self._open_bus, counted, self._clock, self._stopped) as arm:
            signs = {joint.name: self._direction(arm, named[joint.name], joint) for joint in self._joints}

            def clear(name: str) -> float:
                return signs[name] * (auto.clear[name] - auto.start[name]) if name in auto.clear else 0.0

            for name in auto.clear:
                signs[name] = self._cleared(arm, named[name], signs[name])
            for name in order:
                joint = self._joints[named[name]]
                if name in self._poses:
                    made[name] = calibration_of(joint, self._found_by_pose(joint, signs[name], offsets[name]))
                    continue
                found = self._travel(arm, named[name], signs[name], here[name], offsets[name])
                made[name] = calibration_of(self._joints[named[name]], found)
                self._wait(arm, named[name], found, here[name])
            for name in [*reversed(order)]:
                arm.go(named[name], clear(name))
            for name in reversed(auto.clear):
                arm.go(named[name], 0.0)
        return {joint.name: made[joint.name] for joint in self._joints}

    def _found_by_pose(self, joint: Joint, sign: int, offset: int) -> Found:
        """The measurement of a joint that turns freely."""
        counts, position = self._poses[joint.name], self._plan.joints[joint.name].at or 0.0
        return Found(Travel(floor(counts), ceil(counts)), sign, counts, position, offset)

    def _travel(self, arm: SlowArm, index: int, sign: int, begun: int, offset: int) -> Found:
        """Find both stops, and with them the place that the zero is counted from."""
        joint, plan = self._joints[index], self._plan.joints[self._joints[index].name]
        self._watcher.say(f"{joint.name} goes to its stops")
        travel = Travel(*sorted(begun + round(_Seek(arm, index, joint, way).run() / unit(joint)) for way in (-1, 1)))
        if plan.zero == "pose":  # which nobody shows: the middle is the next best
            plan = plan.model_copy(update={"zero": "middle", "at": None})
        return Found(
            travel,
            sign,
            anchor_counts(joint, plan, travel, sign),
            plan.anchor(joint.limits.lower, joint.limits.upper),
            offset,
        )

    def _wait(self, arm: SlowArm, index: int, found: Found, begun: int) -> None:
        """Go where the joint is out of the others' way."""
        joint = self._joints[index]
        there = self._plan.auto.stops.get(joint.name, 0.0) - found.anchor_position
        arm.go(index, (found.anchor_counts - begun) * unit(joint) + found.sign * there)

    def _cleared(self, arm: SlowArm, index: int, sign: int) -> int:
        """Move a joint out of the way of the others; returns its sign. Asks for it again if the joint is held up."""
        joint, auto = self._joints[index], self._plan.auto
        target = sign * (auto.clear[joint.name] - auto.start[joint.name])
        if self._arrives(arm, index, target):
            return sign
        arm.go(index, 0.0)
        self._watcher.say(f"{joint.name} did not get to where it was sent: once more")
        seen = self._seen(arm, index, joint, -1 if target > 0.0 else 1)
        if self._arrives(arm, index, target * sign * seen):
            return seen
        raise CalibrationError(
            f"{joint.name} (servo {joint.servo_id}) does not get to where it is to be out of the way: lay the arm down "
            "folded with nothing around it, and begin again"
        )

    def _arrives(self, arm: SlowArm, index: int, target: float) -> bool:
        """Move a joint from 0 to the target; returns whether it arrives. A joint that is held up stops at once."""
        joint = self._joints[index]
        step, allowed = SEEK_RAD_S * joint.transmission * PERIOD_S, ARRIVED_RAD * joint.transmission
        for goal in np.linspace(0.0, target, ceil(abs(target) / step) + 1):
            arm.cycle(index, float(goal))
            here = _nearest(arm.measured(index), float(goal), tau * joint.transmission)
            if abs(here - goal) > allowed:
                arm.go(index, here)
                return False
        arm.go(index, target)
        return True

    def _direction(self, arm: SlowArm, index: int, joint: Joint) -> int:
        """Return the sign of a joint, from the stop beside it or from the user's answer."""
        return self._shown_by_stop(arm, index, joint) or self._seen(arm, index, joint, 1)

    def _seen(self, arm: SlowArm, index: int, joint: Joint, first: int) -> int:
        """Turn the joint a little, the ``first`` way if it can, and return the sign that the user's answer gives."""
        for way in (first, -first):
            if self._wiggled(arm, index, way, WIGGLE_RAD) >= 0.5 * WIGGLE_RAD * joint.transmission:
                return way if self._watcher.moved_so(joint.name, self._plan.joints[joint.name].positive) else -way
        raise CalibrationError(
            f"{joint.name} (servo {joint.servo_id}) turns neither way: is it blocked, or too weak for what it carries?"
        )

    def _shown_by_stop(self, arm: SlowArm, index: int, joint: Joint) -> int:
        """Return the sign of a joint near a stop, from which it turns farther than towards it; 0 for other joints."""
        start, limits = self._plan.auto.start.get(joint.name), joint.limits
        if start is None:
            return 0
        near = min(start - limits.lower, limits.upper - start) / joint.transmission
        if near > NEAR_RAD:
            return 0
        up, down = (self._wiggled(arm, index, way, max(near, 0.0) + WIGGLE_RAD) for way in (1, -1))
        if abs(up - down) < 0.5 * WIGGLE_RAD * joint.transmission:
            return 0  # it does not lie as the plan has it
        away = 1 if up > down else -1
        return away if start - limits.lower < limits.upper - start else -away

    def _wiggled(self, arm: SlowArm, index: int, way: int, angle_rad: float) -> float:
        """Turn a joint a little and back; returns the angle that it turned."""
        joint = self._joints[index]
        self._watcher.say(f"{joint.name} turns a little, and back")
        arm.go(index, way * angle_rad * joint.transmission)
        moved = _nearest(arm.measured(index), 0.0, tau * joint.transmission) * way
        arm.go(index, 0.0)
        return moved


class _Seek:
    """The way of one joint to one stop."""

    def __init__(self, arm: SlowArm, index: int, joint: Joint, way: int) -> None:
        self._arm = arm
        self._index = index
        self._joint = joint
        self._way = way
        self._turn = tau * joint.transmission

    def run(self) -> float:
        """The joint's position at the stop, from where it began; its goal is taken back to there."""
        last = self._position(float(self._arm.command[self._index]))
        stood_s = 0.0
        while stood_s < STAND_S or self._ahead(last) < AHEAD_RAD * self._joint.transmission:
            self._step()
            now = self._position(last)
            stood_s = stood_s + PERIOD_S if abs(now - last) <= STAND_RAD * self._joint.transmission else 0.0
            last = now if stood_s == 0.0 else last
        now = self._position(last)
        self._arm.go(self._index, now)
        return now

    def _step(self) -> None:
        target = float(self._arm.command[self._index]) + self._way * SEEK_RAD_S * self._joint.transmission * PERIOD_S
        if abs(target) >= self._arm.joints[self._index].limits.upper:
            raise CalibrationError(
                f"{self._joint.name} (servo {self._joint.servo_id}) turned {abs(target):.2f} and found no stop: "
                "calibrate it by hand"
            )
        self._arm.cycle(self._index, target)

    def _ahead(self, position: float) -> float:
        return (float(self._arm.command[self._index]) - position) * self._way

    def _position(self, near: float) -> float:
        """Where the joint is, turns included: the reading nearest to where it was."""
        return _nearest(self._arm.measured(self._index), near, self._turn)


def _nearest(measured: float, near: float, turn: float) -> float:
    """The position that a reading stands for, which says the place within the turn alone."""
    return measured + round((near - measured) / turn) * turn


def _readings(bus: Bus, joints: Sequence[Joint]) -> dict[str, int]:
    """The counts of all servos, which lie still. Raises CalibrationError with all that do not answer."""
    readings = bus.read_states([joint.servo_id for joint in joints])
    silent = [f"{j.name}: {r.text}" for j in joints if not isinstance(r := readings[j.servo_id], ServoState)]
    if silent:
        raise CalibrationError("; ".join(silent))
    return {j.name: r.position_counts for j in joints if isinstance(r := readings[j.servo_id], ServoState)}


def _counted_from(joint: Joint, counts: int, drive: float) -> Joint:
    """A joint whose position is what its servo has turned from here, towards larger counts, with little drive."""
    range_ = REACH * (joint.limits.upper - joint.limits.lower)
    limits = JointLimits(-range_, range_, joint.limits.velocity, joint.limits.acceleration, joint.limits.jerk)
    drive = min(drive, joint.torque_limit)
    return replace(
        joint,
        sign=1,
        zero_counts=counts,
        homing_offset=None,
        seam_inside=True,
        settings=(),
        limits=limits,
        torque_limit=drive,
    )
