"""How the arm is left: stop the motion, then hold, or park and let go. Needs no controller."""

import logging
from collections.abc import Callable, Mapping

import numpy as np

from controller.loop import ControlLoop
from controller.motion import Kinematics, Motion, MotionError, WayPoint, plan, plan_stop
from hal.lifecycle import LifecycleState
from hal.types import FloatArray, JointLimits

ARRIVE_S = 0.2
"""So long the end of a motion is held, for the servos to get there."""

LOG = logging.getLogger("servoloop.controller")


def end(
    loop: ControlLoop,
    relax: bool,
    park: Mapping[str, float] | None,
    velocity_scale: float,
    hurry: Callable[[], bool] = lambda: False,
) -> list[str]:
    """Bring everything to its end, whatever fails on the way; returns what failed.

    ``park`` maps joint names to rad or m; ``hurry`` (a second signal) skips the way there.
    Every step is tried even if the one before it failed: an arm that cannot be parked is still let go.
    """
    problems: list[str] = []
    loop.requests.end()
    if loop.hardware.state is LifecycleState.ACTIVE:
        _try(problems, "stop the motion", lambda: _stop(loop))
        _try(problems, "end the controllers", loop.manager.deactivate)
        if relax and park and not hurry():
            _try(problems, "park", lambda: _park(loop, park, velocity_scale, hurry))
        _try(problems, "switch off", lambda: problems.extend(loop.hardware.deactivate(relax)))
    _try(problems, "release the port", loop.hardware.cleanup)
    return problems


def _try(problems: list[str], what: str, action: Callable[[], None]) -> None:
    try:
        action()
    except Exception as error:  # the next step matters more than this one's failure
        LOG.error("could not %s: %s", what, error)
        problems.append(f"could not {what}: {error}")


def _stop(loop: ControlLoop) -> None:
    velocity = (loop.command - loop.previous_command) / loop.period_s
    bound = np.array([limit.velocity for limit in loop.limits])
    start = Kinematics(loop.command, np.clip(velocity, -bound, bound), np.zeros_like(loop.command))
    _drive(loop, plan_stop(start, loop.limits), lambda: False)


def _park(loop: ControlLoop, park: Mapping[str, float], scale: float, hurry: Callable[[], bool]) -> None:
    pairs = zip(loop.hardware.joints, loop.command, strict=True)
    target = np.array([park.get(name, held) for name, held in pairs])
    slow = [_slower(limit, scale) for limit in loop.limits]
    way = WayPoint(Kinematics.at_rest(target), 0.0)
    try:
        motion = plan(Kinematics.at_rest(loop.command), [way], slow)
    except MotionError as error:
        raise MotionError(f"the park pose cannot be reached: {error}") from error
    LOG.info("parking: %.1f s", motion.duration_s)
    _drive(loop, motion, hurry)


def _slower(limit: JointLimits, scale: float) -> JointLimits:
    return JointLimits(limit.lower, limit.upper, limit.velocity * scale, limit.acceleration, limit.jerk)


def _drive(loop: ControlLoop, motion: Motion, hurry: Callable[[], bool]) -> None:
    """Follow the motion at the loop's own rate, through the gate."""
    elapsed_s = 0.0
    due_s = loop.clock.now()
    while elapsed_s < motion.duration_s + ARRIVE_S and not hurry():
        elapsed_s += loop.period_s
        wanted: FloatArray = motion.sample(elapsed_s).position
        loop.send(wanted)
        due_s += loop.period_s
        loop.clock.sleep_until(due_s)
        loop.hardware.read()
