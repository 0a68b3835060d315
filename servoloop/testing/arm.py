"""Virtual arm for tests: the whole stack in simulated time, running in the test's thread and without ROS."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from controller.interface import ControllerType
from controller.manager.plugins import controller_types
from controller.manager.switch import SwitchRequest
from controller.trajectory.goal import GoalHandle, GoalPoint, TrajectoryGoal
from hal.types import JointState
from servoloop.api.checks import number_of
from servoloop.campaign.invariants import Invariant, Violation
from servoloop.campaign.run import end_program
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.simulation.stack_faults import GOAL_ATTRIBUTES, Upsettable
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.shipped_files import OWN
from servoloop.testing.arm_test_error import ArmTestError
from servoloop.testing.invariants import ChosenInvariants
from sim_backend.buses.build import Build
from sim_backend.faults.draw import draw
from sim_backend.faults.event import Event
from sim_backend.faults.script import script_text
from sim_backend.faults.text import parse

__all__ = ["ArmTestError", "VirtualArm"]


class VirtualArm:
    """Virtual arm with its servos and the controllers of its controllers file. ``up`` activates the arm."""

    def __init__(
        self,
        files: Mapping[str, Any],
        seed: int | None = None,
        backlash_deg: float = 1.0,
        also: tuple[type[Invariant], ...] = (),
        without: tuple[str, ...] = (),
        examined: tuple[str, ...] = (),
    ) -> None:
        """Build an inactive arm.

        Args:
            files: Values of the options arm, urdf, robot and controllers of ``servoloop up``.
            seed: Seed for random variations of the arm and for random faults; None to use the nominal arm.
            backlash_deg: Backlash of each servo, in degrees.
            also: Additional invariants.
            without: Names of invariants to omit.
            examined: Names of invariants whose condition must occur in the test.

        Raises:
            ArmTestError: An invariant is unknown, or it is in both ``without`` and ``examined``.
        """
        paths = {name: Path(path) for name, path in files.items() if name != "arm"}
        self.stack = FaultyStack(
            files=read_arm_files(
                find_arm(files.get("arm", OWN)), paths.get("urdf"), paths.get("controllers"), paths.get("robot")
            ),
            build=Build(backlash_deg, seed),
            keep_alive=True,
        )
        self.seed = seed
        self.state: JointState | None = None
        """Joint state of the last cycle."""
        self._faults: list[Event] = []
        self._begun = False
        """Whether ``up`` has been called and the arm has not been shut down yet."""
        self._up = False
        self._up_s = 0.0
        """Simulated time at which the arm became active, in seconds."""
        self.stack.on_state = self._on_state
        self._chosen = ChosenInvariants(also, without, examined)
        self._watch = self._chosen.watch(self.stack)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of all joints with servos."""
        return self.stack.loop.hardware.joints

    @property
    def time_s(self) -> float:
        """Simulated time, in seconds."""
        return self.stack.clock.now()

    @property
    def violations(self) -> tuple[Violation, ...]:
        """First violation of each violated invariant so far."""
        return tuple(self._watch.violations.values())

    @property
    def examined(self) -> dict[str, int]:
        """How many times each invariant has examined its condition so far, keyed by invariant name."""
        return self._watch.examined

    @property
    def positions(self) -> dict[str, float]:
        """Measured positions in rad or m, keyed by joint name."""
        if self.state is None:
            raise ArmTestError("the arm has no measurement yet: call virtual_arm.up() first")
        return dict(zip(self.joints, self.state.position.tolist(), strict=True))

    def up(self) -> "VirtualArm":
        """Activate the hardware and the controllers. The times of planned faults are relative to this call.

        Raises:
            DriverError, HalError: A fault prevents the activation.
        """
        self.stack.player.plan(self._faults)
        self._begun = True
        self.stack.up()
        self._up, self._up_s = True, self.stack.world.time_s
        self.run(self.stack.loop.period_s)
        return self

    def load_controller(self, name: str, kind: "ControllerType | str", **parameters: Any) -> Any:
        """Load a controller without activating it.

        Args:
            name: Name of the controller.
            kind: Your controller class, or the type name of an installed controller.
            **parameters: Parameters of the controller.

        Returns:
            The controller.

        Raises:
            ArmTestError: The type name is unknown.
            ValueError: The parameters are invalid.
        """
        type_ = _controller_type(kind) if isinstance(kind, str) else kind
        built = type_.build(name, type_.parameters_type(**parameters), self.stack.control_stack.context)
        self.stack.add_controller(built)
        return built

    def switch_controllers(self, activate: Sequence[str] = (), deactivate: Sequence[str] = ()) -> None:
        """Switch controllers between two cycles. Raises SwitchError with the reason if the controller switch is
        rejected."""
        loop = self.stack.loop
        loop.manager.switch(SwitchRequest(activate=tuple(activate), deactivate=tuple(deactivate)), loop.within_limits)

    def send_goal(
        self, positions: Mapping[str, float], seconds: float = 2.0, controller: str | None = None
    ) -> GoalHandle:
        """Send a goal with a single point. Joints for which no position is given hold their measured position.

        Args:
            positions: Target positions in rad or m, keyed by joint name.
            seconds: Time from the start of the goal until the joints reach the target, in seconds.
            controller: Name of a controller that accepts goals; None to use the arm's joint trajectory controller.

        Returns:
            Handle of the goal.

        Raises:
            ArmTestError: The controller is unknown, does not accept goals, or rejected this goal.
        """
        here, target = self.positions, self._goal_controller(controller)
        if unknown := [name for name in positions if name not in target.joints]:
            raise ArmTestError(f"{target.name} has no joint {unknown[0]!r}: choose from {', '.join(target.joints)}")
        point = GoalPoint(tuple(positions.get(name, here[name]) for name in target.joints), seconds)
        goal = TrajectoryGoal(tuple(target.joints), (point,))
        if reason := target.check(goal):
            raise ArmTestError(f"{target.name} rejects the goal: {reason}")
        handle: GoalHandle = target.submit(goal)
        return handle

    def cancel(self, goal: GoalHandle) -> None:
        """Request the cancellation of a goal. Raises ArmTestError if the goal was not sent by ``send_goal``."""
        for logged in self.stack.goals.goals:
            if logged.handle is goal:
                self.stack.controllers[logged.controller].cancel(goal)
                return
        raise ArmTestError("the goal to cancel is unknown: pass the handle returned by virtual_arm.send_goal")

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Run cycles for ``seconds`` seconds, or until ``until`` returns true. Raises ArmTestError if the time is not
        valid."""
        self._require_up()
        number = number_of(seconds)
        if number is None or not number >= 0.0:
            raise ArmTestError(f"the time to run must be at least 0 s, not {seconds!r}: pass a number of seconds")
        self.stack.run(seconds, until)

    def plan(self, *faults: str) -> None:
        """Plan faults. Call this method before ``up``.

        The time of each fault is relative to ``up``, to the start of the program or to its end.

        Raises:
            ArmTestError: ``up`` has already been called.
        """
        self._require_not_begun("plan")
        self._faults += map(parse, faults)

    def draw(self, count: int = 3, within_s: float = 5.0, kinds: Iterable[str] | None = None) -> None:
        """Plan random faults drawn from the arm's seed, as ``servoloop campaign`` does.

        No fault occurs during the activation. Call this method before ``up``.

        Raises:
            ArmTestError: ``up`` has already been called.
        """
        self._require_not_begun("draw")
        there = replace(self.stack.player.targets.inventory, start_s=None)
        self._faults += draw(self.seed or 0, there, within_s, count, None if kinds is None else tuple(kinds))

    def fault(self, text: str) -> None:
        """Inject a fault now, or after the delay given by its ``at``."""
        self._require_up()
        event, now_s = parse(text), self.stack.world.time_s
        self.stack.player.play([event], now_s)
        if event.since == "up":
            event = event.model_copy(update={"at_s": round(event.at_s + now_s - self._up_s, 3)})
        self._faults.append(event)

    def end(self) -> str:
        """Shut the arm down as ``servoloop up`` does. Later calls have no effect on the arm.

        Returns:
            Report that lists the violations, a controller that has failed, the required invariants whose condition
            never occurred, and the faults. The report is empty if there are no problems.
        """
        if self._begun:
            self._begun = self._up = False
            end_program(self.stack)
            self._watch.end()
        violated = [f"{one.invariant}: {one.text} (at {one.time_s:.3f} s)" for one in self.violations]
        lines = [*violated, *self._chosen.crash(self.stack), *self._chosen.idle(self.examined)]
        if lines and self._faults:
            lines.append(f"faults:\n{script_text(self._faults).rstrip()}")
        return "\n".join(lines)

    def _require_not_begun(self, method: str) -> None:
        if self._begun:
            raise ArmTestError(
                f"virtual_arm.{method}() has no effect after up(): call it before, or call virtual_arm.fault()"
            )

    def _require_up(self) -> None:
        if not self._up:
            raise ArmTestError("the arm is not active: call virtual_arm.up() first")

    def _goal_controller(self, name: str | None) -> Upsettable:
        controllers = self.stack.controllers
        controller = controllers.get(self.stack.arm.name if name is None else name)
        if controller is None:
            raise ArmTestError(f"there is no controller {name!r}: choose one of {', '.join(controllers)}")
        if not controller.takes_goals:
            needed = f"{', '.join(GOAL_ATTRIBUTES[:-1])} and {GOAL_ATTRIBUTES[-1]}"
            raise ArmTestError(f"{name} does not accept goals: a controller that accepts goals has {needed}")
        return controller

    def _on_state(self, state: JointState) -> None:
        self.state = state


def _controller_type(name: str) -> ControllerType:
    types = controller_types()
    if name not in types:
        raise ArmTestError(f"there is no controller type {name!r}: choose one of {', '.join(types)}")
    return types[name]
