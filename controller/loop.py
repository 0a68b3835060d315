"""The fixed-rate loop: read → controllers → safety gate → write."""

import logging
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from controller.component_transitions import BackgroundWorker, ComponentTransitions, run_at_once
from controller.gate_log import log_gate
from controller.loop_figures import LoopFigures
from controller.manager.manager import ControllerManager
from controller.manager.requests import Requests
from drivers.clock import Clock
from hal.components.component import Component
from hal.components.component_lifecycle import activate_all, undo_all
from hal.components.component_set import ComponentSet
from hal.confirm import confirmed_positions
from hal.errors import ActivationError
from hal.gate import SafetyGate
from hal.types import FloatArray, JointLimits, JointState, far_outside

LOG = logging.getLogger("servoloop.controller")

REMEMBERED: Final = 0.95
"""The share of the longest time behind the reading that is left after one more cycle."""
LEAST_RESERVE: Final = 0.1
"""The share of the period that reading leaves to the other steps, however short they have been."""


class ControlLoop:
    """One thread owns the loop. ``step`` runs one cycle and is what tests call; ``run`` only paces it.

    ``keep_alive``: the loop goes on when the last component is lost, and waits for a client to activate it again.
    """

    def __init__(
        self,
        hardware: ComponentSet,
        manager: ControllerManager,
        limits: Mapping[str, JointLimits],
        clock: Clock,
        period_s: float,
        on_cycle: Callable[[JointState], None] = lambda state: None,
        *,
        keep_alive: bool = False,
        background_worker: BackgroundWorker = run_at_once,
    ) -> None:
        self.hardware = hardware
        hardware.filter_leaps(limits)
        self.manager = manager
        self.clock = clock
        self.period_s = period_s
        self.figures = LoopFigures()
        self.requests = Requests()
        split = [name.rpartition("/") for name in self.hardware.command_interfaces]
        self.limits = tuple(limits[joint] for joint, _, _ in split)
        """The limits of each command interface's joint."""
        self.kinds = tuple(kind for _, _, kind in split)
        """The kind of each command interface: position, velocity or effort."""
        self._joint = [self.hardware.joints.index(joint) for joint, _, _ in split]
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
        """The position of each command interface's joint, where the gate needs it."""
        self._due_s: float | None = None
        """When the cycle was to begin, where ``run`` paces it."""
        self._after_read_s = 0.0
        """How long the steps behind the reading have taken of late."""
        self.on_cycle = on_cycle
        self._keep_alive = keep_alive
        self.component_transitions = ComponentTransitions(
            hardware, manager, self.take_over, self._resume, keep_alive, background_worker
        )

    def activate(self, keep_inactive: Collection[str] = (), keep_alive: bool | None = None) -> None:
        """Activate the hardware where it stands, except the components named; then the controllers. Raises errors.

        ``keep_alive``: whether a component that cannot be activated stays inactive, instead; None: as the loop's own.
        """
        try:
            activate_all(self.hardware, keep_inactive, self._keep_alive if keep_alive is None else keep_alive)
            state = self.hardware.read()
            for component in self.hardware.components:
                if component.active:
                    self.take_over(component, state)
            self.manager.activate(state, self.within_limits)
        except BaseException:
            for problem in undo_all(self.hardware):
                LOG.error("torque may still be on: %s", problem)
            raise

    def take_over(self, component: Component, state: JointState, joints: Collection[str] | None = None) -> None:
        """Command an activated component to be where it stands.

        A position slightly outside the limits stays the last command: the safety gate returns from there slowly.
        ``joints``: these alone; the others keep their last command.

        Raises:
            ActivationError: A joint's position is unknown, not confirmed, or far outside its limits.
        """
        own, first = component.commands, component.joints.start
        limits, held = self.limits[own], self._is_position[own]
        names = [name.rpartition("/")[0] for name in self.hardware.command_interfaces[own]]
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

    def _resume(self, controllers: Sequence[str], state: JointState) -> None:
        """Activate controllers again that a transition has ended."""
        if controllers:
            self.manager.activate_each(controllers, state, self.within_limits)

    @property
    def within_limits(self) -> FloatArray:
        """The last command with its positions within the limits, shape (m,): controllers begin from there."""
        return np.where(self._is_position, np.clip(self.command, self._lower, self._upper), self.command)

    def step(self) -> JointState:
        """Run one cycle."""
        transitions = self.component_transitions
        if self.requests.inbox:
            self.requests.serve()
        if transitions.asked or transitions.returned:
            transitions.begin_cycle()
        state = self.hardware.read(self._read_deadline_s())
        read_s = self.clock.now()
        if state.faults or self.figures.unmeasured_in_a_row:
            self.figures.look_for_measurements(state, self.hardware)
        if self._drives_speeds:
            self._measured = state.position[self._joint]
        if transitions.arrived or self.hardware.failures:
            transitions.after_read(state)
        # The time of the measurement is the cycle's time: what is compared with it must be as old.
        wanted = self.manager.cycle.update(state, self.command, state.stamp_s, self.period_s)
        self.send(wanted)
        if transitions.leaving or self.hardware.failures:
            transitions.end_cycle()
        self._show(state)
        self._after_read_s = max(self.clock.now() - read_s, REMEMBERED * self._after_read_s)
        return state

    def _read_deadline_s(self) -> float:
        """Until when to wait for the measurements: all that the cycle has left but what its other steps need.

        A cycle that woke late has less, yet never less than half a period: the next one is late then, too.
        """
        now_s, period_s = self.clock.now(), self.period_s
        end_s = now_s + period_s if self._due_s is None else max(self._due_s + period_s, now_s + 0.5 * period_s)
        return end_s - min(max(self._after_read_s, LEAST_RESERVE * period_s), 0.5 * period_s)

    def _show(self, state: JointState) -> None:
        """An observer that fails must not end the cycle."""
        try:
            self.on_cycle(state)
        except Exception:
            if not self.figures.observer_errors:
                LOG.exception("the observer of the cycle failed; the loop goes on")
            self.figures.observer_errors += 1

    def send(self, wanted: FloatArray) -> None:
        """Send a command to the hardware through the gate, the only way there. ``wanted`` has shape (m,)."""
        gated = self._gate.limit(wanted, self.command, self.period_s, self._measured)
        self._log_gate(gated.reasons)
        # What was never measured or commanded is NaN still, and the components leave that out.
        self.previous_command, self.command = self.command, gated.values
        self.manager.cycle.sent(self.command, self.previous_command)
        self.hardware.write(gated.values, self.period_s)

    def run(self, stop: Callable[[], bool]) -> None:
        """Run cycles at the fixed rate until ``stop`` says so."""
        due_s = self.clock.now()
        while not stop():
            self.clock.sleep_until(due_s)
            woke_s, self._due_s = self.clock.now(), due_s
            self.step()
            due_s = self.figures.count_cycle(due_s, woke_s, self.clock.now(), self.period_s)

    def _log_gate(self, reasons: dict[int, str]) -> None:
        """Log the gate's changes once, not in every cycle of an episode."""
        if new := sorted(reasons.keys() - self._gated.keys()):
            log_gate({self.hardware.command_interfaces[index]: reasons[index] for index in new})
        self._gated = reasons
