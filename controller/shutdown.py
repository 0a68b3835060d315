"""Shut down the arm: stop the motion, and then either hold the position or park and disable torque."""

import logging
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from controller.final_state import FinalState
from controller.interface import relieving
from controller.loop import ControlLoop
from controller.motion import Kinematics, MotionError, RuckigMotion, motion_to
from controller.stops import StopMotion, return_s
from drivers.driver_errors import DriverError
from hal.components.component import Component
from hal.components.component_lifecycle import clean_up_all, deactivate_all
from hal.hal_errors import HalError
from hal.hardware import Holding, undo_activation
from hal.lifecycle import LifecycleState
from hal.types import FloatArray, JointLimits, joints_of

ARRIVE_S = 0.2
"""Time for which the last command of a motion is held so that the servos can reach it, in seconds."""

LOG = logging.getLogger("servoloop.controller")


def shut_down(
    loop: ControlLoop,
    relax: bool,
    park: Mapping[str, float] | None,
    velocity_scale: float,
    hurry: Callable[[], bool] = lambda: False,
    settle: Callable[[], None] = lambda: None,
) -> list[str]:
    """Shut down the loop and the hardware, and return a description of every step that failed.

    Every step is performed even if an earlier step failed: an arm that cannot be parked is still released. A component
    that has lost one of its serial ports is controlled through its other ports. A lost component whose joints still
    hold their positions is reactivated, then parked and released. If it cannot be reactivated, all of its reachable
    joints are released at their current positions. The log ends with the final state of each component.

    Args:
        loop: The control loop. The loop must no longer be running in any thread.
        relax: Whether to disable torque.
        park: Park pose in rad or m, keyed by joint name. None skips parking.
        velocity_scale: Fraction of the velocity limits used for parking.
        hurry: Function that returns whether to skip the motion to the park pose (after a second signal).
        settle: Function that waits for the background work, which may take several seconds. The joints remain at rest
            during the wait.
    """
    problems: list[str] = []
    parked: list[bool] = []
    failed: list[str] = []
    released: dict[str, Sequence[str]] = {}
    """Errors from releasing components that were not active, keyed by component."""
    loop.requests.end()
    loop.hardware.update_every_cycle()
    if loop.hardware.state is LifecycleState.ACTIVE:
        _try(problems, "stop the motion", lambda: _stop(loop))
    _try(problems, "wait for open component transitions", settle)
    _try(problems, "complete component transitions", loop.component_transitions.end)
    for component in (one for one in loop.hardware.lost if relax and one.written):
        released |= _end_lost(loop, component, hurry(), problems)
    _try(problems, "deactivate the controllers", loop.manager.deactivate)
    if loop.hardware.state is LifecycleState.ACTIVE:
        if not relax:
            _try(problems, "relieve the joints", lambda: _relieve(loop, hurry))
        if relax and park and not hurry():
            _try(problems, "park", lambda: parked.append(_park(loop, park, velocity_scale, hurry)))
    if not relax:
        _try(problems, "check the torque", lambda: _check_torque(loop))
    final_states = [FinalState.of(one, released.get(one.name)) for one in loop.hardware.components]
    if loop.hardware.state is LifecycleState.ACTIVE:
        _try(failed, "switch off", lambda: failed.extend(deactivate_all(loop.hardware, relax)))
    problems += failed + [problem for errors in released.values() for problem in errors]
    _try(problems, "release the port", lambda: clean_up_all(loop.hardware))
    for final_state in final_states:
        LOG.info("%s", final_state.describe(relax, any(parked), failed))
    return problems


def _try(problems: list[str], step: str, action: Callable[[], None]) -> None:
    try:
        action()
    except Exception as error:  # An error in one step must not prevent the next step.
        expected = isinstance(error, DriverError | HalError | MotionError)
        LOG.error("could not %s: %s", step, error, exc_info=None if expected else error)
        problems.append(f"could not {step}: {error}")


def _end_lost(loop: ControlLoop, component: Component, hurry: bool, problems: list[str]) -> dict[str, Sequence[str]]:
    """Reactivate a lost component, or disable its torque at its current position. Return the errors, keyed by
    component."""
    released: dict[str, Sequence[str]] = {}
    if not hurry:
        _try(problems, f"reach {component.name} again", partial(_bring_back, loop, component))
    if component.error is not None:
        _try(problems, f"release {component.name}", lambda: released.update(_release(component)))
    return released


def _bring_back(loop: ControlLoop, component: Component) -> None:
    """Reactivate a lost component whose joints still hold their positions.

    Raises an error if the component cannot be reached.
    """
    hardware = component.hardware
    if not isinstance(hardware, Holding):
        return
    if component.state is LifecycleState.ACTIVE and component.out_of_reach:
        hardware.cleanup()  # The component was lost just now. Its ports must be opened again.
    if component.state is not LifecycleState.UNCONFIGURED:
        return
    hardware.configure()
    if hardware.holds():  # Limp joints have already dropped and stay where they are.
        hardware.activate()
        loop.hardware.rejoin(component)
        try:
            loop.take_over(component, loop.hardware.read())
        except Exception as error:  # The component must not follow commands from before the loss.
            for problem in undo_activation(hardware):
                LOG.error("torque may still be on: %s", problem)
            loop.hardware.lose(component, error)
            raise


def _release(component: Component) -> dict[str, Sequence[str]]:
    """Disable torque on a lost component, unless it is active or finalized.

    Return the errors, keyed by component.
    """
    hardware = component.hardware
    if isinstance(hardware, Holding) and component.state in (LifecycleState.UNCONFIGURED, LifecycleState.INACTIVE):
        return {component.name: hardware.disable_torque()}
    return {}


def _stop(loop: ControlLoop) -> None:
    velocity = (loop.command - loop.previous_command) / loop.period_s
    stop = StopMotion(loop.command, velocity, loop.limits, loop.kinds)
    _drive(loop, stop.sample, stop.duration_s, lambda: False)


def _relieve(loop: ControlLoop, hurry: Callable[[], bool]) -> None:
    """Relieve joints whose torque remains enabled, so that they do not press against an obstacle.

    All joints must be at rest. A joint without an active controller is relieved too, because something may have pushed
    it against an obstacle.
    """
    leaving, due_s = loop.manager.cycle.leaving, loop.clock.now()
    loop.manager.stops.moving.clear()
    leaving.restart(range(len(loop.command)))
    for entry in loop.manager.registry.loaded.values():
        controller = relieving(entry.configured) if entry.state is LifecycleState.INACTIVE else None
        driven = np.isfinite(loop.command[entry.index]).all() and all(map(loop.hardware.ready, entry.commands))
        if controller is not None and driven and not leaving.holds(entry.index):
            leaving.add(controller, entry.index)
    while leaving.entries and loop.hardware.reachable and not hurry():
        state = loop.hardware.read()
        loop.send(loop.manager.cycle.update(state, loop.command, state.stamp_s, loop.period_s))
        due_s += loop.period_s
        loop.clock.sleep_until(due_s)


def _check_torque(loop: ControlLoop) -> None:
    """Ask the servos whether their torque is enabled, so that the log also lists joints that have just become limp."""
    for component in loop.hardware.components:
        if component.active:
            loop.hardware.ask_for_torque(component)


def _return_to_limits(loop: ControlLoop, hurry: Callable[[], bool]) -> None:
    """Wait until the safety gate has slowly returned joints outside their limits to these limits. If a motion began
    earlier, its commands would run ahead of these joints, which would jump to the commands at the limit.
    """
    inside, each = loop.within_limits, zip(loop.command.tolist(), loop.limits, loop.kinds, strict=True)
    duration_s = max((return_s(at, limit) for at, limit, kind in each if kind == "position"), default=0.0)
    if duration_s > 0.0:
        LOG.info("joints outside their limits return slowly in %.1f s", duration_s)
        _drive(loop, lambda elapsed_s: inside, duration_s, hurry)


def _park(loop: ControlLoop, park: Mapping[str, float], scale: float, hurry: Callable[[], bool]) -> bool:
    """Move all joints with a known position to the park pose. Return whether the joints have reached the pose."""
    _return_to_limits(loop, hurry)
    names = joints_of(loop.hardware.command_interfaces)
    known = [i for i, kind in enumerate(loop.kinds) if kind == "position" and np.isfinite(loop.command[i])]
    start = loop.within_limits
    target = np.array([park.get(names[i], start[i]) for i in known])
    motion = _plan(start[known], target, [_slower(loop.limits[i], scale) for i in known])
    LOG.info("parking takes %.1f s", motion.duration_s)

    def sample(elapsed_s: float) -> FloatArray:
        wanted = start.copy()
        wanted[known] = motion.sample(elapsed_s).position
        return wanted

    _drive(loop, sample, motion.duration_s, hurry)
    return loop.hardware.reachable and not hurry()


def _plan(start: FloatArray, target: FloatArray, limits: list[JointLimits]) -> RuckigMotion:
    try:
        return motion_to(Kinematics.at_rest(start), Kinematics.at_rest(target), limits, 0.0)
    except MotionError as error:
        raise MotionError(f"the park pose cannot be reached: {error}") from error


def _slower(limit: JointLimits, scale: float) -> JointLimits:
    return JointLimits(limit.lower, limit.upper, limit.velocity * scale, limit.acceleration, limit.jerk)


def _drive(
    loop: ControlLoop, sample: Callable[[float], FloatArray], duration_s: float, hurry: Callable[[], bool]
) -> None:
    """Execute a motion through the safety gate, at the loop rate, while at least one component is reachable.

    After the motion has ended, raises the error of any component that could not follow.
    """
    elapsed_s = 0.0
    due_s = loop.clock.now()
    while elapsed_s < duration_s + ARRIVE_S and loop.hardware.reachable and not hurry():
        elapsed_s += loop.period_s
        loop.send(sample(elapsed_s))
        due_s += loop.period_s
        loop.clock.sleep_until(due_s)
        loop.hardware.read()
    for component in loop.hardware.lost:
        if component.error is not None and component.hardware.state is LifecycleState.ACTIVE:
            raise component.error
