"""``servoloop up``: the stack of one robot, from start to end."""

import gc
import logging
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from controller.ending import end
from controller.factory import Factory
from controller.interface import Surroundings
from controller.loop import ControlLoop
from controller.manager import ControllerManager
from drivers.clock import MonotonicClock
from drivers.errors import DriverError
from servoloop import hardware
from servoloop.aside import Aside
from servoloop.emulator_process import emulator_process
from servoloop.files import Files
from servoloop.hardware import Below, HardwareKind
from servoloop.initial_states import InitialStates, initial_states
from servoloop.ports import links
from servoloop.realtime import claim_realtime_priority, put_first
from servoloop.ros import require_ros
from servoloop.signals import Signals

if TYPE_CHECKING:
    from nodes.stack import Stack

LOG = logging.getLogger("servoloop")


@dataclass(slots=True)
class _Run:
    """The loop's thread and what became of it."""

    loop: ControlLoop
    aside: Aside
    relax: bool
    files: Files
    signals: Signals
    failed: bool = True
    """Until all has gone well."""
    done: bool = False

    def __call__(self) -> None:
        ran = False
        try:
            put_first()
            self.loop.run(lambda: self.signals.count > 0)
            ran = True
        except DriverError as error:
            LOG.error("the loop ends: %s", error)
        except Exception:  # a defect: whatever it is, the arm is still brought to its end below
            LOG.exception("the loop ends")
        finally:
            try:
                self.failed = bool(self._end()) or not ran
            finally:
                self.done = True  # the other thread waits for it, whatever happened here

    def _end(self) -> list[str]:
        park = self.files.robot.file.park
        return end(
            self.loop,
            self.relax,
            park.pose if park else None,
            park.velocity_scale if park else 1.0,
            hurry=lambda: self.signals.count > 1,
            settle=self.aside.join,
        )


def up(
    kind: HardwareKind | None,
    ports: Mapping[str, str] | None,
    files: Files,
    ready: Callable[[str], None],
    stay: bool = False,
    links: bool = True,
) -> int:
    """Run until a signal or a fault; returns the exit status. ``ports``: devices by bus, None for virtual servos.

    ``stay``: a component that cannot be reached, at the start or later, ends nothing. ``links``: publish them.
    """
    initial = initial_states(files)
    with Signals() as signals, _devices(kind, ports, files) as devices:
        below = hardware.build(kind, files, devices, MonotonicClock())
        return _serve(below, files, signals, ready, stay, links, initial)


@contextmanager
def _devices(kind: HardwareKind | None, ports: Mapping[str, str] | None, files: Files) -> Iterator[Mapping[str, str]]:
    """The devices to open: those that were named, or those of an emulator of our own."""
    kinds = [hardware.choose(kind, component) for component in files.description.components]
    if HardwareKind.SERVOS not in kinds and ports:
        raise DriverError("no component is driven by servos: leave out --port, or --hardware")
    if HardwareKind.SERVOS not in kinds or ports is not None:
        yield ports or {}
        return
    with tempfile.TemporaryDirectory(prefix="servoloop-") as folder:
        link = Path(folder) / "bus"
        robot = ("--robot", str(files.robot_path)) if len(files.robot_paths) == 1 else ()
        arguments = ("--urdf", str(files.urdf_path), *robot)
        buses = files.robot.file.lines()
        with emulator_process(link, *arguments, buses=buses):
            yield {name: str(path) for name, path in links(link, buses).items()}


def _serve(
    below: Below,
    files: Files,
    signals: Signals,
    ready: Callable[[str], None],
    stay: bool,
    links: bool,
    initial: InitialStates,
) -> int:
    aside = Aside()
    loop, factory = _loop(below, files, stay, aside)
    exits = files.robot.file.on_exit
    relax = (exits.virtual if below.virtual else exits.real) == "relax"
    below.hardware.configure(initial.unconfigured, stay)
    try:
        run = _Run(loop, aside, relax, files, signals)
        return _run(
            run, _stack(loop, factory, below, files, relax, links), ready, lambda: loop.activate(initial.inactive)
        )
    finally:
        below.hardware.cleanup()  # done already, unless something failed on the way


def _stack(loop: ControlLoop, factory: Factory, below: Below, files: Files, relax: bool, links: bool) -> "Stack":
    require_ros()
    from nodes.stack import Stack

    driven = [c.name for c in files.description.components if c.name in below.set_interpolation]
    servo_ids = {
        joint.name: joint.address
        for joint in files.robot.joints
        if any(joint.name in c.joints for c in files.description.components if c.name in driven)
    }
    return Stack(
        loop,
        files.description,
        files.component,
        servo_ids,
        below.scene,
        below.set_interpolation,
        factory,
        relax,
        links,
    )


def _run(run: _Run, stack: "Stack", ready: Callable[[str], None], activate: Callable[[], None]) -> int:
    from nodes.surface import Surface

    loop = run.loop
    claim_realtime_priority()
    surface = Surface(stack)
    loop.on_cycle = surface.post
    try:
        activate()
    except BaseException:
        surface.close()
        raise
    _prepare_interpreter()
    thread = threading.Thread(target=run, name="control loop")
    thread.start()
    try:
        ready(f"{loop.hardware.name} at {1.0 / loop.period_s:g} Hz")
        surface.spin(lambda: run.done)
    finally:
        run.signals.ask()  # where this side fails, the loop is told to end
        thread.join()
        surface.say_goodbye()
        surface.close()
        gc.unfreeze()
    return 1 if run.failed else 0


def _loop(below: Below, files: Files, stay: bool, aside: Aside) -> tuple[ControlLoop, Factory]:
    manager = ControllerManager(below.hardware.command_interfaces)
    surroundings = Surroundings(files.description, files.component, files.limits, manager.settled)
    factory = Factory(files.controllers, surroundings)
    factory.fill(manager)
    period_s = 1.0 / files.controllers.update_rate_hz
    clock = MonotonicClock()
    return ControlLoop(below.hardware, manager, files.limits, clock, period_s, stay=stay, aside=aside), factory


def _prepare_interpreter() -> None:
    """Keep the other thread and the collector from making the loop late."""
    sys.setswitchinterval(0.0001)  # so long the loop waits at most for a callback of the other thread to let go
    gc.collect()
    gc.freeze()
