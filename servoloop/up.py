"""Implementation of ``servoloop up``: run the stack of one robot from start to end."""

import gc
import logging
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import time
from typing import TYPE_CHECKING

from drivers.clock import MonotonicClock, wall_offset_s
from drivers.errors import DriverError
from nodes.ros_environment import require_ros
from servoloop.recording.stack_recording import StackRecording
from servoloop.stack import hardware
from servoloop.stack.background_worker import BackgroundWorker
from servoloop.stack.control_stack import ControlStack
from servoloop.stack.emulator_process import virtual_servos
from servoloop.stack.hardware import HardwareKind, HardwareSetup
from servoloop.stack.loop_thread import LEFT, LoopThread
from servoloop.stack.processes import claim_realtime_priority
from servoloop.stack.robot_files import Files, initial_states, servo_ids
from servoloop.stack.signals import Signals

if TYPE_CHECKING:
    from nodes.stack import Stack
    from nodes.surface import Surface
    from servoloop.simulation.real_clients import SimulatedTime

LOG = logging.getLogger("servoloop")


@dataclass(frozen=True, slots=True)
class UpOptions:
    """Options of ``servoloop up`` other than the arm and its hardware."""

    keep_alive: bool = False
    """Whether the program continues without unreachable components, at the start and later."""
    publish_transforms: bool = True
    """Whether to publish the transforms of the robot's links along with the ``robot_description``."""
    simulated: "SimulatedTime | None" = None
    """Simulated time with virtual servos in this process. None: real time."""
    record: Path | None = None
    """Path of a new recording, if any."""


NO_OPTIONS = UpOptions()


def up(
    kind: HardwareKind | None,
    ports: Mapping[str, str] | None,
    files: Files,
    ready: Callable[[str], None],
    options: UpOptions = NO_OPTIONS,
) -> int:
    """Run the stack until a signal or a fault.

    Args:
        kind: Hardware of all components. None: the ``<plugin>`` of each component decides.
        ports: Devices by bus. None: virtual servos.
        files: Files of the robot.
        ready: Called with the name and the rate of the stack when clients can use it.
        options: Other options.

    Returns:
        Exit status.
    """
    recording = StackRecording(options.record)
    if options.simulated is not None:
        setup = options.simulated.hardware(kind, ports, files, recording.tap)
        with Signals(LEFT) as signals:
            return _Up(setup, files, options, recording).run(signals, ready)
    with Signals(LEFT) as signals, _devices(kind, ports, files, signals) as devices:
        setup = hardware.build(kind, files, devices, MonotonicClock(), tap=recording.tap)
        return _Up(setup, files, options, recording).run(signals, ready)


@contextmanager
def _devices(
    kind: HardwareKind | None, ports: Mapping[str, str] | None, files: Files, signals: Signals
) -> Iterator[Mapping[str, str]]:
    """Yield the devices to open: the given ones, or those of a new emulator."""
    kinds = [hardware.choose(kind, component) for component in files.description.components]
    if HardwareKind.SERVOS not in kinds and ports:
        raise DriverError("--port was given, but no component uses servos: leave out --port or --hardware")
    if HardwareKind.SERVOS not in kinds or ports is not None:
        yield ports or {}
        return
    with virtual_servos(files, lambda: signals.count) as devices:
        yield devices
    LOG.info("the virtual servos have been shut down")


class _Up:
    """Run of the stack with its ROS interface."""

    def __init__(self, setup: HardwareSetup, files: Files, options: UpOptions, recording: StackRecording) -> None:
        simulated = options.simulated
        worker = simulated.worker if simulated else BackgroundWorker()
        clock = simulated.clock if simulated else MonotonicClock()
        self._initial = initial_states(files)
        self._options, self._recording, self._simulated = options, recording, simulated
        self._stack = ControlStack.build(setup, files, clock, worker, options.keep_alive)
        self._stack.load_controllers()

    def run(self, signals: Signals, ready: Callable[[str], None]) -> int:
        """Configure the hardware, serve clients until the end, and return the exit status."""
        thread = LoopThread(self._stack, signals)
        with self._stack.configured(self._initial.unconfigured, self._options.keep_alive, thread.hangs):
            ros_stack = self._ros_stack()
            from nodes.surface import Surface

            if self._simulated is None:  # in simulated time no cycle is late, and the clients need the processor
                claim_realtime_priority()
            surface = Surface(ros_stack)
            try:
                self._record_and_serve(thread, surface, ready)
            finally:
                surface.close()
        return 1 if thread.failed else 0

    def _ros_stack(self) -> "Stack":
        require_ros()
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
        )

    def _record_and_serve(self, thread: LoopThread, surface: "Surface", ready: Callable[[str], None]) -> None:
        """Activate the hardware and serve clients until the end, while cycles are published and recorded."""
        stack, loop = self._stack, self._stack.loop
        loop.on_cycle = surface.post
        if self._simulated is not None:
            self._simulated.connect(loop, surface)
            thread.before_cycle = self._simulated.before_cycle
        offset_s = 0.0 if self._simulated else wall_offset_s(loop.clock, time)
        with self._recording.of(loop, stack.files, offset_s, lambda: thread.failed, stack.setup.scene):
            loop.activate(self._initial.inactive)
            self._serve_clients(thread, surface, ready)

    def _serve_clients(self, run: LoopThread, surface: "Surface", ready: Callable[[str], None]) -> None:
        """Run the loop in its thread and ROS in this thread until the loop has ended or hangs."""
        loop = self._stack.loop
        _prepare_interpreter()
        thread = run.start()
        try:
            ready(f"{loop.hardware.name} at {1.0 / loop.period_s:g} Hz")
            surface.spin(lambda: run.done or run.hangs())
        finally:
            run.signals.ask()  # also end the loop if ROS fails
            while thread.is_alive() and not run.hangs():
                thread.join(0.1)
            if thread.is_alive():
                LOG.error("the control loop hangs in its hardware and could not be stopped: %s", LEFT)
            if self._simulated is not None:
                self._simulated.pace.end()
                LOG.info("%s", self._simulated.pace.summary)
            surface.finish()
            gc.unfreeze()


def _prepare_interpreter() -> None:
    """Prevent delays of the loop by other Python threads and by the garbage collector."""
    sys.setswitchinterval(0.0001)  # maximum time the loop waits for the interpreter lock, in seconds
    gc.collect()
    gc.freeze()
