"""A loose servo turns its horn a little there and back, slowly and with little force, and is limp behind it."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from math import tau
from typing import Final

from commissioning.drive_trial import DriveTrial, JointMotion, Pace
from commissioning.set_up.gear import rivals
from commissioning.set_up.only_one import NotYet, state_of
from commissioning.set_up.place import Place
from commissioning.slow_arm import SlowArm, StoppedError
from drivers.bus.bus import Bus
from drivers.bus.retry import retry
from drivers.clock import Clock
from drivers.errors import DriverError, PortLost, ServoError
from drivers.servos.register import Register
from hal.errors import HalError
from hal.joint import Joint
from hal.types import JointLimits

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
