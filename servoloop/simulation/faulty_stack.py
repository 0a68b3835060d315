"""Simulated stack with fault injection."""

from collections.abc import Mapping, Sequence
from typing import Any, cast

from controller.forward.forward_command_controller import ForwardCommandController
from controller.interface import Controller
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from drivers.bus.bus import Bus
from hal.types import JointState
from servoloop.simulation.clients import SimulatedClients
from servoloop.simulation.goal_log import GoalLog, LoggedGoal
from servoloop.simulation.program_log import ProgramLog
from servoloop.simulation.stack import SimulatedStack
from servoloop.simulation.stack_faults import StackFaults, Upsettable
from servoloop.simulation.touches import Touches
from sim_backend.buses.build import NOMINAL_BUILD, Build
from sim_backend.buses.port import VirtualAdapter
from sim_backend.faults.player import FaultPlayer
from sim_backend.faults.targets import FaultTargets


def number_of_arm(seed: int | None, arms: int) -> int:
    """Return the zero-based index of the arm that the simulated clients of a seed move."""
    return (seed or 0) % max(arms, 1)


class FaultyStack(SimulatedStack):
    """Simulated stack with a fault ``player``. Without faults, the stack behaves exactly as a SimulatedStack.

    ``options`` are the options of SimulatedStack. If a robot has several arms, ``arm`` and ``hand`` belong to the
    arm that the seed's clients move.
    """

    def __init__(self, **options: Any) -> None:
        self.controllers: dict[str, Upsettable] = {}
        """All controllers of the loop, keyed by name."""
        self._playing = False
        self.clients: SimulatedClients | None = None
        self.ending = False
        """Whether the program is shutting down."""
        self.end_problems: Sequence[str] = ()
        """Failures that the program reported while it was shutting down."""
        self.hurried = False
        """Whether a second signal has ended the program, so that the arm need not be in its park pose."""
        self.narrowed: Mapping[str, tuple[float, float]] = {}
        """Narrowed joint limits (lower, upper) from the schedule, in rad or m."""
        self.goals = GoalLog(lambda: self.clock.now())
        self.ended_goals: list[LoggedGoal] = []
        """Goals that finished in the latest cycle."""
        self.program_log = ProgramLog()
        """Messages that the programs on the command socket have received."""
        super().__init__(**options)
        self.arms = tuple(cast(JointTrajectoryController, self.controllers[one.name]) for one in self.arms)
        self.build: Build = options.get("build", NOMINAL_BUILD)
        """Build of the virtual servos and of the arm."""
        self.arm = self.arms[number_of_arm(self.build.seed, len(self.arms))]
        self.adapters = {
            name: VirtualAdapter(line, self.clock, self.ports[name].name) for name, line in self.lines.items()
        }
        self.stack_faults = StackFaults(self.clock, self.controllers, self.arm.name, self._client_dies)
        self.player = FaultPlayer(FaultTargets(self.lines, self.world, self.adapters, self.stack_faults))
        self.touches = Touches(self.files.robot.joints, self.player, self.clock)
        self._playing = True

    def controller(self, name: str) -> Controller | None:
        """Return the wrapper of the controller with this name, or None."""
        return cast(Controller | None, self.controllers.get(name))

    @property
    def hand(self) -> ForwardCommandController:
        hands = [one for one in self._built if isinstance(one, ForwardCommandController)]
        own = hands[self.arms.index(self.arm)] if len(hands) == len(self.arms) else super().hand
        return cast(ForwardCommandController, self.controllers[own.name])

    def wrapped(self, controller: Controller) -> Controller:
        """Return a wrapper of the controller that can be made to fail."""
        upsettable = Upsettable(controller, self.goals)
        self.controllers[controller.name] = upsettable
        return cast(Controller, upsettable)

    def up(self) -> "FaultyStack":
        """Configure and activate the hardware. Planned faults may already occur during the start."""
        self.player.reach("start", self.world.time_s)
        super().up()
        self.player.reach("up", self.world.time_s)
        return self

    def _client_dies(self) -> None:
        """Remove the client. After that, no client reacts to the stack until another client connects."""
        self.after_cycle = lambda: None
        if self.clients is not None:
            self.clients.die()

    def _open_bus(self, name: str) -> Bus:
        adapter = self.adapters[name]
        self.ports[name].port = adapter.open(adapter.name)
        return super()._open_bus(name)

    def _after_step(self, time_s: float) -> None:
        if self._playing:
            self.player.update(time_s)
        super()._after_step(time_s)

    def require_no_defect(self) -> None:
        """Raise RuntimeError if a controller has failed although no fault was injected into it."""
        for name, controller in self.controllers.items():
            if controller.defect is not None:
                raise RuntimeError(f"the controller {name} has failed") from controller.defect

    def _on_cycle(self, state: JointState) -> None:
        for line in self.lines.values():  # also advance servos that are not read
            line.advance(self.clock.now())
        self.touches.update()
        self.ended_goals = self.goals.end_cycle()
        super()._on_cycle(state)
        if self.clients is not None:
            self.clients.cycle(state)
