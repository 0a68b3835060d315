"""The calibration by hand: sweep, direction, anchor. Torque is off all the while; nothing is written here."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import tau
from typing import Final, Protocol

from calibration.angles import Travel
from commissioning.calibrate.direction import last_way
from commissioning.calibrate.plan import JointPlan
from commissioning.calibrate.result import (
    SWEPT_SHARE,
    CalibrationError,
    Found,
    JointCalibration,
    calibration_of,
    unit,
)
from commissioning.calibrate.sweep import Sweep, Swept
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.servos.catalog import series_of
from drivers.servos.register import Register
from hal.joint import Joint

SHOWN_RAD: Final = 0.15
"""So far the servo must turn to show a direction."""
TREMBLE_RAD: Final = 0.05
"""A hand that turns round by less has not turned round."""
TRIES: Final = 5
"""So often the user is asked for the same thing."""


class Guide(Protocol):
    """Whoever moves the arm by hand: a person at a terminal, or a test's hand in the simulation."""

    def until_done(self, task: "Task", look: Callable[[], None]) -> None:
        """Have the task done; ``look`` is to be called all the while, at least ten times a second."""
        ...

    def say(self, text: str) -> None:
        """Tell something that needs no answer."""
        ...


@dataclass(frozen=True, slots=True)
class Task:
    """A task for somebody's hands: ``kind`` for programs, ``text`` for people, ``joints`` in question."""

    kind: str
    text: str
    joints: tuple[str, ...]
    sweep: Sweep
    """What is known of all joints so far."""


def homing_offset(joint: Joint) -> Register | None:
    """The register that moves the seam of the joint's servo; None where it has none for that.

    A Dynamixel's is added to what the encoder says within its turn: it moves no seam.
    """
    series = series_of(joint.model)
    found = [one for one in series.registers if one.name == "homing_offset"]
    return found[0] if found and series.make == "feetech" else None


class ByHand:
    """One calibration by hand of the joints on one bus."""

    def __init__(self, bus: Bus, joints: Sequence[Joint], plans: Mapping[str, JointPlan], guide: Guide) -> None:
        self._bus = bus
        self._joints = tuple(joints)
        self._plans = plans
        self._guide = guide
        self._sweep = Sweep(bus, joints)

    def run(self) -> dict[str, JointCalibration]:
        """Have everything done. Raises CalibrationError where the arm was not moved as asked."""
        self._sweep_all()
        found: dict[str, JointCalibration] = {}
        for joint in self._joints:
            sign, plan = self._direction(joint), self._plans[joint.name]
            anchor = (
                self._pose(joint, plan) if plan.zero == "pose" else anchor_counts(plan, self._swept(joint).travel, sign)
            )
            position = plan.anchor(joint.limits.lower, joint.limits.upper)
            register = homing_offset(joint)
            offset = retry(partial(self._bus.read, joint.servo_id, register)) if register else None
            found[joint.name] = calibration_of(joint, Found(self._swept(joint).travel, sign, anchor, position, offset))
        return found

    def _sweep_all(self) -> None:
        """Have every joint moved from stop to stop; those that were not are asked for once more, by name."""
        text = "Move every joint slowly from stop to stop, in any order"
        left = self._joints
        for _ in range(TRIES):
            self._have_done("sweep", text, left)
            left = tuple(joint for joint in left if not self._is_swept(joint))
            if not left:
                return
            names = ", ".join(joint.name for joint in left)
            text = f"Not yet from stop to stop: {names}. Move {'it' if len(left) == 1 else 'them'} to both stops"
        # What remains is said with the result: an arm may have other stops than its URDF.

    def _is_swept(self, joint: Joint) -> bool:
        range_ = joint.limits.upper - joint.limits.lower
        swept = self._sweep.swept.get(joint.name)
        return swept is not None and swept.travel.span * unit(joint) >= SWEPT_SHARE * range_

    def _swept(self, joint: Joint) -> Swept:
        swept = self._sweep.swept.get(joint.name)
        if swept is None:
            raise CalibrationError(
                f"{joint.name}: servo {joint.servo_id} never answered ({self._sweep.missing.get(joint.name, '')}): "
                "servoloop doctor finds out why"
            )
        return swept

    def _direction(self, joint: Joint) -> int:
        """Have the joint moved the way in which its position grows; the sign with which counts do."""
        text = f"{joint.name}: {self._plans[joint.name].positive}"
        per_rad = joint.model.counts_per_turn / tau
        for _ in range(TRIES):
            way = last_way(self._shown(joint, text), round(TREMBLE_RAD * per_rad))
            if abs(way) >= SHOWN_RAD * per_rad:
                return 1 if way > 0 else -1
            text = f"{joint.name} hardly moved. {self._plans[joint.name].positive}, by the width of a hand or more"
        raise CalibrationError(f"{joint.name}: which way is positive was not shown: nothing was written")

    def _shown(self, joint: Joint, text: str) -> list[int]:
        """The continuous counts of the joint while the user shows its direction."""
        counts = [self._swept(joint).counts]
        self._have_done("direction", text, (joint,), lambda: counts.append(self._swept(joint).counts))
        return counts

    def _pose(self, joint: Joint, plan: JointPlan) -> float:
        """Have the joint brought into its marked pose; the counts there."""
        self._have_done("pose", f"{joint.name}: {plan.pose}, and keep it there", (joint,))
        return self._swept(joint).counts

    def _have_done(
        self, kind: str, text: str, joints: Sequence[Joint], after_look: Callable[[], object] = lambda: None
    ) -> None:
        def look() -> None:
            self._sweep.look()
            after_look()

        look()
        self._guide.until_done(Task(kind, text, tuple(joint.name for joint in joints), self._sweep), look)
        look()


def anchor_counts(plan: JointPlan, travel: Travel, sign: int) -> float:
    """The continuous counts at the middle or at a stop of the travel."""
    if plan.zero == "middle":
        return 0.5 * (travel.lower + travel.upper)
    at_lower = (plan.zero == "lower_stop") == (sign > 0)
    return travel.lower if at_lower else travel.upper


def as_joint(joint: Joint, made: JointCalibration) -> Joint:
    """The joint as calibrated."""
    return replace(joint, sign=made.sign, zero_counts=made.zero_counts, homing_offset=made.homing_offset)
