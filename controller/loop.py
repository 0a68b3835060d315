"""Run the fixed-rate control loop: read, update the controllers, apply the safety gate, write."""

import logging
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from controller.component_transitions import NO_BACKGROUND, ComponentTransitions, TransitionRules
from controller.gate_log import log_gate
from controller.loop_figures import LoopFigures
from controller.manager.manager import ControllerManager
from controller.manager.requests import LoopRequests
from drivers.clock import Clock, computing_time
from hal.components.component import Component
from hal.components.component_lifecycle import activate_all, undo_all
from hal.components.component_set import ComponentSet
from hal.confirm import confirmed_positions
from hal.gate import SafetyGate
from hal.hal_errors import ActivationError
from hal.types import FloatArray, Interface, JointLimits, JointState, far_outside, joints_of

LOG = logging.getLogger("servoloop.controller")

REMEMBERED: Final = 0.95
"""Factor by which the recorded maximum duration of the steps after the read decays in each cycle."""
RESERVE_MARGIN: Final = 0.1
"""Fraction of the period that the read leaves free, in addition to the time that the other steps have recently needed.
Without this margin, a cycle that waits for a late reply would end slightly too late, and the next cycle would be
missed."""
READ_AT_LEAST: Final = 1.25
"""Minimum time for a read, as a multiple of the fastest complete read. On a bus or machine that is too slow for the
rate, cycles are then missed, but the joints are measured."""


class ControlLoop:
    """Fixed-rate loop, owned by one thread.

    ``step`` runs one cycle, and tests call it directly. ``run`` calls ``step`` at the fixed rate.

    """

    def __init__(
        self,
        hardware: ComponentSet,
        manager: ControllerManager,
        limits: Mapping[str, JointLimits],
        clock: Clock,
        period_s: float,
        rules: TransitionRules = NO_BACKGROUND,
    ) -> None:
        """Create a loop whose hardware and controllers are still inactive.

        Args:
            hardware: All hardware components, with m command interfaces.
            manager: The controller manager.
            limits: Limits of each joint, keyed by joint name.
            clock: Clock that paces the loop.
            period_s: Period of the loop, in seconds.
            rules: Rules for component transitions.
        """
        self.hardware = hardware
        hardware.filter_leaps(limits)
        self.manager = manager
        self.clock = clock
        self.period_s = period_s
        self.figures = LoopFigures()
        self.requests = LoopRequests()
        interfaces = [Interface.parse(name) for name in self.hardware.command_interfaces]
        self.limits = tuple(limits[joint] for joint, _ in interfaces)
        """Joint limits for each command interface."""
        self.kinds = tuple(kind for _, kind in interfaces)
        """Type of each command interface: position, velocity or effort."""
        self._joint = [self.hardware.joints.index(joint) for joint, _ in interfaces]
        self._is_position = np.array([kind == "position" for kind in self.kinds], dtype=bool)
        self.command: FloatArray = np.where(self._is_position, np.nan, 0.0)
        self.previous_command = self.command
        self._lower = np.array([limit.lower for limit in self.limits])
        self._upper = np.array([limit.upper for limit in self.limits])
        self._velocity = np.array([limit.velocity for limit in self.limits])
        self._gate = SafetyGate(self.limits, self.kinds)
        self._gated: dict[int, str] = {}
        self._drives_speeds = "velocity" in self.kinds
        self._measured: FloatArray | None = None
        """Joint position for each command interface; None if the gate does not need the positions."""
        self._due_s: float | None = None
        """Time at which the current cycle was due, or None if ``run`` does not pace the loop."""
        self._after_read_s = 0.0
        """Longest recent duration of the steps after the read, in seconds."""
        self._fastest_read_s = math.inf
        """Duration of the fastest read in which all joints were measured, in seconds; infinite before this read."""
        self.on_cycle: Callable[[JointState], None] = lambda state: None
        """Function called at the end of each cycle with the measured joint state. An exception in this function
        does not stop the loop.
        """
        self._keep_alive = rules.keep_alive
        self.component_transitions = ComponentTransitions(hardware, manager, self.take_over, self._resume, rules)

    def activate(self, keep_inactive: Collection[str] = (), keep_alive: bool | None = None) -> None:
        """Activate the hardware at its current position, and then activate the controllers.

        Args:
            keep_inactive: Names of components that remain inactive.
            keep_alive: Whether a component that cannot be activated remains inactive instead of raising an error. If
                None, the loop's own ``keep_alive`` setting applies.

        Raises:
            DriverError: A component does not respond.
            ActivationError: A component cannot be activated safely, or a joint's position is unknown, unconfirmed, or
                far outside its limits.
        """
        try:
            activate_all(self.hardware, keep_inactive, self._keep_alive if keep_alive is None else keep_alive)
            begin_s, state = self.clock.now(), self.hardware.read()
            if not state.faults:
                self._fastest_read_s = self.clock.now() - begin_s
            for component in self.hardware.components:
                if component.active:
                    self.take_over(component, state)
            self.manager.activate(state, self.within_limits)
        except BaseException:
            for problem in undo_all(self.hardware):
                LOG.error("torque may still be on: %s", problem)
            raise

    def take_over(self, component: Component, state: JointState, joints: Collection[str] | None = None) -> None:
        """Set the last command of an activated component to its measured positions.

        A position slightly outside the limits also becomes the last command. The safety gate then slowly returns the
        joint to its limits, and its controller waits.

        Args:
            component: The component.
            state: Measurement of this cycle.
            joints: Names of the joints to take over. The other joints keep their last command. If None, take over all
                joints.

        Raises:
            ActivationError: A joint's position is unknown, unconfirmed, or far outside its limits.
        """
        own, first = component.commands, component.joints.start
        limits, held = self.limits[own], self._is_position[own]
        names = joints_of(self.hardware.command_interfaces[own])
        taken = np.array([joints is None or name in joints for name in names], dtype=bool)
        measured = confirmed_positions(
            replace(state, position=state.position[component.joints]),
            lambda: self.hardware.measure(component),
            names,
            [index - first for index in self._joint[own]],
            np.where(held & taken, self._velocity[own] * self.period_s, np.nan),
        )
        known = [i for i in range(len(names)) if taken[i] and np.isfinite(measured[i])]
        problems = {names[i]: problem for i in known if (problem := far_outside(float(measured[i]), limits[i]))}
        if problems:
            stands = "; ".join(f"{name} {problem}" for name, problem in problems.items())
            raise ActivationError(
                f"not activated: {stands}. Move the joint by hand, or correct its limits, zero or initial value"
            )
        command = self.command.copy()
        command[own] = np.where(taken, np.where(held, measured, 0.0), command[own])
        self.previous_command = self.previous_command.copy()
        self.previous_command[own] = command[own]
        self.command = command
        self.manager.stops.begin_return(range(own.start, own.stop), command)

    def _resume(self, controllers: Sequence[str], state: JointState) -> None:
        """Reactivate controllers that a transition has deactivated."""
        if controllers:
            self.manager.activate_each(controllers, state, self.within_limits)

    @property
    def within_limits(self) -> FloatArray:
        """Last command, of shape (m,), with positions clipped to the limits. Controllers start from this command."""
        return np.where(self._is_position, np.clip(self.command, self._lower, self._upper), self.command)

    def step(self) -> JointState:
        """Run one cycle and return the joint state measured in this cycle."""
        transitions = self.component_transitions
        if self.requests.inbox:
            self.requests.serve()
        if transitions.asked or transitions.returned:
            transitions.begin_cycle()
        begin_s = self.clock.now()
        state = self.hardware.read(self._read_deadline_s(begin_s))
        read_s = self.clock.now()
        self.figures.last_read_s = read_s - begin_s
        if state.faults or self.figures.unmeasured_in_a_row:
            self.figures.count_unmeasured(state, self.hardware)
        else:
            self._fastest_read_s = min(self._fastest_read_s, self.figures.last_read_s)
        if self._drives_speeds:
            self._measured = state.position[self._joint]
        if transitions.arrived or self.hardware.failures:
            transitions.after_read(state)
        # The cycle uses the measurement time, because controllers compare their commands with the measurement.
        wanted = self.manager.cycle.update(state, self.command, state.stamp_s, self.period_s)
        self.send(wanted)
        if transitions.leaving or self.hardware.failures:
            transitions.end_cycle()
        self._show(state)
        self._after_read_s = max(self.clock.now() - read_s, REMEMBERED * self._after_read_s)
        return state

    def _read_deadline_s(self, now_s: float) -> float:
        """Return the deadline until which the read may wait. The rest of the cycle is reserved for the other steps.

        A late cycle has less time available, but may still take half a period. The next cycle may then also be late.
        """
        period_s = self.period_s
        end_s = now_s + period_s if self._due_s is None else max(self._due_s + period_s, now_s + 0.5 * period_s)
        reserved_s = min(self._after_read_s + RESERVE_MARGIN * period_s, 0.5 * period_s)
        return max(end_s - reserved_s, now_s + min(READ_AT_LEAST * self._fastest_read_s, period_s))

    def _show(self, state: JointState) -> None:
        """Call ``on_cycle``. An error in the callback must not end the cycle."""
        try:
            self.on_cycle(state)
        except Exception:
            if not self.figures.observer_errors:
                LOG.exception("the on_cycle callback failed; the loop continues")
            self.figures.observer_errors += 1

    def send(self, wanted: FloatArray) -> None:
        """Send a command of shape (m,) through the safety gate. Commands reach the hardware only through this
        method."""
        gated = self._gate.limit(wanted, self.command, self.period_s, self._measured)
        self._log_gate(gated.reasons)
        # The command of a joint that has never been measured or commanded is still NaN. Components skip NaN.
        self.previous_command, self.command = self.command, gated.values
        self.manager.cycle.sent(self.command, self.previous_command)
        self.hardware.write(gated.values, self.period_s)

    def run(self, stop: Callable[[], bool]) -> None:
        """Run cycles at the fixed rate.

        Args:
            stop: Function that is called before each cycle. The loop ends when this function returns True.
        """
        due_s, computing_s = self.clock.now(), computing_time(self.clock)
        while not stop():
            self.clock.sleep_until(due_s)
            woke_s, self._due_s, began_s = self.clock.now(), due_s, computing_s()
            self.step()
            computed_s = computing_s() - began_s
            due_s = self.figures.count_cycle(due_s, woke_s, self.clock.now(), self.period_s, computed_s)

    def _log_gate(self, reasons: dict[int, str]) -> None:
        """Log each change by the gate once, instead of in every cycle in which the change continues."""
        if new := sorted(reasons.keys() - self._gated.keys()):
            log_gate({self.hardware.command_interfaces[index]: reasons[index] for index in new})
        self._gated = reasons
