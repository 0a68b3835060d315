"""Demo cell: the processes of the emulator, the stack and the pick-and-place node, and a client for each of them."""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from drivers.driver_errors import DriverError
from nodes.namespace import namespace_arguments
from servoloop.demo.cell_options import CellOptions
from servoloop.demo.jobs import Camera, JobRunner, Live, RosClients
from servoloop.simulation.job import require_cell
from servoloop.stack.arm_folders import ArmFolder, read_arm_files
from servoloop.stack.devices import device_paths, port_options
from servoloop.stack.emulator_process import emulate_arguments
from servoloop.stack.pick_place import load_pick_place, load_pick_places
from servoloop.stack.processes import Processes, choose_ros_domain
from servoloop.stack.robot_files import Files
from servoloop.stack.signals import Signals
from sim_backend.scene.world_feed import WorldFeedClient, feed_path

if TYPE_CHECKING:
    from nodes.clients.sorting_monitor import SortingMonitor
    from nodes.clients.stack_monitor import StackMonitor

ARM = "arm_controller"
NODE = "nodes.vision_pick_place_controller"
START_S = 60.0
ADDRESS = re.compile(r"the page is at (\S+)")
"""Pattern of the message that ``servoloop view`` prints when the page is ready."""
LEFT = "the processes of the demo will end on their own"
"""Message after a second signal. Each process receives SIGTERM when its parent exits."""


@dataclass(frozen=True, slots=True)
class Cell:
    """Cell whose processes are running and whose clients are connected, so that jobs can start."""

    runner: JobRunner
    monitor: "StackMonitor"
    component: str
    """Name of the hardware component."""
    joints: Sequence[str]
    """Joints of the arm, without the hand."""
    sorting: "SortingMonitor | None"
    """Monitor of the jobs that camera images trigger, or None if the cell does not have a camera."""
    process_ids: Mapping[str, int]
    """Process IDs of ``emulator``, ``stack`` and ``pick_place``."""


def check_grades(grades: Sequence[str], arm: ArmFolder) -> None:
    """Raise DriverError if the arm's node parameters do not specify a bin for each of the grades."""
    jobs = load_pick_places(arm.pick_place).values()
    known = [grade for grade in next(iter(jobs)).grades if all(grade in job.grades for job in jobs)]
    unknown = [grade.strip() for grade in grades if grade.strip().upper() not in known]
    if unknown:
        names = ", ".join(unknown)
        listed = ", ".join(known)
        raise DriverError(f"--grades: there is no bin for {names}; {arm.pick_place} has bins for {listed}")


def are_all_grades(grades: Sequence[str], arm: ArmFolder) -> bool:
    """Return whether ``grades`` includes all grades of the arm."""
    return {grade.strip().upper() for grade in grades} >= set(load_pick_place(arm.pick_place).grades)


@contextmanager
def cell(options: CellOptions, live: Live) -> Iterator[Cell]:
    """Start the processes of a cell, and stop them after the block.

    Raises:
        DriverError: A process failed. The message contains the last output of the process.
        Interrupted: A signal arrived.
    """
    from nodes.clients.client_node import client_node
    from nodes.clients.sorting_monitor import SortingMonitor
    from nodes.clients.stack_monitor import StackMonitor
    from nodes.pick_place.client import PickClient
    from nodes.pick_place.homing import Homing
    from nodes.planning_client.presence import is_planner_present

    if not options.namespace:  # a namespace separates the cell from other cells in the domain
        choose_ros_domain()
    out, arm = options.out, options.found()
    link = out / "bus"
    files = read_arm_files(arm, robot=options.robot, namespace=options.namespace)
    settings = load_pick_place(arm.pick_place, options.namespace).settings()
    if options.poses and not arm.pick_place_poses.exists():
        raise DriverError(
            f"--poses requires {arm.pick_place_poses}: create this file from config/pick_place_poses.yaml"
        )
    require_cell(files, settings.bins_rad)
    with Signals(LEFT) as signals, Processes(out, os.environ, lambda: signals.count) as processes:
        process_ids = start_stack(processes, link, files, options, live)
        if options.poses:
            live.say("starting the motion planner")
            processes.start("plan_server", "servoloop", "plan-server", "--arm", str(arm.folder), *_namespace(options))
        process_ids["pick_place"] = _start_node(processes, arm, options, live)
        if options.view:
            live.say(f"the arm in a browser: {open_page(processes, out, process_ids['stack'])}")
        with client_node("servoloop_demo", options.namespace) as (node, executor):
            if options.poses:
                processes.wait_until(lambda: is_planner_present(node), "starting the motion planner", START_S)
            monitor = StackMonitor(node, executor, ARM)
            camera = Camera(open_feed(link, processes), settings.joints)
            picker, homing = PickClient(node, executor), Homing(node, executor, settings)
            runner = JobRunner(RosClients(monitor, picker, homing), live, camera, signals, processes)
            runner.wait_for_node(START_S)
            sorting: SortingMonitor | None = None
            if options.vision:
                sorting = SortingMonitor()
                sorting.subscribe(node)
                process_ids["camera"] = _start_camera(processes, link, files, live)
            yield Cell(runner, monitor, files.component.name, settings.joints, sorting, process_ids)
        live.say("drawing the images")
        processes.end()


def open_feed(link: Path, processes: Processes) -> WorldFeedClient:
    """Connect to the emulator's world at ``link``. Raises DriverError."""
    try:
        return WorldFeedClient(feed_path(link))
    except OSError as error:
        processes.check()
        raise DriverError(f"cannot connect to the simulated world at {feed_path(link)}: {error}") from error


def open_page(processes: Processes, out: Path, stack: int) -> str:
    """Start ``servoloop view`` for the stack and return the URL of the page."""
    processes.start("view", "servoloop", "view", "--arm", str(stack))
    found: list[str] = []

    def shown() -> bool:
        found[:] = ADDRESS.findall((out / "view.log").read_text())
        return bool(found)

    processes.wait_until(shown, "opening the page", START_S)
    return found[0]


def _namespace(options: CellOptions) -> tuple[str, ...]:
    return ("--namespace", options.namespace) if options.namespace else ()


def start_stack(processes: Processes, link: Path, files: Files, options: CellOptions, live: Live) -> dict[str, int]:
    """Start the emulator and then the stack, and return their process IDs."""
    buses = files.robot.file.lines()
    ready = link.with_name("ready")
    ready.unlink(missing_ok=True)
    started: dict[str, int] = {}
    live.say(f"starting the virtual servos (ROS_DOMAIN_ID {os.environ.get('ROS_DOMAIN_ID', '0')})")
    seed, record = options.seed, options.record
    built = ("--backlash", str(options.backlash_deg), *(() if seed is None else ("--seed", str(seed))))
    built += () if options.apples is None else ("--apples", str(options.apples))
    command = ("servoloop", *emulate_arguments(link, files), "--pictures", str(link.parent), *built)
    started["emulator"] = processes.start("emulator", *command)
    served = [feed_path(link), *device_paths(link, buses).values()]
    processes.wait_until(lambda: all(path.exists() for path in served), "starting the virtual servos", START_S)
    live.say("starting the stack")
    command = ("servoloop", "up", *port_options(link, buses), "--ready-file", str(ready), *files.options)
    command += ("--record", str(record)) if record else ()
    started["stack"] = processes.start("stack", *command)
    processes.wait_until(ready.exists, "starting the stack", START_S)
    return started


def _start_node(processes: Processes, arm: ArmFolder, options: CellOptions, live: Live) -> int:
    """Start the pick-and-place node and return its process ID."""
    live.say("starting the pick-and-place node")
    parameters = arm.pick_place_poses if options.poses else arm.pick_place
    return processes.start(
        "pick_place", NODE, "--ros-args", "--params-file", str(parameters), *namespace_arguments(options.namespace)
    )


def _start_camera(processes: Processes, link: Path, files: Files, live: Live) -> int:
    """Start the perception node with the virtual camera and return its process ID."""
    live.say("starting the camera")
    return processes.start(
        "camera", "servoloop.demo.camera_process", str(link), str(files.scene), *namespace_arguments(files.namespace)
    )
