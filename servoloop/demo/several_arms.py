"""Run the demo for a robot with several arms: all arms sort at the same time, each with its own pick-and-place node."""

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import psutil
from rich.console import Console

from commissioning.atomic_write import write_file
from drivers.driver_errors import DriverError
from nodes.namespace import namespace_arguments
from servoloop.demo.cell import NODE, START_S, open_feed, open_page, start_stack
from servoloop.demo.cell_options import CellOptions
from servoloop.demo.demo import (
    EXPLANATION,
    FIGURES_S,
    IDLE_S,
    LOOP_COLUMNS,
    cpu_load,
    loop_figures,
    loop_table,
    print_summary,
    run_content,
    runs_table,
)
from servoloop.demo.jobs import Camera, JobRun, JobRunner, Live, RosClients
from servoloop.simulation.job import require_cell
from servoloop.stack import tables
from servoloop.stack.arm_folders import read_arm_files
from servoloop.stack.pick_place import NODE as NODE_NAME
from servoloop.stack.pick_place import PickPlace
from servoloop.stack.pick_place import arm_jobs as read_arm_jobs
from servoloop.stack.processes import Processes, choose_ros_domain
from servoloop.stack.signals import Signals
from sim_backend.scene.world_feed import WorldFeedClient

if TYPE_CHECKING:
    from nodes.clients.client_node import Client
    from nodes.clients.stack_monitor import StackMonitor

POLL_S: Final = 0.2
"""Period at which the world is read while jobs are running, in seconds."""
MOVING_RAD_S: Final = 0.05
"""Minimum joint speed at which an arm counts as moving, in rad/s or m/s."""
LEFT: Final = "the processes of the demo will end on their own"


@dataclass(frozen=True, slots=True)
class SortingArm:
    """One arm of a robot with several arms, ready for jobs."""

    name: str
    """Name of the arm, such as ``left``."""
    job: PickPlace
    runner: JobRunner
    monitor: "StackMonitor"

    @property
    def prefix(self) -> str:
        """Prefix of all names of the arm."""
        return f"{self.name}_"


@dataclass(frozen=True, slots=True)
class SeveralArmsReport:
    """Results of a demo with several arms."""

    runs: Mapping[str, tuple[JobRun, ...]]
    """Jobs of each arm, keyed by arm name."""
    joints: Mapping[str, tuple[str, ...]]
    """Joints of each arm, in the order of all its values."""
    together_s: float
    """Time during which all arms were moving at the same time, in seconds."""
    loop: Mapping[str, float]
    cpu_percent: Mapping[str, float]

    @property
    def all_runs(self) -> list[JobRun]:
        """Jobs of all arms."""
        return [run for runs in self.runs.values() for run in runs]

    @property
    def success(self) -> bool:
        """Whether every cube is in the bin for its grade."""
        return bool(self.all_runs) and all(run.success for run in self.all_runs)


def arm_jobs(options: CellOptions) -> dict[str, PickPlace]:
    """Return the parameters of each arm's pick-and-place node, keyed by arm name; for a single arm, the key is "".

    Raises ArmFileError.
    """
    return read_arm_jobs(options.found().pick_place, options.namespace)


def sort_with_several_arms(grades: Sequence[str], repeat: int, options: CellOptions, live: Live) -> SeveralArmsReport:
    """Let each arm pick cubes of these grades ``repeat`` times in a new cell.

    Raises:
        DriverError: A process failed. The message contains the last output of the process.
        Interrupted: The user interrupted the demo.
    """
    jobs = [grade for _ in range(repeat) for grade in grades]
    with _cell(options, live) as (arms, process_ids, feed):
        stack, first = psutil.Process(process_ids["stack"]), arms[0]
        idle_percent, _ = cpu_load(stack, lambda: first.runner.idle(IDLE_S))
        moving_percent, (runs, together_s) = cpu_load(stack, lambda: _run(arms, jobs, feed))
        first.runner.idle(FIGURES_S)
        loop = loop_figures(first.monitor)
    cpu_percent = {"idle": idle_percent, "moving": moving_percent}
    return SeveralArmsReport(runs, {arm.name: arm.job.joints for arm in arms}, together_s, loop, cpu_percent)


@contextmanager
def _cell(options: CellOptions, live: Live) -> Iterator[tuple[list[SortingArm], dict[str, int], WorldFeedClient]]:
    """Start the processes of the cell, and stop them after the block."""
    from nodes.clients.client_node import client_nodes

    if not options.namespace:  # a namespace separates the cell from other cells in the domain
        choose_ros_domain()
    out, arm = options.out, options.found()
    link, jobs = out / "bus", arm_jobs(options)
    files = read_arm_files(arm, robot=options.robot, namespace=options.namespace)
    require_cell(files, ["A"])
    with Signals(LEFT) as signals, Processes(out, os.environ, lambda: signals.count) as processes:
        process_ids = start_stack(processes, link, files, options, live)
        for name in jobs:
            live.say(f"starting the pick-and-place node of the {name} arm")
            process_ids[name] = processes.start(
                f"pick_place_{name}", *node_arguments(name, arm.pick_place), *namespace_arguments(options.namespace)
            )
        if options.view:
            live.say(f"the arms in a browser: {open_page(processes, out, process_ids['stack'])}")
        with client_nodes([f"servoloop_demo_{name}" for name in jobs], options.namespace) as clients:
            arms = []
            for (name, job), client in zip(jobs.items(), clients, strict=True):
                camera = Camera(open_feed(link, processes), job.joints, f"{name}_")
                own = _clients(client, name, job)
                runner = JobRunner(own, Live(live.console, name), camera, signals, processes)
                arms.append(SortingArm(name, job, runner, own.monitor))
            for one in arms:
                one.runner.wait_for_node(START_S)
            yield arms, process_ids, open_feed(link, processes)
        live.say("drawing the images")
        processes.end()


def node_arguments(name: str, parameters: Path) -> tuple[str, ...]:
    """Return the command that starts the pick-and-place node of an arm with its own topics and services."""
    own = f"sorting/{name}_arm"
    remaps = {
        "__node": f"{name}_{NODE_NAME}",
        "sorting/arm/state": f"{own}/state",
        "sorting/arm/enable": f"{own}/enable",
        "sorting/perception/apple_quality": f"sorting/{name}_perception/apple_quality",
    }
    rules = [word for old, new in remaps.items() for word in ("-r", f"{old}:={new}")]
    return (NODE, "--ros-args", "--params-file", str(parameters), *rules)


def _clients(client: "Client", name: str, job: PickPlace) -> RosClients:
    from nodes.clients.stack_monitor import StackMonitor
    from nodes.pick_place.client import PickClient
    from nodes.pick_place.homing import Homing

    node, executor = client
    monitor = StackMonitor(node, executor, job.arm_controller)
    picker = PickClient(node, executor, f"sorting/{name}_arm/pick_place")
    return RosClients(monitor, picker, Homing(node, executor, job.settings()))


def _run(
    arms: Sequence[SortingArm], grades: Sequence[str], feed: WorldFeedClient
) -> tuple[dict[str, tuple[JobRun, ...]], float]:
    """Run the jobs of each arm in a thread. Return the jobs and the time during which all arms were moving together."""
    watch = _MotionWatch([arm.prefix for arm in arms])
    with ThreadPoolExecutor(len(arms)) as threads:
        runs = {arm.name: threads.submit(_run_all, arm.runner, grades) for arm in arms}
        while wait(runs.values(), POLL_S).not_done:  # A runner stops if a process exits or a signal arrives.
            for publication in feed.all():
                watch.add(publication)
        return {name: run.result() for name, run in runs.items()}, watch.together_s


def _run_all(runner: JobRunner, grades: Sequence[str]) -> tuple[JobRun, ...]:
    return tuple(runner.run(grade) for grade in grades)


class _MotionWatch:
    """Measurement of the time during which all arms move at the same time."""

    def __init__(self, prefixes: Sequence[str]) -> None:
        self.together_s = 0.0
        self._prefixes = prefixes
        self._last: tuple[float, np.ndarray[Any, np.dtype[np.float64]]] | None = None

    def add(self, publication: Mapping[str, Any]) -> None:
        """Add the motion contained in one message published by the world."""
        owners = [[name.startswith(prefix) for name in publication["joints"]] for prefix in self._prefixes]
        for time_s, positions in publication["trace"]:
            here = np.array(positions)
            if self._last is not None and time_s > self._last[0]:
                period_s = time_s - self._last[0]
                speed = np.abs(here - self._last[1]) / period_s
                if all(speed[own].max() > MOVING_RAD_S for own in owners):
                    self.together_s += period_s
            self._last = (time_s, here)


def check_options(options: CellOptions) -> None:
    """Raise DriverError if an option cannot be used with several arms."""
    if options.vision or options.poses:
        raise DriverError(
            f"{options.arm} has several arms, so the demo uses cubes and joint positions: omit --vision and --poses"
        )


def print_report(report: SeveralArmsReport, console: Console) -> None:
    """Print the report as tables."""
    for name, runs in report.runs.items():
        table = runs_table(runs, report.joints[name], f"{name} arm: following error, rad")
        tables.print_table(console, table)
    console.print(EXPLANATION)
    console.print()
    tables.print_table(console, loop_table(report.loop, report.cpu_percent), *LOOP_COLUMNS)
    print_summary(report.all_runs, console)
    console.print(f"time during which all arms moved at the same time: {report.together_s:.1f} s")


def write_report(report: SeveralArmsReport, path: Path) -> None:
    """Write the report as JSON. Raises DriverError if the file cannot be written."""
    runs = report.all_runs
    content = {
        "success": report.success,
        "cubes": {"in_their_bins": sum(run.success for run in runs), "of": len(runs)},
        "arms": {
            name: {"runs": [run_content(run, report.joints[name]) for run in own]} for name, own in report.runs.items()
        },
        "all_arms_moved_at_once_s": round(report.together_s, 3),
        "loop": {**report.loop, "cpu_percent_of_a_core": report.cpu_percent},
    }
    write_file(path, json.dumps(content, indent=2, allow_nan=False) + "\n", keep=False)
