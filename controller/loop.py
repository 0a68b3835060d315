"""The fixed-rate loop: read → controllers → safety gate → write."""

import logging
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np

from controller.changes import Aside, Changes, at_once
from controller.manager import ControllerManager
from controller.requests import Requests
from drivers.clock import Clock
from hal.components import Components
from hal.errors import ActivationError
from hal.gate import SafetyGate
from hal.lifecycle import Hardware
from hal.member import Member
from hal.types import FloatArray, JointLimits, JointState

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
    """One thread owns it. ``step`` runs one cycle and is what tests call; ``run`` only paces it.

    ``stay``: go on when the last component is lost, and wait for somebody to activate it again.
    """

    def __init__(
        self,
        hardware: Hardware | Components,
        manager: ControllerManager,
        limits: Mapping[str, JointLimits],
        clock: Clock,
        period_s: float,
        on_cycle: Callable[[JointState], None] = lambda state: None,
        *,
        stay: bool = False,
        aside: Aside = at_once,
    ) -> None:
        self.hardware = hardware if isinstance(hardware, Components) else Components([hardware], clock)
        self.manager = manager
        self.clock = clock
        self.period_s = period_s
        self.figures = LoopFigures()
        self.requests = Requests()
        split = [name.rpartition("/") for name in self.hardware.command_interfaces]
        self.limits = tuple(limits[joint] for joint, _, _ in split)
        """Of each command interface's joint."""
        self.kinds = tuple(kind for _, _, kind in split)
        """position, velocity or effort, of each command interface."""
        self._joint = [self.hardware.joints.index(joint) for joint, _, _ in split]
        self._is_position = np.array([kind == "position" for kind in self.kinds], dtype=bool)
        self.command: FloatArray = np.where(self._is_position, np.nan, 0.0)
        self.previous_command = self.command
        self._lower = np.array([limit.lower for limit in self.limits])
        self._upper = np.array([limit.upper for limit in self.limits])
        self._gate = SafetyGate(self.limits, self.kinds)
        self._gated: dict[int, str] = {}
        self._drives_speeds = "velocity" in self.kinds
        self._measured: FloatArray | None = None
        """Of each command interface's joint, where the gate needs it."""
        self.on_cycle = on_cycle
        manager.coasting.limits = limits
        self.changes = Changes(self, stay, aside)
        manager.hardware_ready = self.hardware.ready
        manager.hardware_measured = self.hardware.measured

    def activate(self, keep_inactive: Collection[str] = ()) -> None:
        """Hardware on where it stands, but for the components named; then the controllers. Raises what those raise."""
        self.hardware.activate(keep_inactive, self.changes.stay)
        try:
            state = self.hardware.read()
            for member in self.hardware.members:
                if member.active:
                    self.take_over(member, state)
            self.manager.activate(state, self.command)
        except BaseException:
            self.hardware.deactivate(relax=True)
            raise

    def take_over(self, member: Member, state: JointState) -> None:
        """A component has been activated: its command is where it stands. Raises ActivationError if that is unknown."""
        own = member.commands
        measured = state.position[self._joint[own]]
        held = self._is_position[own]
        if unknown := [self.hardware.command_interfaces[own][i] for i in np.flatnonzero(held & ~np.isfinite(measured))]:
            names = ", ".join(name.rpartition("/")[0] for name in unknown)
            raise ActivationError(f"{names} has not been measured, torque is off again: try once more")
        command = self.command.copy()
        command[own] = np.where(held, np.clip(measured, self._lower[own], self._upper[own]), 0.0)
        self.previous_command = self.previous_command.copy()
        self.previous_command[own] = command[own]
        self.command = command

    def step(self) -> JointState:
        """One cycle."""
        self.requests.serve()
        self.changes.begin_cycle()
        state = self.hardware.read()
        if self._drives_speeds:
            self._measured = state.position[self._joint]
        self.changes.after_read(state)
        # The time of the measurement is the cycle's time: what is compared with it must be as old.
        wanted = self.manager.update(state, self.command, state.stamp_s, self.period_s)
        self.send(wanted)
        self.changes.end_cycle()
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
        """The only way to the hardware: through the gate. ``wanted`` has shape (m,)."""
        gated = self._gate.limit(wanted, self.command, self.period_s, self._measured)
        self._tell(gated.reasons)
        # What was never measured or commanded is NaN still, and the components leave that out.
        self.previous_command, self.command = self.command, gated.values
        self.manager.sent(gated.values)
        self.hardware.write(gated.values, self.period_s)

    def run(self, stop: Callable[[], bool]) -> None:
        """Cycles at the fixed rate until ``stop`` says so."""
        due_s = self.clock.now()
        while not stop():
            self.clock.sleep_until(due_s)
            woke_s = self.clock.now()
            self.step()
            due_s = self._account(due_s, woke_s)

    def _account(self, due_s: float, woke_s: float) -> float:
        """Book the cycle that was due at ``due_s``; returns when the next one is due.

        This is upstream's ``overruns.manage: true``, and there is no other way here: what was due meanwhile is
        skipped with a warning, never made up for in a burst.
        """
        figures = self.figures
        late_s = woke_s - due_s
        busy_s = self.clock.now() - woke_s
        figures.cycles += 1
        figures.latest_wake_up_s = max(figures.latest_wake_up_s, late_s)
        figures.longest_cycle_s = max(figures.longest_cycle_s, busy_s)
        figures.busy_s += busy_s
        missed = int((late_s + busy_s) / self.period_s)
        if missed:
            figures.missed += missed
            LOG.warning("missed %d cycles: the loop was %.0f ms late", missed, late_s * 1e3)
        return due_s + (1 + missed) * self.period_s

    def _tell(self, reasons: dict[int, str]) -> None:
        """Say once what the gate changes, not in every cycle of an episode."""
        for index in reasons.keys() - self._gated.keys():
            name = self.hardware.command_interfaces[index].removesuffix("/position")
            LOG.info("safety gate: %s: %s", name, reasons[index])
        self._gated = reasons
