"""``servoloop up``: the stack of one robot, from start to end."""

import gc
import logging
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from time import time
from typing import TYPE_CHECKING

from controller.interface import ControllerContext
from controller.loop import ControlLoop
from controller.manager.factory import Factory
from controller.manager.manager import ControllerManager
from drivers.clock import Clock, MonotonicClock, wall_offset_s
from drivers.errors import DriverError
from hal.components.component_lifecycle import clean_up_all, configure_all
from nodes.ros_environment import require_ros
from servoloop import hardware
from servoloop.background_worker import BackgroundWorker
from servoloop.emulator_process import virtual_servos
from servoloop.files import Files, InitialStates, initial_states, servo_ids
from servoloop.hardware import HardwareKind, HardwareSetup
from servoloop.line_rate import check_rates
from servoloop.loop_thread import LEFT, LoopThread
from servoloop.realtime import claim_realtime_priority
from servoloop.recorder.link_poses import Scene
from servoloop.signals import Signals
from servoloop.stack_recording import StackRecording

if TYPE_CHECKING:
    from nodes.stack import Stack
    from nodes.surface import Surface
    from servoloop.simulation.real_clients import SimulatedTime

LOG = logging.getLogger("servoloop")


def up(
    kind: HardwareKind | None,
    ports: Mapping[str, str] | None,
    files: Files,
    ready: Callable[[str], None],
    keep_alive: bool = False,
    publish_transforms: bool = True,
    simulated: "SimulatedTime | None" = None,
    record: Path | None = None,
) -> int:
    """Run the stack until a signal or a fault; the exit status. ``ports``: devices by bus, None for virtual servos.

    ``keep_alive``: a component that cannot be reached, at the start or later, ends nothing.
    ``publish_transforms``: of the robot's links, with the ``robot_description``.
    ``simulated``: all on simulated time, with virtual servos in this process. ``record``: into this new file.
    """
    initial = initial_states(files)
    recording = StackRecording(record)
    if simulated is not None:
        setup = simulated.hardware(kind, ports, files, recording.tap)
        with Signals(LEFT) as signals:
            return _serve(setup, files, signals, ready, keep_alive, publish_transforms, initial, simulated, recording)
    with Signals(LEFT) as signals, _devices(kind, ports, files, signals) as devices:
        setup = hardware.build(kind, files, devices, MonotonicClock(), tap=recording.tap)
        return _serve(setup, files, signals, ready, keep_alive, publish_transforms, initial, None, recording)


@contextmanager
def _devices(
    kind: HardwareKind | None, ports: Mapping[str, str] | None, files: Files, signals: Signals
) -> Iterator[Mapping[str, str]]:
    """The devices that the stack opens: those that were named, or those of an emulator of our own."""
    kinds = [hardware.choose(kind, component) for component in files.description.components]
    if HardwareKind.SERVOS not in kinds and ports:
        raise DriverError("no component is driven by servos: leave out --port, or --hardware")
    if HardwareKind.SERVOS not in kinds or ports is not None:
        yield ports or {}
        return
    with virtual_servos(files, lambda: signals.count) as devices:
        yield devices
    LOG.info("the virtual servos have ended with the stack")


def _serve(
    setup: HardwareSetup,
    files: Files,
    signals: Signals,
    ready: Callable[[str], None],
    keep_alive: bool,
    publish_transforms: bool,
    initial: InitialStates,
    simulated: "SimulatedTime | None",
    recording: StackRecording,
) -> int:
    worker = simulated.worker if simulated else BackgroundWorker()
    clock = simulated.clock if simulated else MonotonicClock()
    loop, factory = _loop(setup, files, clock, keep_alive, worker)
    exits = files.robot.file.on_exit
    relax = (exits.virtual if setup.virtual else exits.real) == "relax"
    run = LoopThread(loop, worker, relax, files, signals)
    configure_all(setup.hardware, initial.unconfigured, keep_alive)
    try:
        check_rates(setup.buses, setup.rates_hz, files.robot, files.controllers.path)
        return _run(
            run,
            _stack(loop, factory, setup, files, relax, publish_transforms, simulated),
            ready,
            lambda: loop.activate(initial.inactive),
            simulated,
            recording,
        )
    finally:
        if not run.hangs():
            clean_up_all(setup.hardware)  # done already, unless something failed on the way


def _stack(
    loop: ControlLoop,
    factory: Factory,
    setup: HardwareSetup,
    files: Files,
    relax: bool,
    publish_transforms: bool,
    simulated: "SimulatedTime | None",
) -> "Stack":
    require_ros()
    from nodes.stack import Stack

    return Stack(
        loop,
        files.description,
        files.component,
        servo_ids(files, setup.set_compensation),
        setup.scene,
        setup.set_compensation,
        factory,
        relax,
        publish_transforms,
        simulated.pace if simulated else None,
    )


def _run(
    run: LoopThread,
    stack: "Stack",
    ready: Callable[[str], None],
    activate: Callable[[], None],
    simulated: "SimulatedTime | None",
    recording: StackRecording,
) -> int:
    from nodes.surface import Surface

    if simulated is None:  # nothing is late on simulated time, and the clients need the processor too
        claim_realtime_priority()
    surface = Surface(stack)
    try:
        _record_and_serve(run, surface, ready, activate, simulated, recording, stack.scene)
    finally:
        surface.close()
    return 1 if run.failed else 0


def _record_and_serve(
    run: LoopThread,
    surface: "Surface",
    ready: Callable[[str], None],
    activate: Callable[[], None],
    simulated: "SimulatedTime | None",
    recording: StackRecording,
    scene: Scene,
) -> None:
    """Activate the hardware and serve until the end; the loop's cycles go to the ROS side and into the recordings."""
    loop = run.loop
    loop.on_cycle = surface.post
    if simulated is not None:
        simulated.connect(loop, surface)
        run.before_cycle = simulated.before_cycle
    offset_s = 0.0 if simulated else wall_offset_s(loop.clock, time)
    with recording.of(loop, run.files, offset_s, lambda: run.failed, scene):
        activate()
        _serve_clients(run, surface, ready, simulated)


def _serve_clients(
    run: LoopThread, surface: "Surface", ready: Callable[[str], None], simulated: "SimulatedTime | None"
) -> None:
    """Run the loop in its thread, and the ROS side in this one, until the loop has ended or hangs."""
    loop = run.loop
    _prepare_interpreter()
    thread = run.start()
    try:
        ready(f"{loop.hardware.name} at {1.0 / loop.period_s:g} Hz")
        surface.spin(lambda: run.done or run.hangs())
    finally:
        run.signals.ask()  # where this side fails, the loop is told to end
        while thread.is_alive() and not run.hangs():
            thread.join(0.1)
        if thread.is_alive():
            LOG.error("the control loop hangs in its hardware and is left behind: %s", LEFT)
        if simulated is not None:
            simulated.pace.end()
            LOG.info("%s", simulated.pace.summary)
        surface.finish()
        gc.unfreeze()


def _loop(
    setup: HardwareSetup, files: Files, clock: Clock, keep_alive: bool, worker: BackgroundWorker
) -> tuple[ControlLoop, Factory]:
    manager = ControllerManager(setup.hardware, files.limits)
    context = ControllerContext(
        files.description, files.component, files.limits, manager.cycle.settled, setup.compliances
    )
    factory = Factory(files.controllers, context)
    factory.fill(manager)
    period_s = 1.0 / files.controllers.update_rate_hz
    return ControlLoop(
        setup.hardware, manager, files.limits, clock, period_s, keep_alive=keep_alive, background_worker=worker
    ), factory


def _prepare_interpreter() -> None:
    """Keep Python's other threads and its collector from making the loop late."""
    sys.setswitchinterval(0.0001)  # so long the loop waits at most for a callback of the other thread to let go
    gc.collect()
    gc.freeze()
