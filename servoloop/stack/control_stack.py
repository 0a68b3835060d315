"""A robot's control stack: hardware, controllers and control loop, built, opened and ended in one place."""

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

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


@dataclass(frozen=True)
class ControlStack:
    """Hardware, controllers and control loop of one robot, not yet configured. Every program that moves an arm has one.

    ``loop.activate`` brings the arm up once the stack is ``configured``; ``end`` leaves it as its robot file says.
    """

    setup: HardwareSetup
    files: Files
    loop: ControlLoop
    worker: BackgroundWorker

    @classmethod
    def build(
        cls,
        setup: HardwareSetup,
        files: Files,
        clock: Clock,
        worker: BackgroundWorker | None = None,
        keep_alive: bool = False,
    ) -> "ControlStack":
        """Put the hardware under a control loop, without controllers, at the rate of the controllers file.

        Args:
            setup: The hardware, unconfigured.
            files: The robot's files.
            clock: The clock of the loop.
            worker: Runs work that takes longer than a cycle; by default in the thread of the loop.
            keep_alive: Whether the loop goes on without components that are lost.
        """
        worker = worker or SameThreadWorker()
        manager = ControllerManager(setup.hardware, files.limits)
        period_s = 1.0 / files.controllers.update_rate_hz
        loop = ControlLoop(
            setup.hardware, manager, files.limits, clock, period_s, keep_alive=keep_alive, background_worker=worker
        )
        return cls(setup, files, loop, worker)

    @cached_property
    def context(self) -> ControllerContext:
        """The facts about the robot that its controllers are built with."""
        files, settled = self.files, self.loop.manager.cycle.settled
        return ControllerContext(files.description, files.component, files.limits, settled, self.setup.compliances)

    @cached_property
    def factory(self) -> Factory:
        """The factory of the robot's controllers."""
        return Factory(self.files.controllers, self.context)

    def load_controllers(self) -> None:
        """Load the controllers of the controllers file. Raises an error if one of them cannot be built."""
        self.factory.fill(self.loop.manager)

    @property
    def releases(self) -> bool:
        """Whether the robot file has the torque switched off at the end of the program."""
        return self.files.robot.file.on_exit.releases(self.setup.virtual)

    @contextmanager
    def configured(
        self,
        leave_out: Collection[str] = (),
        keep_alive: bool = False,
        hangs: Callable[[], bool] = lambda: False,
    ) -> Iterator[None]:
        """Open the ports and configure the hardware while the context lasts.

        Args:
            leave_out: Names of components that stay unconfigured.
            keep_alive: Whether a component that cannot be configured is left out.
            hangs: Whether a thread still waits for the hardware at the end: it is then left as it is.

        Raises:
            DriverError: A port cannot be opened, a servo is missing, or a line is too slow for the update rate.
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
        """Stop the arm and leave it as the robot file says: held, or parked and released.

        Args:
            hurry: Whether to skip the way to the park pose.
            return_to: A pose, rad or m by joint, in which the arm is released instead.

        Returns:
            What failed on the way, one sentence each.
        """
        park = self.files.robot.file.park
        pose, scale = (park.pose, park.velocity_scale) if park else (None, 1.0)
        if return_to is not None:
            pose, scale = dict(return_to), 1.0
        releases = self.releases or return_to is not None
        return shut_down(self.loop, releases, pose, scale, hurry=hurry, settle=self.worker.join)
