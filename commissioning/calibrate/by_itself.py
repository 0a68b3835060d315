"""Calibrate an arm automatically: drive each joint with low torque until it is blocked by its stops.

Only STS servos support this. The servos' position limits are disabled in RAM during the calibration (with the EEPROM
locked). The encoder's seam may therefore be anywhere in the travel. Restarting the servos restores the limits.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import partial
from math import ceil, floor
from typing import Final

from commissioning.calibrate.by_hand import ByHand, anchor_counts, require_poses
from commissioning.calibrate.direction_search import DirectionSearch, Watcher
from commissioning.calibrate.plan import ArmPlan, JointPlan
from commissioning.calibrate.result import FoundZero, JointCalibration, calibration_of, turns_freely, unit
from commissioning.calibrate.stop_search import StopSearch
from commissioning.calibrate.store import restart
from commissioning.commissioning_errors import CalibrationError, CommissioningError, text_with_notes
from commissioning.slow_arm import SlowArm
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.clock import Clock
from drivers.driver_errors import DriverError
from drivers.servos import sts
from drivers.servos.angles import Travel
from drivers.types import ServoState
from hal.joint import Joint
from hal.types import JointLimits

REACH: Final = 1.25
"""Maximum distance within which a stop must be found, as a multiple of the range in the URDF."""
DRIVE: Final = 0.5
"""Default torque limit of a joint, as a fraction of full drive."""


def by_itself(
    open_bus: Callable[[], Bus], plan: ArmPlan, watcher: Watcher, clock: Clock, stopped: Callable[[], int]
) -> Callable[[Bus, Sequence[Joint], Mapping[str, JointPlan]], dict[str, JointCalibration]]:
    """Return a function that measures automatically, for use with ``calibrate``. The function closes the bus that is
    passed to it."""

    def measure(bus: Bus, joints: Sequence[Joint], plans: Mapping[str, JointPlan]) -> dict[str, JointCalibration]:
        bus.close()
        return ByItself(open_bus, joints, plan, watcher, clock, stopped).run()

    return measure


class ByItself:
    """Automatic calibration of all joints on one bus."""

    def __init__(
        self,
        open_bus: Callable[[], Bus],
        joints: Sequence[Joint],
        plan: ArmPlan,
        watcher: Watcher,
        clock: Clock,
        stopped: Callable[[], int] = lambda: 0,
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
        """Find all stops and directions, then return the arm to its start position and disable torque.

        Raises CalibrationError, StoppedError or DriverError.
        """
        self._require_able()
        with closing(self._open_bus()) as bus:
            self._poses = ByHand(bus, self._free, self._plan.joints, self._watcher).poses()
            if self._poses:
                self._watcher.say("Take your hands off the arm: it moves on its own now")
            restart(bus, self._joints, self._clock)  # The servos then count goals from the turn that they report.
            here = _readings(bus, self._joints)
            offsets = {j.name: retry(partial(bus.read, j.servo_id, sts.homing_offset)) for j in self._joints}
        with self._without_limits():
            return self._found(here, offsets)

    def _require_able(self) -> None:
        """Raise CalibrationError if a joint cannot be driven to its stops, or has neither stops nor a pose."""
        others = [joint.name for joint in self._joints if joint.model not in sts.MODELS.values()]
        if others:
            raise CalibrationError(
                f"{', '.join(others)}: automatic calibration works only with STS servos. Other servos store their "
                "position limits in EEPROM, which is not changed until you confirm the result. Calibrate by hand"
            )
        require_poses(self._joints, self._plan.joints)

    @contextmanager
    def _without_limits(self) -> Iterator[None]:
        """Disable the position limits in the servos until the context ends, even if it ends with an error."""
        try:
            with closing(self._open_bus()) as bus:
                self._limits_off(bus)
            yield
        except BaseException as error:
            try:
                self._restart()
            except DriverError as second:  # The first error is more important.
                error.add_note(str(second))
            raise
        self._restart()

    def _restart(self) -> None:
        """Restart the servos, so that the values in their EEPROM take effect again. Raises CommissioningError."""
        try:
            with closing(self._open_bus()) as bus:
                restart(bus, self._joints, self._clock)
        except DriverError as error:
            raise CommissioningError(
                "the position limits in the servos may still be disabled, because the servos could not be restarted: "
                f"{text_with_notes(error)}. Switch their supply off and on to restore the limits"
            ) from error

    def _limits_off(self, bus: Bus) -> None:
        for joint in self._joints:
            if retry(partial(bus.read, joint.servo_id, sts.lock)) != 1:
                retry(partial(bus.write, joint.servo_id, sts.lock, 1))
            for register in (sts.min_position, sts.max_position):
                retry(partial(bus.write, joint.servo_id, register, 0))

    def _found(self, here: Mapping[str, int], offsets: Mapping[str, int]) -> dict[str, JointCalibration]:
        """Perform all measurements that require torque to be enabled. Return the calibration of each joint."""
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

    def _found_by_pose(self, joint: Joint, sign: int, offset: int) -> FoundZero:
        """Return the measurement of a joint that turns freely."""
        counts, position = self._poses[joint.name], self._plan.joints[joint.name].at or 0.0
        return FoundZero(Travel(floor(counts), ceil(counts)), sign, counts, position, offset)

    def _travel(self, arm: SlowArm, index: int, sign: int, begun: int, offset: int) -> FoundZero:
        """Find both stops of a joint. Return them with the counts and the joint position at its zero reference."""
        joint, plan = self._joints[index], self._plan.joints[self._joints[index].name]
        self._watcher.say(f"{joint.name} moves to its stops")
        travel = Travel(
            *sorted(begun + round(StopSearch(arm, index, joint, way).run() / unit(joint)) for way in (-1, 1))
        )
        if (
            plan.zero == "pose"
        ):  # The user does not show the pose in this calibration, so the middle of the travel is used instead.
            plan = plan.model_copy(update={"zero": "middle", "at": None})
        return FoundZero(
            travel,
            sign,
            anchor_counts(joint, plan, travel, sign),
            plan.anchor(joint.limits.lower, joint.limits.upper),
            offset,
        )

    def _wait(self, arm: SlowArm, index: int, found: FoundZero, begun: int) -> None:
        """Move the joint to a position in which it leaves room for the other joints."""
        joint = self._joints[index]
        there = self._plan.auto.stops.get(joint.name, 0.0) - found.anchor_position
        arm.go(index, (found.anchor_counts - begun) * unit(joint) + found.sign * there)


def _readings(bus: Bus, joints: Sequence[Joint]) -> dict[str, int]:
    """Return the counts of all servos, keyed by joint name.

    Raises CalibrationError naming every servo that does not respond.
    """
    readings = bus.read_states([joint.servo_id for joint in joints])
    silent = [f"{j.name}: {r.text}" for j in joints if not isinstance(r := readings[j.servo_id], ServoState)]
    if silent:
        raise CalibrationError("; ".join(silent))
    return {j.name: r.position_counts for j in joints if isinstance(r := readings[j.servo_id], ServoState)}


def _counted_from(joint: Joint, counts: int, drive: float) -> Joint:
    """Return a copy of the joint with its zero at these counts, a positive sign and a low torque limit."""
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
