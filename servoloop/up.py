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

from controller import factory
from controller.ending import end
from controller.interface import Surroundings
from controller.loop import ControlLoop
from controller.manager import ControllerManager
from drivers.clock import MonotonicClock
from drivers.errors import DriverError
from servoloop import hardware
from servoloop.emulator_process import emulator_process
from servoloop.files import Files
from servoloop.hardware import Below, HardwareKind
from servoloop.ports import links
from servoloop.realtime import claim_realtime_priority
from servoloop.signals import Signals

LOG = logging.getLogger("servoloop")


@dataclass(slots=True)
class _Run:
    """The loop's thread and what became of it."""

    loop: ControlLoop
    relax: bool
    files: Files
    signals: Signals
    failed: bool = False
    done: bool = False

    def __call__(self) -> None:
        park = self.files.robot.file.park
        try:
            self.loop.run(lambda: self.signals.count > 0)
        except DriverError as error:
            LOG.error("the loop ends: %s", error)
            self.failed = True
        except Exception:  # a defect: whatever it is, the arm is still brought to its end below
            LOG.exception("the loop ends")
            self.failed = True
        finally:
            problems = end(
                self.loop,
                self.relax,
                park.pose if park else None,
                park.velocity_scale if park else 1.0,
                hurry=lambda: self.signals.count > 1,
            )
            self.failed = self.failed or bool(problems)
            self.done = True


def up(kind: HardwareKind | None, ports: Mapping[str, str] | None, files: Files, ready: Callable[[str], None]) -> int:
    """Run until a signal or a fault; returns the exit status. ``ports``: devices by bus, None for virtual servos."""
    chosen = hardware.choose(kind, files)
    with Signals() as signals, _devices(chosen, ports, files) as devices:
        clock = MonotonicClock()
        below = hardware.build(chosen, files, devices, clock)
        return _serve(below, files, signals, ready)


@contextmanager
def _devices(kind: HardwareKind, ports: Mapping[str, str] | None, files: Files) -> Iterator[Mapping[str, str]]:
    """The devices to open: those that were named, or those of an emulator of our own."""
    if kind is not HardwareKind.SERVOS or ports is not None:
        yield ports or {}
        return
    with tempfile.TemporaryDirectory(prefix="servoloop-") as folder:
        link = Path(folder) / "bus"
        arguments = ("--urdf", str(files.urdf_path), "--robot", str(files.robot_path))
        buses = files.robot.file.lines()
        with emulator_process(link, *arguments, buses=buses):
            yield {name: str(path) for name, path in links(link, buses).items()}


def _serve(below: Below, files: Files, signals: Signals, ready: Callable[[str], None]) -> int:
    loop = _loop(below, files)
    below.hardware.configure()
    try:
        return _run(loop, below, files, signals, ready)
    finally:
        below.hardware.cleanup()  # done already, unless something failed on the way


def _run(loop: ControlLoop, below: Below, files: Files, signals: Signals, ready: Callable[[str], None]) -> int:
    from nodes.stack import Stack
    from nodes.surface import Surface

    servo_ids = {joint.name: joint.address for joint in files.robot.joints}
    surface = Surface(
        Stack(
            loop,
            files.description,
            files.component,
            servo_ids if below.set_interpolation else {},
            below.scene,
            below.set_interpolation,
        )
    )
    loop.on_cycle = surface.post
    try:
        loop.activate()
    except BaseException:
        surface.close()
        raise
    exits = files.robot.file.on_exit
    policy = exits.virtual if below.virtual else exits.real
    run = _Run(loop, policy == "relax", files, signals)
    _prepare_interpreter()
    claim_realtime_priority()
    thread = threading.Thread(target=run, name="control loop")
    thread.start()
    try:
        ready(f"{files.component.name} at {1.0 / loop.period_s:g} Hz")
        surface.spin(lambda: run.done)
    finally:
        signals.ask()  # where this side fails, the loop is told to end
        thread.join()
        surface.say_goodbye()
        surface.close()
        gc.unfreeze()
    return 1 if run.failed else 0


def _loop(below: Below, files: Files) -> ControlLoop:
    limits = files.robot.limits()
    manager = ControllerManager(below.hardware.joints)
    surroundings = Surroundings(files.description, files.component, limits, manager.settled)
    for controller in factory.build(files.controllers, surroundings):
        manager.add(controller)
    period_s = 1.0 / files.controllers.update_rate_hz
    return ControlLoop(below.hardware, manager, limits, MonotonicClock(), period_s)


def _prepare_interpreter() -> None:
    """Keep the other thread and the collector from making the loop late."""
    sys.setswitchinterval(0.0005)
    gc.collect()
    gc.freeze()
