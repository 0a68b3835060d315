"""The calibration by itself: each joint is driven softly to its stops, which it finds by coming to a stand.

Only STS servos: while it lasts, their own position limits are off (in RAM, behind the closed lock), so that the
encoder's seam may lie anywhere; a restart brings them back.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from math import ceil, floor
from typing import Final

from calibration.angles import Travel
from commissioning.calibrate.by_hand import ByHand, anchor_counts, require_poses
from commissioning.calibrate.direction_search import DirectionSearch, Watcher
from commissioning.calibrate.plan import ArmPlan, JointPlan
from commissioning.calibrate.result import CalibrationError, Found, JointCalibration, calibration_of, turns_freely, unit
from commissioning.calibrate.stop_search import StopSearch
from commissioning.calibrate.store import restart
from commissioning.slow_arm import SlowArm
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.bus.types import ServoState
from drivers.clock import Clock
from drivers.errors import DriverError
from drivers.servos import sts
from hal.joint import Joint
from hal.types import JointLimits

REACH: Final = 1.25
"""Without a stop within so many times the URDF's range there is none."""
DRIVE: Final = 0.5


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
            search = DirectionSearch(arm, self._joints, self._plan, self._watcher)
            signs = {joint.name: search.direction(named[joint.name]) for joint in self._joints}

            def clear(name: str) -> float:
                return signs[name] * (auto.clear[name] - auto.start[name]) if name in auto.clear else 0.0

            for name in auto.clear:
                signs[name] = search.cleared(named[name], signs[name])
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
        travel = Travel(
            *sorted(begun + round(StopSearch(arm, index, joint, way).run() / unit(joint)) for way in (-1, 1))
        )
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
