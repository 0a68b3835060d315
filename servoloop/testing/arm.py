"""A virtual arm for tests: the whole stack on simulated time in the test's own thread, no ROS, no waiting."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from controller.interface import ControllerType
from controller.manager.plugins import controller_types
from controller.manager.switch import SwitchRequest
from controller.trajectory.goal import GoalHandle, GoalPoint, TrajectoryGoal
from hal.types import JointState
from servoloop.campaign.invariants import Invariant, Violation
from servoloop.campaign.run import end_program
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.stack_faults import GOAL_ATTRIBUTES, Upsettable
from servoloop.stack.arm_folders import OWN, find_arm, read_arm_files
from servoloop.testing.errors import ArmTestError
from servoloop.testing.invariants import ChosenInvariants
from sim_backend.buses.build import Build
from sim_backend.faults.draw import draw
from sim_backend.faults.event import Event
from sim_backend.faults.script import script_text
from sim_backend.faults.text import parse

__all__ = ["ArmTestError", "VirtualArm"]


class VirtualArm:
    """A virtual arm: its servos, the controllers of its controllers file, and what you add. ``up`` switches it on."""

    def __init__(
        self,
        files: Mapping[str, Any],
        seed: int | None = None,
        backlash_deg: float = 1.0,
        also: tuple[type[Invariant], ...] = (),
        without: tuple[str, ...] = (),
        examined: tuple[str, ...] = (),
    ) -> None:
        """Build an arm that is not up yet.

        Args:
            files: arm, urdf, robot, controllers, as for ``servoloop up``.
            seed: the spread of the servos and of the drawn faults; None is the nominal arm.
            backlash_deg: backlash of each servo.
            also: invariants beside those of campaigns.
            without: names of invariants that do not watch.
            examined: names of invariants that must examine something until the end.

        Raises:
            ArmTestError: an invariant is unknown, or in both ``without`` and ``examined``.
        """
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
        self._up_s = 0.0
        """The world's time when the arm came up."""
        self.stack.on_state = self._on_state
        self._chosen = ChosenInvariants(also, without, examined)
        self._watch = self._chosen.watch(self.stack)

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
        """The first violation of each invariant so far."""
        return tuple(self._watch.violations.values())

    @property
    def examined(self) -> dict[str, int]:
        """How often each invariant has examined its condition so far, by name."""
        return self._watch.examined

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
        self._up, self._up_s = True, self.stack.world.time_s
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

    def send_goal(
        self, positions: Mapping[str, float], seconds: float = 2.0, controller: str | None = None
    ) -> GoalHandle:
        """Send a goal with one point; joints that are not named stay where they are.

        Args:
            positions: rad or m, by joint.
            seconds: time from the start of the goal to its point.
            controller: the name of a controller that takes goals; None is the arm's joint trajectory controller.

        Returns:
            The handle of the goal.

        Raises:
            ArmTestError: the controller is unknown, takes no goals, or refuses this one.
        """
        here, target = self.positions, self._goal_controller(controller)
        if unknown := [name for name in positions if name not in target.joints]:
            raise ArmTestError(f"{target.name} has no joint {unknown[0]!r}: {', '.join(target.joints)}")
        point = GoalPoint(tuple(positions.get(name, here[name]) for name in target.joints), seconds)
        goal = TrajectoryGoal(tuple(target.joints), (point,))
        if reason := target.check(goal):
            raise ArmTestError(f"{target.name} refuses the goal: {reason}")
        handle: GoalHandle = target.submit(goal)
        return handle

    def cancel(self, goal: GoalHandle) -> None:
        """Ask the goal's controller to cancel it. Raises ArmTestError if ``send_goal`` has not sent the goal."""
        for logged in self.stack.goals.goals:
            if logged.handle is goal:
                self.stack.controllers[logged.controller].cancel(goal)
                return
        raise ArmTestError("the goal to cancel was not sent by virtual_arm.send_goal: cancel what send_goal returned")

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Let cycles pass for so long, or until ``until()``."""
        self._require_up()
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
        self._require_up()
        event, now_s = parse(text), self.stack.world.time_s
        self.stack.player.play([event], now_s)
        if event.since == "up":
            event = event.model_copy(update={"at_s": round(event.at_s + now_s - self._up_s, 3)})
        self._faults.append(event)

    def end(self) -> str:
        """End the program as ``servoloop up`` does, once.

        Returns:
            The violations with the faults, and the invariants that examined nothing but should have; empty if there
            are none.
        """
        if self._up:
            self._up = False
            end_program(self.stack)
            self._watch.end()
        violated = [f"{one.invariant}: {one.text} (at {one.time_s:.3f} s)" for one in self.violations]
        lines = [*violated, *self._chosen.idle(self.examined)]
        if lines and self._faults:
            lines.append(f"faults:\n{script_text(self._faults).rstrip()}")
        return "\n".join(lines)

    def _require_up(self) -> None:
        if not self._up:
            raise ArmTestError("the arm is not up: call virtual_arm.up() first")

    def _goal_controller(self, name: str | None) -> Upsettable:
        controllers = self.stack.controllers
        controller = controllers.get(self.stack.arm.name if name is None else name)
        if controller is None:
            raise ArmTestError(f"there is no controller {name!r}: {', '.join(controllers)}")
        if not controller.takes_goals:
            needed = f"{', '.join(GOAL_ATTRIBUTES[:-1])} and {GOAL_ATTRIBUTES[-1]}"
            raise ArmTestError(f"{name} takes no goals: a controller that does has {needed}")
        return controller

    def _on_state(self, state: JointState) -> None:
        self.state = state
