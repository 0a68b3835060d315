"""Build, configure and shut down the hardware, controllers and control loop of a robot."""

import logging
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property

from controller.component_transitions import TransitionRules
from controller.interface import ControllerContext
from controller.loop import ControlLoop
from controller.manager.factory import Factory
from controller.manager.manager import ControllerManager
from controller.shutdown import shut_down
from drivers.clock import Clock
from hal.components.component_lifecycle import clean_up_all, configure_all
from servoloop.stack.background_worker import BackgroundWorker, SameThreadWorker
from servoloop.stack.hardware import HardwareSetup
from servoloop.stack.line_rate import check_rates
from servoloop.stack.robot_files import Files

LOG = logging.getLogger("servoloop")


@dataclass(frozen=True)
class ControlStack:
    """Hardware, controllers and control loop of one robot. Every program that moves an arm uses a ControlStack.

    A new stack is not configured. Within the ``configured`` context, ``loop.activate`` enables the arm. ``end`` shuts
    the arm down as its robot file specifies.
    """

    setup: HardwareSetup
    files: Files
    loop: ControlLoop
    worker: BackgroundWorker
    before_end: dict[str, Callable[[], None]] = field(default_factory=dict)
    """Actions that ``end`` performs first, keyed by name, such as returning joints to their usual controllers."""

    @classmethod
    def build(
        cls,
        setup: HardwareSetup,
        files: Files,
        clock: Clock,
        worker: BackgroundWorker | None = None,
        keep_alive: bool = False,
    ) -> "ControlStack":
        """Create a control loop for the hardware at the update rate of the controllers file, without any controllers.

        Args:
            setup: Hardware, not yet configured.
            files: Files of the robot.
            clock: Clock of the loop.
            worker: Worker for tasks that take longer than a cycle. By default, they run in the loop thread.
            keep_alive: Whether the loop continues when it loses a component.
        """
        worker = worker or SameThreadWorker()
        manager = ControllerManager(setup.hardware, files.limits, files.component.outputs)
        period_s = 1.0 / files.controllers.update_rate_hz
        rules = TransitionRules(keep_alive, worker)
        loop = ControlLoop(setup.hardware, manager, files.limits, clock, period_s, rules)
        return cls(setup, files, loop, worker)

    @cached_property
    def context(self) -> ControllerContext:
        """Properties of the robot that its controllers need."""
        files, settled = self.files, self.loop.manager.cycle.settled
        setup = self.setup
        return ControllerContext(
            files.description, files.component, files.limits, settled, setup.compliances, setup.outputs
        )

    @cached_property
    def factory(self) -> Factory:
        """Factory of the robot's controllers."""
        return Factory(self.files.controllers, self.context)

    def load_controllers(self) -> None:
        """Load all controllers of the controllers file. Raises an error if a controller cannot be built."""
        self.factory.fill(self.loop.manager)

    @property
    def releases(self) -> bool:
        """Whether the robot file requires that torque be disabled when the program exits."""
        return self.files.robot.file.on_exit.releases(self.setup.virtual)

    @contextmanager
    def configured(
        self,
        leave_out: Collection[str] = (),
        keep_alive: bool = False,
        hangs: Callable[[], bool] = lambda: False,
    ) -> Iterator[None]:
        """Open the ports and configure the hardware for the duration of the context.

        Args:
            leave_out: Names of the components that stay unconfigured.
            keep_alive: Whether to skip a component that cannot be configured.
            hangs: Function that returns whether a thread is still waiting for the hardware when the context exits. If
                it returns true, the hardware stays configured.

        Raises:
            DriverError: A port cannot be opened, a servo is missing, or a bus is too slow for the update rate.
            HalError: A component cannot be configured.
        """
        configure_all(self.loop.hardware, leave_out, keep_alive)
        try:
            check_rates(self.setup.buses, self.setup.rates_hz, self.files.robot, self.files.controllers.path)
            yield
        finally:
            if not hangs():
                clean_up_all(self.loop.hardware)

    def end(self, hurry: Callable[[], bool] = lambda: False, return_to: Mapping[str, float] | None = None) -> list[str]:
        """Stop the arm. Then the arm holds its position, or it parks and disables its torque, as the robot file
        requires.

        Args:
            hurry: Function that returns whether to skip the motion to the park pose.
            return_to: Pose to which the arm moves before its torque is disabled, instead of the park pose; in rad or m,
                keyed by joint name.

        Returns:
            One sentence for each failure during the shutdown.
        """
        for name, action in tuple(self.before_end.items()):
            try:
                action()
            except Exception:  # The arm must be stopped in any case.
                LOG.exception("internal error in %s before the end of the stack", name)
        park = self.files.robot.file.park
        pose, scale = (park.pose, park.velocity_scale) if park else (None, 1.0)
        if return_to is not None:
            pose, scale = dict(return_to), 1.0
        releases = self.releases or return_to is not None
        return shut_down(self.loop, releases, pose, scale, hurry=hurry, settle=self.worker.join)
