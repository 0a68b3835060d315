"""A loose servo turns its horn a little there and back, slowly and with little force, and is limp behind it."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from math import log, tau
from typing import Final, Literal

from commissioning.drive_trial import STUCK_SHARE, DriveTrial, JointMotion, Pace
from commissioning.set_up.only_one import NotYet, Place, state_of
from commissioning.slow_arm import SlowArm, StoppedError
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.clock import Clock
from drivers.errors import DriverError, PortLost, ServoError
from drivers.servos import sts
from drivers.servos.catalog import series_of
from drivers.servos.register import Register, ServoModel
from hal.errors import HalError
from hal.joint import Joint
from hal.types import JointLimits

GEARS: Final = {sts.STS3215: 345, sts.STS3215_C001: 345, sts.STS3215_C044: 191, sts.STS3215_C046: 147}
"""Turns of the motor in one of the shaft, by the makers' data sheets, of models that say one number."""
FITS: Final = 0.22
"""Natural logarithm of measured by expected: motors of one model differ by up to a tenth, a cold one needs more."""
CLEARLY: Final = 0.06
"""The same: by so much nearer to one model than to the next."""
PULLS: Final = 0.1
"""Of full drive: a loose horn has nothing that pulls at it one way."""
Verdict = Literal["fits", "other", "not sure"]


@dataclass(frozen=True, slots=True)
class GearLook:
    """What a turn of a loose servo has shown of its gear; ``text`` for people."""

    verdict: Verdict
    text: str
    v_s_rad: float | None = None
    """The voltage that a rad/s of its shaft needs, friction aside."""


def rivals(model: ServoModel) -> tuple[ServoModel, ...]:
    """The models of its series that say the same number."""
    return tuple(one for one in series_of(model).models if one.number == model.number and one != model)


def v_s_rad(model: ServoModel) -> float:
    """The voltage that a rad/s of the model's shaft needs, by its data sheet."""
    return model.rated_voltage_v / model.no_load_speed_rad_s


def called(model: ServoModel) -> str:
    """The model's name with that in which those of its number differ."""
    gear = f", gear 1:{GEARS[model]}" if model in GEARS else ""
    return f"{model.name} ({model.rated_voltage_v:g} V{gear})"


def judge_gear(motion: JointMotion | None) -> GearLook:
    """Whether a servo that turned loosely is of its joint's model, as far as its drive tells. None: it has no room."""
    if motion is None:
        return GearLook("not sure", "it stands too near to its position limits to turn")
    model, faster = motion.joint.model, motion.faster
    if motion.moved / motion.asked < STUCK_SHARE or faster is None:
        return GearLook("not sure", "its horn did not follow: it is not free, or has no force")
    measured = round(v_s_rad(model) / faster, 3)
    if abs(motion.pull) > PULLS:
        return GearLook("not sure", "something pulls at its horn", measured)
    off = {one: abs(log(measured / v_s_rad(one))) for one in (model, *rivals(model))}
    nearest = min(off.values())
    needs = f"a rad/s needs {measured:.2f} V, and {v_s_rad(model):.2f} V in a {called(model)}"
    if nearest > FITS:
        return GearLook("not sure", f"{needs}: no model that is known", measured)
    seems = sorted((one for one in off if off[one] - nearest < CLEARLY), key=v_s_rad)
    said = " or a ".join(called(one) for one in seems)
    if model not in seems:
        return GearLook("other", f"{needs}: it seems to be a {said}", measured)
    return (
        GearLook("fits", needs, measured) if seems == [model] else GearLook("not sure", f"{needs}: a {said}", measured)
    )


WAY_RAD: Final = 0.8
"""The horn's way, there and back."""
FASTEST_RAD_S: Final = 0.8
"""Where it runs up to a goal it is up to half as fast again: a quarter of the slowest model's speed without load. More
slowly two gears cannot be told apart for sure."""
PERIOD_S: Final = 0.04
PACE: Final = Pace(slow=0.3, ramp_s=0.2, rest_s=0.2)
TORQUE_SHARE: Final = 0.5
"""Of full drive: a quarter is for the speed, the rest for friction and for the weakest servo that may be there."""
MARGIN_COUNTS: Final = 32
"""So far it stays from the encoder's seam and the servo's limits: it may overshoot."""
LEAST_ROOM_RAD: Final = 0.4
ACCELERATION_RAD_S2: Final = 10.0
JERK_RAD_S3: Final = 100.0
"""What a joint must have; nobody plans by them here."""


def turn_loose(bus: Bus, clock: Clock, servo_id: int, place: Place, stopped: Callable[[], bool]) -> JointMotion | None:
    """What the servo did; None where it stands so near to its limits that it has no room.

    It is alone on the line, set to position mode and limp. However this ends, its torque is off and its torque limit
    the one before, as far as it can be reached. Raises StoppedError, NotYet, ServoError, PortLost; where it could not
    be reached, their notes say so.
    """
    joint = _loose_joint(bus, servo_id, place)
    if joint is None:
        return None
    way = max(joint.limits.lower, joint.limits.upper, key=abs)
    with _left_limp(bus, servo_id, place), bus.at_baud(bus.baud, {servo_id: place.model}) as line:
        try:
            with SlowArm(lambda: line, [joint], clock, stopped, FASTEST_RAD_S, PERIOD_S) as arm:
                arm.relax = False  # nothing hangs on it: it is let go at once, by who called
                trial = DriveTrial(arm, 0, way, PACE)
                trial.run()
        except (DriverError, HalError) as error:
            if isinstance(error, PortLost) or (isinstance(error, StoppedError) and stopped()):
                raise
            raise NotYet(str(error)) from error
    return trial.motion()


def _loose_joint(bus: Bus, servo_id: int, place: Place) -> Joint | None:
    """The horn as a joint that is at 0 where it stands, and has room on the side where there is more."""
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
def _left_limp(bus: Bus, servo_id: int, place: Place) -> Iterator[None]:
    """Behind it the torque is off, and its limit the one before, however the block ends; or it says that it is not."""
    register = place.series.torque_limit
    before = {} if register is None else {register: retry(partial(bus.read, servo_id, register))}
    may_hold = f"servo {servo_id} may hold torque: unplug it, or switch its supply off"
    try:
        yield
    except BaseException as error:
        if not _let_go(bus, servo_id, place, before):
            error.add_note(may_hold)
        raise
    if not _let_go(bus, servo_id, place, before):
        raise NotYet(may_hold)


def _let_go(bus: Bus, servo_id: int, place: Place, before: Mapping[Register, int]) -> bool:
    """Switch the torque off, then write the registers of before; whether the servo has acknowledged all that."""
    try:
        for register, value in {place.series.torque_enable: 0, **before}.items():
            retry(partial(bus.write, servo_id, register, value))
    except (ServoError, PortLost):
        return False
    return True
