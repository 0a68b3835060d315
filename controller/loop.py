"""The fixed-rate loop: read → controllers → safety gate → write."""

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from controller.manager import ControllerManager
from controller.requests import Requests
from drivers.clock import Clock
from hal.errors import ActivationError
from hal.gate import SafetyGate
from hal.lifecycle import Hardware, LifecycleState
from hal.types import FloatArray, JointCommand, JointLimits, JointState

LOG = logging.getLogger("servoloop.controller")


@dataclass(slots=True)
class LoopFigures:
    """How the loop keeps its time. A cycle is missed when its time passes before the last one has ended."""

    cycles: int = 0
    missed: int = 0
    latest_wake_up_s: float = 0.0
    longest_cycle_s: float = 0.0
    busy_s: float = 0.0
    onlooker_errors: int = 0


class ControlLoop:
    """One thread owns it. ``step`` runs one cycle and is what tests call; ``run`` only paces it."""

    def __init__(
        self,
        hardware: Hardware,
        manager: ControllerManager,
        limits: dict[str, JointLimits],
        clock: Clock,
        period_s: float,
        on_cycle: Callable[[JointState], None] = lambda state: None,
    ) -> None:
        self.hardware = hardware
        self.manager = manager
        self.clock = clock
        self.period_s = period_s
        self.figures = LoopFigures()
        self.requests = Requests()
        self.limits = tuple(limits[name] for name in hardware.joints)
        self.command: FloatArray = np.full(len(hardware.joints), np.nan)
        self.previous_command = self.command
        self._gate = SafetyGate(self.limits)
        self.on_cycle = on_cycle
        self._gated: dict[int, str] = {}

    def activate(self) -> None:
        """Hardware on where it stands, then the controllers. Raises what the hardware raises."""
        self.hardware.activate()
        try:
            self._take_over(self.hardware.read())
        except BaseException:
            self.hardware.deactivate(relax=True)
            raise

    def _take_over(self, state: JointState) -> None:
        known = np.isfinite(state.position)
        if not known.all():
            unknown = [name for name, is_known in zip(self.hardware.joints, known, strict=True) if not is_known]
            raise ActivationError(f"{', '.join(unknown)} has not been measured, torque is off again: try once more")
        lower = np.array([limit.lower for limit in self.limits])
        upper = np.array([limit.upper for limit in self.limits])
        self.command = np.clip(state.position, lower, upper)
        self.previous_command = self.command
        self.manager.activate(state, self.command)

    def step(self) -> JointState:
        """One cycle."""
        self.requests.serve()
        state = self.hardware.read()
        # The time of the measurement is the cycle's time: what is compared with it must be as old.
        wanted = self.manager.update(state, self.command, state.stamp_s, self.period_s)
        self.send(wanted)
        self._show(state)
        return state

    def _show(self, state: JointState) -> None:
        """Whoever looks on must not be able to end the cycle."""
        try:
            self.on_cycle(state)
        except Exception:
            if not self.figures.onlooker_errors:
                LOG.exception("the onlooker of the cycle failed; the loop goes on")
            self.figures.onlooker_errors += 1

    def send(self, wanted: FloatArray) -> None:
        """The only way to the hardware: through the gate. ``wanted`` has shape (n,)."""
        gated = self._gate.limit(wanted, self.command, self.period_s)
        self._tell(gated.reasons)
        if not np.isfinite(gated.position).all():
            return  # nothing was ever measured or commanded: there is no safe place to name
        self.previous_command, self.command = self.command, gated.position
        if self.hardware.state is LifecycleState.ACTIVE:
            self.hardware.write(JointCommand(gated.position, self.period_s))

    def run(self, stop: Callable[[], bool]) -> None:
        """Cycles at the fixed rate until ``stop`` says so."""
        due_s = self.clock.now()
        while not stop():
            self.clock.sleep_until(due_s)
            woke_s = self.clock.now()
            self.step()
            due_s = self._account(due_s, woke_s)

    def _account(self, due_s: float, woke_s: float) -> float:
        """Book the cycle that was due at ``due_s``; returns when the next one is due."""
        figures = self.figures
        late_s = woke_s - due_s
        busy_s = self.clock.now() - woke_s
        figures.cycles += 1
        figures.latest_wake_up_s = max(figures.latest_wake_up_s, late_s)
        figures.longest_cycle_s = max(figures.longest_cycle_s, busy_s)
        figures.busy_s += busy_s
        # What was due meanwhile is missed, not made up for in a burst.
        missed = int((late_s + busy_s) / self.period_s)
        if missed:
            figures.missed += missed
            LOG.warning("missed %d cycles: the loop was %.0f ms late", missed, late_s * 1e3)
        return due_s + (1 + missed) * self.period_s

    def _tell(self, reasons: dict[int, str]) -> None:
        """Say once what the gate changes, not in every cycle of an episode."""
        for index in reasons.keys() - self._gated.keys():
            LOG.info("safety gate: %s: %s", self.hardware.joints[index], reasons[index])
        self._gated = reasons
