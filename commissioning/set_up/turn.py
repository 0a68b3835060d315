"""Turn the horn of a loose servo slightly back and forth to identify its gear. Torque is off at the end."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from math import log, tau
from typing import Final, Literal

from commissioning.drive_trial import STUCK_SHARE, DriveTrial, TrialMotion, TrialPace
from commissioning.set_up.only_one import NotYet, ServoPlace, state_of
from commissioning.slow_arm import SlowArm, StoppedError
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.clock import Clock
from drivers.driver_errors import DriverError, PortLost, ServoError
from drivers.servos import sts
from drivers.servos.catalog import series_of
from drivers.servos.register import Register, ServoModel
from hal.hal_errors import HalError
from hal.joint import Joint
from hal.types import JointLimits

GEARS: Final = {sts.STS3215: 345, sts.STS3215_C001: 345, sts.STS3215_C044: 191, sts.STS3215_C046: 147}
"""Gear ratios (motor turns per shaft turn) of models with the same model number, from the manufacturers' data sheets.
"""
FITS: Final = 0.22
"""Maximum of |ln(measured / expected)| for a model. Motors of the same model differ by up to 10 %, and cold motors by
more."""
CLEARLY: Final = 0.06
"""Minimum difference of |ln(measured / expected)| between the best and the second-best model."""
PULLS: Final = 0.1
"""Maximum constant drive of a free horn, as a fraction of full drive. A larger drive shows that something is pulling on
the horn.
"""
Verdict = Literal["fits", "other", "not sure"]


@dataclass(frozen=True, slots=True)
class GearResult:
    """Result of the gear test of a loose servo."""

    verdict: Verdict
    text: str
    """Explanation to show to the user."""
    v_s_rad: float | None = None
    """Voltage per rad/s of the shaft, excluding friction."""


def rivals(model: ServoModel) -> tuple[ServoModel, ...]:
    """Return the other models of the series with the same model number."""
    return tuple(one for one in series_of(model).models if one.number == model.number and one != model)


def v_s_rad(model: ServoModel) -> float:
    """Return the voltage per rad/s of the model's shaft, derived from its data sheet."""
    return model.rated_voltage_v / model.no_load_speed_rad_s


def called(model: ServoModel) -> str:
    """Return the name of a model, including its rated voltage and gear ratio."""
    gear = f", gear 1:{GEARS[model]}" if model in GEARS else ""
    return f"{model.name} ({model.rated_voltage_v:g} V{gear})"


def judge_gear(motion: TrialMotion | None) -> GearResult:
    """Compare the drive of a servo that has turned its free horn with the possible models.

    ``motion`` is None if the servo did not have enough room to turn.
    """
    if motion is None:
        return GearResult("not sure", "it is too close to its position limits to turn")
    model, faster = motion.joint.model, motion.faster
    if motion.moved / motion.asked < STUCK_SHARE or faster is None:
        return GearResult("not sure", "its horn did not move far enough: it is blocked, or the servo has no force")
    measured = round(v_s_rad(model) / faster, 3)
    if abs(motion.pull) > PULLS:
        return GearResult("not sure", "something pulls at its horn", measured)
    off = {one: abs(log(measured / v_s_rad(one))) for one in (model, *rivals(model))}
    nearest = min(off.values())
    needs = f"it needs {measured:.2f} V per rad/s; an {called(model)} needs {v_s_rad(model):.2f} V"
    if nearest > FITS:
        return GearResult("not sure", f"{needs}, and the value fits no known model", measured)
    candidates = sorted((one for one in off if off[one] - nearest < CLEARLY), key=v_s_rad)
    names = " or an ".join(called(one) for one in candidates)
    if model not in candidates:
        return GearResult("other", f"{needs}, so it is probably an {names}", measured)
    if candidates == [model]:
        return GearResult("fits", needs, measured)
    return GearResult("not sure", f"{needs}, so it may be an {names}", measured)


WAY_RAD: Final = 0.8
"""Angle by which the horn turns back and forth, in rad."""
FASTEST_RAD_S: Final = 0.8
"""Speed at which the goal moves. The horn itself turns up to 50 % faster. Its speed is then a quarter of the slowest
model's no-load speed. At lower speeds, two gears cannot be distinguished reliably.
"""
PERIOD_S: Final = 0.04
PACE: Final = TrialPace(slow=0.3, ramp_s=0.2, rest_s=0.2)
TORQUE_SHARE: Final = 0.5
"""Torque limit, as a fraction of full drive.

The servo needs half of this limit to reach the test speed; the other half allows for friction and weak models.
"""
MARGIN_COUNTS: Final = 32
"""Minimum distance to the encoder's seam and the servo's limits, because the horn may overshoot."""
LEAST_ROOM_RAD: Final = 0.4
"""Minimum angle that the horn must be able to turn."""
ACCELERATION_RAD_S2: Final = 10.0
JERK_RAD_S3: Final = 100.0
"""Limits that every joint must have but that this module does not use."""


def turn_loose(
    bus: Bus, clock: Clock, servo_id: int, place: ServoPlace, stopped: Callable[[], bool]
) -> TrialMotion | None:
    """Turn the horn of the only servo on the bus.

    Return the motion, or None if there is no room to turn. The servo must be in position mode with torque off. At the
    end, even after an error, the servo's torque is off and its torque limit is restored. If this is impossible because
    the servo does not respond, a note is added to the exception. Raises StoppedError, NotYet, ServoError, PortLost.
    """
    joint = _loose_joint(bus, servo_id, place)
    if joint is None:
        return None
    way = max(joint.limits.lower, joint.limits.upper, key=abs)
    with _left_limp(bus, servo_id, place), bus.at_baud(bus.baud, {servo_id: place.model}) as line:
        try:
            with SlowArm(lambda: line, [joint], clock, stopped, FASTEST_RAD_S, PERIOD_S) as arm:
                arm.relax = False  # The horn carries no load, so torque is disabled without lowering the horn first.
                trial = DriveTrial(arm, 0, way, PACE)
                trial.run()
        except (DriverError, HalError) as error:
            if isinstance(error, PortLost) or (isinstance(error, StoppedError) and stopped()):
                raise
            raise NotYet(str(error)) from error
    return trial.motion()


def may_hold_text(servo_id: int) -> str:
    """Return the message or note of an exception of ``turn_loose`` if the torque of the servo may still be on."""
    return f"the torque of servo {servo_id} may still be on: unplug the servo or switch its supply off"


def _loose_joint(bus: Bus, servo_id: int, place: ServoPlace) -> Joint | None:
    """Return the horn as a joint at position 0 that can turn to the side with more room; None if there is no room."""
    here = state_of(bus, servo_id).position_counts
    lowest, highest = bus.position_limits(servo_id) or (0, place.model.last_count)
    below = here - max(lowest, 0) - MARGIN_COUNTS
    above = min(highest, place.model.last_count) - MARGIN_COUNTS - here
    rad = tau / place.model.counts_per_turn
    room = min(WAY_RAD, max(below, above) * rad)
    if room < LEAST_ROOM_RAD or not lowest <= here <= highest:
        return None
    lower, upper = (0.0, room) if above >= below else (-room, 0.0)
    slowest = min(model.no_load_speed_rad_s for model in (place.model, *rivals(place.model)))
    limits = JointLimits(lower, upper, slowest, ACCELERATION_RAD_S2, JERK_RAD_S3)
    return Joint(place.joint, servo_id, place.model, limits, zero_counts=here, torque_limit=TORQUE_SHARE)


@contextmanager
def _left_limp(bus: Bus, servo_id: int, place: ServoPlace) -> Iterator[None]:
    """Disable torque and restore the torque limit when the context ends. Report a failure."""
    register = place.series.torque_limit
    before = {} if register is None else {register: retry(partial(bus.read, servo_id, register))}
    may_hold = may_hold_text(servo_id)
    try:
        yield
    except BaseException as error:
        if not _release(bus, servo_id, place, before):
            error.add_note(may_hold)
        raise
    if not _release(bus, servo_id, place, before):
        raise NotYet(may_hold)


def _release(bus: Bus, servo_id: int, place: ServoPlace, before: Mapping[Register, int]) -> bool:
    """Disable torque, then restore these registers. Return whether the servo acknowledged all writes."""
    try:
        for register, value in {place.series.torque_enable: 0, **before}.items():
            retry(partial(bus.write, servo_id, register, value))
    except (ServoError, PortLost):
        return False
    return True
