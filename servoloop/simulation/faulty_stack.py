"""A simulated stack to which faults of all kinds can happen."""

from typing import Any, cast

from controller.interface import Controller
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from drivers.bus.bus import Bus
from hal.types import JointState
from servoloop.simulation.stack import SimulatedStack
from servoloop.simulation.stack_faults import StackFaults, Upsettable
from sim_backend.faults.player import FaultPlayer
from sim_backend.faults.targets import Targets
from sim_backend.wire.port import VirtualAdapter


class FaultyStack(SimulatedStack):
    """A simulated stack with a ``player``; without faults it does the same to the byte. ``options``: as there."""

    def __init__(self, **options: Any) -> None:
        self.controllers: dict[str, Upsettable] = {}
        """All of them, by name, as the loop runs them."""

        def wrap(controller: Controller) -> Controller:
            upsettable = Upsettable(controller)
            self.controllers[controller.name] = upsettable
            return cast(Controller, upsettable)

        self._playing = False
        super().__init__(wrap=wrap, **options)
        self.arm = cast(JointTrajectoryController, self.controllers[self.arm.name])
        self.adapters = {
            name: VirtualAdapter(line, self.clock, self.ports[name].name) for name, line in self.lines.items()
        }
        self.stack_faults = StackFaults(self.clock, self.controllers, self.arm.name, self._client_dies)
        self.player = FaultPlayer(Targets(self.lines, self.world, self.adapters, self.stack_faults))
        self._playing = True

    def _client_dies(self) -> None:
        """Nobody reacts to what the stack does any more, until another client comes."""
        self.after_cycle = lambda: None

    def _open_buses(self) -> dict[str, Bus]:
        for name, adapter in self.adapters.items():
            self.ports[name].port = adapter.open(adapter.name)
        return super()._open_buses()

    def _after_step(self, time_s: float) -> None:
        if self._playing:
            self.player.update(time_s)
        super()._after_step(time_s)

    def _on_cycle(self, state: JointState) -> None:
        for line in self.lines.values():  # where nobody asks the servos the world goes on
            line.advance(self.clock.now())
        super()._on_cycle(state)
