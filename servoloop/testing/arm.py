"""A virtual arm for tests: the whole stack on simulated time in the test's own thread, no ROS, no waiting."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from controller.interface import ControllerType
from controller.manager.plugins import controller_types
from controller.manager.switch import SwitchRequest
from controller.trajectory.goal import GoalHandle, GoalPoint, TrajectoryGoal
from drivers.errors import DriverError
from hal.types import JointState
from servoloop.campaign.invariants import ALL, Invariant, Violation, Watch
from servoloop.campaign.run import end_program
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.stack.arm_folders import OWN, find_arm, read_arm_files
from sim_backend.buses.build import Build
from sim_backend.faults.draw import draw
from sim_backend.faults.event import Event
from sim_backend.faults.script import script_text
from sim_backend.faults.text import parse


class ArmTestError(DriverError):
    """A test that asks for what this arm cannot do; the text says what to mend."""


class VirtualArm:
    """A virtual arm: its servos, the controllers of its controllers file, and what you add. ``up`` switches it on."""

    def __init__(
        self,
        files: Mapping[str, Any],
        seed: int | None = None,
        backlash_deg: float = 1.0,
        also: tuple[type[Invariant], ...] = (),
        without: tuple[str, ...] = (),
    ) -> None:
        """``files``: arm, urdf, robot, controllers, as for ``servoloop up``; ``also``, ``without``: invariants."""
        paths = {name: Path(path) for name, path in files.items() if name != "arm"}
        self.stack = FaultyStack(
            files=read_arm_files(find_arm(files.get("arm", OWN)), **paths),
            build=Build(backlash_deg, seed),
            keep_alive=True,
        )
        self.seed = seed
        self.state: JointState | None = None
        """The last cycle's measurement."""
        self._faults: list[Event] = []
        self._up = False
        self.stack.on_state = self._on_state
        names = [kind.name for kind in ALL]
        if unknown := [name for name in without if name not in names]:
            raise ArmTestError(f"there is no invariant {unknown[0]!r}: known are {', '.join(names)}")
        self._watch = Watch(self.stack, (*(kind for kind in ALL if kind.name not in without), *also))

    @property
    def joints(self) -> tuple[str, ...]:
        """The names of all joints with servos."""
        return self.stack.loop.hardware.joints

    @property
    def time_s(self) -> float:
        """Simulated time."""
        return self.stack.clock.now()

    @property
    def violations(self) -> tuple[Violation, ...]:
        """The invariants that have fallen so far, each for the first time."""
        return tuple(self._watch.violations.values())

    @property
    def positions(self) -> dict[str, float]:
        """The measured positions, rad or m, by joint."""
        if self.state is None:
            raise ArmTestError("nothing is measured yet: call virtual_arm.up() first")
        return dict(zip(self.joints, self.state.position.tolist(), strict=True))

    def up(self) -> "VirtualArm":
        """Configure and activate the hardware, then the controllers; the planned faults begin to count.

        Raises DriverError or HalError where a fault keeps the arm from coming up.
        """
        self.stack.player.plan(self._faults)
        self.stack.up()
        self._up = True
        self.run(self.stack.loop.period_s)
        return self

    def load_controller(self, name: str, kind: "ControllerType | str", **parameters: Any) -> Any:
        """Load a controller, inactive: your class, or the type of an installed one. Returns it.

        ValueError (pydantic's too) where the parameters do not fit.
        """
        type_ = controller_types()[kind] if isinstance(kind, str) else kind
        built = type_.build(name, type_.parameters_type(**parameters), self.stack.control_stack.context)
        self.stack.add_controller(built)
        return built

    def switch_controllers(self, activate: Sequence[str] = (), deactivate: Sequence[str] = ()) -> None:
        """Switch controllers between two cycles. Raises SwitchError, whose text says why not."""
        loop = self.stack.loop
        loop.manager.switch(SwitchRequest(activate=tuple(activate), deactivate=tuple(deactivate)), loop.within_limits)

    def send_goal(self, positions: Mapping[str, float], seconds: float = 2.0) -> GoalHandle:
        """Send a goal to the arm's joint trajectory controller; joints that are not named stay where they are.

        Raises ArmTestError where the controller refuses it.
        """
        controller, here = self.stack.arm, self.positions
        if unknown := [name for name in positions if name not in controller.joints]:
            raise ArmTestError(f"{controller.name} has no joint {unknown[0]!r}: {', '.join(controller.joints)}")
        point = GoalPoint(tuple(positions.get(name, here[name]) for name in controller.joints), seconds)
        goal = TrajectoryGoal(controller.joints, (point,))
        if reason := controller.check(goal):
            raise ArmTestError(f"{controller.name} refuses the goal: {reason}")
        return controller.submit(goal)

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Let cycles pass for so long, or until ``until()``."""
        if not self._up:
            raise ArmTestError("the arm is not up: call virtual_arm.up() first")
        self.stack.run(seconds, until)

    def plan(self, *faults: str) -> None:
        """Have faults happen at their times since ``up``, or since the start or the end; later ones with ``fault``."""
        self._faults += map(parse, faults)

    def draw(self, count: int = 3, within_s: float = 5.0, kinds: Iterable[str] | None = None) -> None:
        """Draw faults from the arm's seed as ``servoloop campaign`` does, except at the start: the arm must come up."""
        there = replace(self.stack.player.targets.inventory, start_s=None)
        self._faults += draw(self.seed or 0, there, within_s, count, None if kinds is None else tuple(kinds))

    def fault(self, text: str) -> None:
        """Have a fault happen now, or ``at`` so many seconds from now."""
        self._faults.append(event := parse(text))
        self.stack.player.play([event], self.stack.world.time_s)

    def end(self) -> str:
        """End the program as ``servoloop up`` does, once; returns what fell on the way, empty where all held."""
        if self._up:
            self._up = False
            end_program(self.stack)
            self._watch.end()
        if not self.violations:
            return ""
        fallen = [f"{one.invariant}: {one.text} (at {one.time_s:.3f} s)" for one in self.violations]
        faults = f"\nfaults:\n{script_text(self._faults)}" if self._faults else ""
        return "\n".join(fallen) + faults.rstrip()

    def _on_state(self, state: JointState) -> None:
        self.state = state
