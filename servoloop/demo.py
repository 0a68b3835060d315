"""``servoloop demo``: the main job from the action to the bytes, shown and measured."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import psutil

from drivers.errors import DriverError
from servoloop.files import CONFIG, read_files
from servoloop.live import Live
from servoloop.ports import links, port_options
from servoloop.processes import Processes
from servoloop.show import Camera, Run, Show
from servoloop.signals import Signals
from sim_backend.world_feed import WorldFeedClient, feed_path

if TYPE_CHECKING:
    from nodes.watcher import Watcher

ARM = "arm_controller"
ARM_JOINTS = tuple(f"joint{i}" for i in range(1, 7))
NODE = "nodes.vision_pick_place_controller"
IDLE_S = 3.0
START_S = 60.0
Result = TypeVar("Result")
FIGURES = ("cycles", "missed_cycles", "latest_wake_up_ms", "longest_cycle_ms", "mean_cycle_ms")


@dataclass(frozen=True, slots=True)
class Report:
    """Everything that the demo found out."""

    runs: tuple[Run, ...]
    comparison: Run
    """One more run, with servos that leap to each goal."""
    loop: Mapping[str, float]
    cpu_percent: Mapping[str, float]


def environment() -> dict[str, str]:
    """A ROS domain of the demo's own on this machine, unless the user has named one."""
    values = dict(os.environ)
    values.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    values.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    return values


def demo(grades: Sequence[str], repeat: int, out: Path, robot: Path | None, live: Live) -> Report:
    """Run everything; ``out`` is a folder. Raises DriverError with a process' last words if one of them fails."""
    from nodes.pick_client import PickClient
    from nodes.session import client_session
    from nodes.watcher import Watcher

    os.environ.update(environment())
    link, ready = out / "bus", out / "ready"
    ready.unlink(missing_ok=True)
    files = read_files(robot=robot)
    component = files.component.name
    buses = files.robot.file.lines()
    served = [feed_path(link), *links(link, buses).values()]
    arm = ("--robot", str(robot)) if robot else ()
    with Signals() as signals, Processes(out, os.environ) as processes:
        live.say(f"starting on ROS_DOMAIN_ID {os.environ['ROS_DOMAIN_ID']}: virtual servos")
        processes.start("emulator", "servoloop", "emulate", str(link), "--pictures", str(out), *arm)
        processes.wait_until(lambda: all(path.exists() for path in served), "starting the virtual servos", START_S)
        live.say("the stack")
        pid = processes.start("stack", "servoloop", "up", *port_options(link, buses), "--ready-file", str(ready), *arm)
        processes.wait_until(ready.exists, "starting the stack", START_S)
        live.say("the pick-place node")
        parameters = CONFIG / "vision_pick_place_controller.yaml"
        processes.start("pick_place", NODE, "--ros-args", "--params-file", str(parameters))
        with client_session("servoloop_demo") as (node, executor):
            watcher = Watcher(node, executor, ARM)
            picker = PickClient(node, executor)
            if not picker.wait(START_S):
                raise DriverError("the pick-place node offers no action: see pick_place.log")
            camera = Camera(WorldFeedClient(feed_path(link)), ARM_JOINTS)
            show = Show(watcher, picker, live, camera, signals, processes)
            report = _measure(grades, repeat, component, pid, watcher, show)
        live.say("drawing the pictures")
        processes.end()
    return report


def _measure(grades: Sequence[str], repeat: int, component: str, pid: int, watcher: "Watcher", show: Show) -> Report:
    """All runs, then one more without the servos' own interpolation, for the difference."""
    from nodes.hardware_node import INTERPOLATION

    stack = psutil.Process(pid)
    idle_percent, _ = _cpu(stack, lambda: show.idle(IDLE_S))
    jobs = [grade for _ in range(repeat) for grade in grades]
    moving_percent, runs = _cpu(stack, lambda: [show.run(grade) for grade in jobs])
    show.idle(1.5)  # the figures of the last cycles are published once a second
    loop = {name: float(watcher.seen.loop.get(name, "nan")) for name in FIGURES}
    if not watcher.set_parameter(component, INTERPOLATION, False):
        raise DriverError("the stack does not let its servo interpolation be switched off")
    comparison = show.run(grades[0])
    return Report(tuple(runs), comparison, loop, {"idle": idle_percent, "moving": moving_percent})


def _cpu(process: psutil.Process, action: Callable[[], Result]) -> tuple[float, Result]:
    """Per cent of one core that the process took during the action, and the action's result."""
    process.cpu_percent()
    result = action()
    return process.cpu_percent(), result
