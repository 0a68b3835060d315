"""Implementation of ``servoloop up``: run the stack of one robot from start to end."""

import logging
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from time import time
from typing import TYPE_CHECKING, Final, Protocol

from drivers.clock import MonotonicClock, wall_offset_s
from drivers.driver_errors import DriverError
from nodes.ros_environment import INSTALL, RosError, RosMissing, require_ros
from servoloop.command_server.server import command_socket
from servoloop.recording.stack_recording import StackRecording
from servoloop.stack import hardware
from servoloop.stack.arm_options import BACKLASH_DEG
from servoloop.stack.background_worker import BackgroundWorker
from servoloop.stack.control_stack import ControlStack
from servoloop.stack.emulator_process import chosen_devices
from servoloop.stack.hardware import HardwareKind, HardwareSetup
from servoloop.stack.loop_thread import LEFT, LoopThread
from servoloop.stack.plan_process import planning_server
from servoloop.stack.processes import claim_realtime_priority, prompt_interpreter
from servoloop.stack.robot_files import Files, initial_states, servo_ids
from servoloop.stack.ros_interface import RosInterface, WithoutRos
from servoloop.stack.signals import Signals
from servoloop.up_options import NO_OPTIONS, UpOptions

if TYPE_CHECKING:
    from nodes.only_one import Search
    from nodes.stack import Stack
    from servoloop.simulation.real_clients import SimulatedTime

LOG = logging.getLogger("servoloop")
WORKS: Final = "Topics, services and actions are unavailable. Controllers, recordings, view and command socket work."


class Program(Protocol):
    """Source of a stack's commands: the controllers and the ROS interface."""

    def load_controllers(self, stack: ControlStack) -> None:
        """Load the controllers. Raises an error if a controller cannot be built."""
        ...

    def ros_interface(self, stack: "Stack") -> RosInterface:
        """Create the ROS interface. Raises RosError."""
        ...


@dataclass(frozen=True, slots=True)
class OwnControllers:
    """Controllers from the controllers file, with ros2_control's ROS interfaces."""

    search: "Search | None" = None
    """Running search for another controller manager, which was started before the hardware was opened."""

    def load_controllers(self, stack: ControlStack) -> None:
        """Load all controllers in the controllers file."""
        stack.load_controllers()

    def ros_interface(self, stack: "Stack") -> RosInterface:
        """Create the nodes of the controller manager, the components and the controllers.

        Raises:
            RosError: ROS does not start, or the search has found another controller manager.
        """
        from nodes.stack_nodes import StackNodes

        if self.search is not None:
            self.search.finish()
        return StackNodes(stack)


OWN_CONTROLLERS: Final = OwnControllers()


def up(
    kind: HardwareKind | None,
    ports: Mapping[str, str] | None,
    files: Files,
    ready: Callable[[str], None],
    options: UpOptions = NO_OPTIONS,
    program: Program = OWN_CONTROLLERS,
) -> int:
    """Run the stack until a signal arrives or a fault occurs.

    Args:
        kind: Hardware of all components. If None, each component uses its own ``<plugin>``.
        ports: Devices, keyed by bus name; None for virtual servos.
        files: Files of the robot.
        ready: Function called with the stack's name and rate when clients can use the stack.
        options: Other options.
        program: Source of the joint commands.

    Returns:
        Exit status.
    """
    simulated = _simulated_time(options)
    recording = StackRecording(options.record)
    if not options.spawn:
        files = replace(files, controllers=replace(files.controllers, controllers=()))
    if simulated is not None:
        setup = simulated.hardware(kind, ports, files, recording.tap)
        with Signals(LEFT) as signals:
            return _Up(setup, files, options, recording, program, simulated).run(signals, ready)
    with Signals(LEFT) as signals, chosen_devices(kind, ports, files, lambda: signals.count) as devices:
        setup = hardware.build(kind, files, devices, MonotonicClock(), tap=recording.tap)
        return _Up(setup, files, options, recording, program).run(signals, ready)


def _simulated_time(options: UpOptions) -> "SimulatedTime | None":
    """Return the simulated time used by virtual servos in this process, or None if the stack runs in real time."""
    if options.rtf is None and not options.step:
        return None
    from servoloop.simulation.pace import Pace, parse_factor
    from servoloop.simulation.real_clients import SimulatedTime
    from sim_backend.buses.build import Build

    pace = Pace(parse_factor("max" if options.rtf is None else options.rtf), paused=options.step)
    return SimulatedTime(pace, Build(BACKLASH_DEG))


class _Up:
    """One run of the stack, from configuring the hardware to the exit status."""

    def __init__(
        self,
        setup: HardwareSetup,
        files: Files,
        options: UpOptions,
        recording: StackRecording,
        program: Program,
        simulated: "SimulatedTime | None" = None,
    ) -> None:
        worker = simulated.worker if simulated else BackgroundWorker()
        clock = simulated.clock if simulated else MonotonicClock()
        self._initial = initial_states(files)
        self._options, self._recording, self._program, self._simulated = options, recording, program, simulated
        self._stack = ControlStack.build(setup, files, clock, worker, options.keep_alive)
        program.load_controllers(self._stack)
        self._must_end = False
        """Whether the stack was stopped because of an error in the ROS interface."""

    def run(self, signals: Signals, ready: Callable[[str], None]) -> int:
        """Configure the hardware, serve clients until the run ends, and return the exit status."""
        thread = LoopThread(self._stack, signals)
        with self._stack.configured(self._initial.unconfigured, self._options.keep_alive, thread.hangs):
            ros = self._has_ros()
            if self._simulated is None:  # in simulated time, no cycle is late, and the clients need the CPU
                claim_realtime_priority()
            ros_nodes = self._program.ros_interface(self._ros_stack()) if ros else WithoutRos()
            try:
                self._record_and_serve(thread, ros_nodes, ready)
            finally:
                ros_nodes.close()
        return 1 if thread.failed or self._must_end else 0

    def _has_ros(self) -> bool:
        """Return whether to serve clients over ROS. Log a warning if the stack runs without ROS.

        Raises:
            RosError: ROS is installed, but cannot be used.
            DriverError: An option needs ROS, but the stack runs without ROS.
        """
        try:
            if self._options.ros:
                require_ros()
                return True
            reason = "as --no-ros requests"
        except RosMissing:
            reason = f"because Python cannot find rclpy ({INSTALL})"
        if self._simulated is not None and self._simulated.pace.paused:
            raise DriverError(f"--step requires ROS, but the stack runs without ROS {reason}: use --rtf instead")
        LOG.warning("the stack runs without ROS %s. %s", reason, WORKS)
        return False

    def _planning(self) -> AbstractContextManager[None]:
        """Return a context in which the planning server runs, if the options request the planning server."""
        if not self._options.plan:
            return nullcontext()
        return planning_server(self._stack.files, sim_time=self._simulated is not None)

    def _ros_stack(self) -> "Stack":
        from nodes.stack import Stack

        stack, setup, files = self._stack, self._stack.setup, self._stack.files
        return Stack(
            stack.loop,
            files.description,
            files.component,
            servo_ids(files, setup.set_compensation),
            setup.scene,
            setup.set_compensation,
            stack.factory,
            stack.releases,
            self._options.publish_transforms,
            self._simulated.pace if self._simulated else None,
            files.namespace,
        )

    def _record_and_serve(self, thread: LoopThread, ros_nodes: RosInterface, ready: Callable[[str], None]) -> None:
        """Activate the hardware and serve clients until the loop ends. Publish all cycles; record them if requested."""
        stack, loop = self._stack, self._stack.loop
        loop.on_cycle = ros_nodes.post
        if self._simulated is not None:
            self._simulated.connect(loop, ros_nodes)
            thread.before_cycle = self._simulated.before_cycle
        offset_s = 0.0 if self._simulated else wall_offset_s(loop.clock, time)
        recorded = self._recording.of(loop, stack.files, offset_s, lambda: thread.failed, stack.setup.scene)
        with recorded, command_socket(stack, self._recording, lambda: thread.done):
            loop.activate(self._initial.inactive)
            with prompt_interpreter():
                self._serve_clients(thread, ros_nodes, ready)

    def _serve_clients(self, run: LoopThread, ros_nodes: RosInterface, ready: Callable[[str], None]) -> None:
        """Run the loop in its own thread and the ROS interface in this thread until the loop has ended or hangs."""
        loop = self._stack.loop
        thread = run.start()
        try:
            ready(f"{loop.hardware.name} at {1.0 / loop.period_s:g} Hz")
            with self._planning():
                ros_nodes.spin(lambda: run.done or run.hangs())
        except RosError as error:
            self._must_end = True
            LOG.error("the stack ends: %s", error)
        finally:
            run.signals.ask()  # also stop the loop if ROS fails
            while thread.is_alive() and not run.hangs():
                thread.join(0.1)
            if thread.is_alive():
                LOG.error("the control loop is blocked by its hardware and could not be stopped: %s", LEFT)
            if self._simulated is not None:
                self._simulated.pace.end()
                LOG.info("%s", self._simulated.pace.summary)
            ros_nodes.finish()
