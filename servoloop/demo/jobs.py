"""Jobs of the demo: send a goal, watch the topics and the simulated world, and evaluate the result."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from time import perf_counter, time
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console, Group
from rich.live import Live as RichLive
from rich.table import Table
from rich.text import Text

from drivers.clock import MonotonicClock, wall_offset_s
from drivers.driver_errors import DriverError
from servoloop.recording.following_error import UNKNOWN, FollowingError, between_cycles, following_error
from servoloop.stack.processes import Interrupted, Processes
from servoloop.stack.signals import Signals
from sim_backend.scene.world_feed import WorldFeedClient

if TYPE_CHECKING:
    from nodes.clients.stack_monitor import NewestMessages, Sample, StackMonitor
    from nodes.pick_place.client import PickClient
    from nodes.pick_place.homing import Homing


class Live:
    """Progress display: a live table in a terminal, otherwise one line per event."""

    def __init__(self, console: Console, arm: str = "") -> None:
        """``arm`` is the name of the arm if the robot has several arms. In this case, the table is not shown."""
        self.console = console
        self._arm = f"{arm}: " if arm else ""
        self._view = RichLive(console=console, refresh_per_second=8, transient=True)
        self._job = ""
        self._phase = ""

    def __enter__(self) -> "Live":
        if self.console.is_terminal:
            self._view.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._view.stop()

    def say(self, text: str) -> None:
        """Print one line of progress."""
        self.console.print(Text.assemble(("· ", "dim"), self._arm, text))

    def job(self, grade: str) -> None:
        """Show that a job starts."""
        self._job, self._phase = f"grade {grade}", ""

    def phase(self, phase: str, message: str) -> None:
        """Show the feedback of the pick-and-place node."""
        self._phase = phase
        if not self._view.is_started:
            self.say(f"{self._job}: {phase}")

    def done(self, grade: str, where: str | None, success: bool, message: str) -> None:
        """Print the result of a job."""
        place = f"bin {where}" if where else "no bin"
        self._result(f"{self._arm}grade {grade}: cube in {place}", success, message)
        self._job, self._phase = "", ""

    def sorted(self, apple: str, success: bool, message: str) -> None:
        """Print the result for one apple."""
        self._result(apple, success, message)

    def _result(self, text: str, success: bool, message: str) -> None:
        mark = ("✓", "green") if success else ("✗", "red")
        self.console.print(Text.assemble(mark, f" {text} ", (message, "dim")))

    def show(self, newest: "NewestMessages") -> None:
        """Show the latest state of the arm."""
        if self._view.is_started:
            self._view.update(self._render(newest))

    def _render(self, newest: "NewestMessages") -> Group:
        title = Text.assemble((self._job or "idle", "bold"), "  ", (self._phase, "cyan"))
        return Group(title, _joints(newest), _loop_line(newest))


def _joints(newest: "NewestMessages") -> Table:
    table = Table("joint", *("position", "velocity", "following error", "°C", "V", "servo"))
    for column in table.columns[1:6]:
        column.justify = "right"
    for name, position in newest.position.items():
        servo = newest.servo(name)
        if not servo:
            continue
        error = newest.error.get(name)
        table.add_row(
            name,
            f"{position:+.4f}",
            f"{newest.velocity.get(name, 0.0):+.3f}",
            "" if error is None else f"{error:+.4f}",
            servo.get("temperature_c", ""),
            servo.get("voltage_v", ""),
            servo.get("message", ""),
        )
    return table


def _loop_line(newest: "NewestMessages") -> Text:
    loop = newest.loop
    if not loop:
        return Text("waiting for the first statistics of the control loop")
    return Text(
        f"{loop['rate_hz']} Hz   cycles {loop['cycles']}   missed {loop['missed_cycles']}   "
        f"unmeasured {loop['unmeasured_cycles']}   "
        f"latest wake-up {loop['latest_wake_up_ms']} ms   mean cycle {loop['mean_cycle_ms']} ms"
    )


REST_S = 3.0
HOMING_TRIES = 5
"""Number of attempts to move the arm home after a failed job. Each attempt is followed by a pause of ``REST_S``."""


@dataclass(frozen=True, slots=True)
class JobRun:
    """Results of a job: the bin that contains the cube, and the following errors of the arm."""

    grade: str
    success: bool
    bin: str | None
    duration_s: float
    message: str
    contacts: tuple[str, ...]
    """Contacts between the arm and anything except the cube, each as "link and object"."""
    at_cycles: FollowingError
    between_cycles: FollowingError


@dataclass(slots=True)
class WorldTrace:
    """Joint positions from the simulated world, including those between cycles, with times on the monotonic clock."""

    times_s: list[float] = field(default_factory=list)
    positions: list[list[float]] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class RosClients:
    """ROS clients that control and monitor the stack of a demo."""

    monitor: "StackMonitor"
    picker: "PickClient"
    homing: "Homing"


class JobRunner:
    """Runner that executes jobs one after another in a running cell."""

    def __init__(
        self,
        clients: RosClients,
        live: Live,
        camera: "Camera",
        signals: Signals,
        processes: Processes,
    ) -> None:
        self._monitor, self._picker, self._homing = clients.monitor, clients.picker, clients.homing
        self._failed = False
        """Whether the last job failed. After a failure, the arm, the hand and the cube may be anywhere."""
        self._live = live
        self.camera = camera
        self._signals = signals
        self._processes = processes

    def run(self, grade: str) -> JobRun:
        """Run and watch one job. If the user interrupts the demo, cancel the job and raise Interrupted."""
        if self._failed:
            self._clean_up()
        samples = self._monitor.newest.samples
        self.camera.poll()
        self.camera.trace, self.camera.contacts = WorldTrace(), set()
        samples.clear()
        self._live.job(grade)
        started_s = perf_counter()
        outcome = self._picker.pick(grade, self._live.phase, self.update)
        duration_s = perf_counter() - started_s
        at, between = _errors(samples, self.camera.trace)
        where = self._rest()
        contacts = tuple(sorted(self.camera.contacts))
        success = outcome.success and where == grade.strip().upper()
        self._failed = not success
        self._live.done(grade, where, success, outcome.message)
        return JobRun(grade, success, where, duration_s, outcome.message, contacts, at, between)

    def _clean_up(self) -> None:
        """Open the hand and move the arm home. When the next job starts, the simulation places the cube on the
        stand."""
        for _ in range(HOMING_TRIES):
            self._live.say("opening the hand and moving the arm home")
            outcome = self._homing.home(self.update)
            self._update_or_interrupt()
            self.idle(REST_S)
            if outcome.reached:
                return
            self._live.say(f"the arm did not reach its home pose: {outcome.text}")

    def idle(self, seconds: float) -> None:
        """Watch the arm for ``seconds`` seconds without a job. Raises Interrupted if the user interrupts the demo."""
        until_s = perf_counter() + seconds
        while perf_counter() < until_s:
            self._monitor.spin(0.1)
            self._update_or_interrupt()

    def wait_for_node(self, timeout_s: float) -> None:
        """Wait until the action of the pick-and-place node is available. Raises DriverError after the timeout, or
        Interrupted."""
        available = self._picker.wait(timeout_s, self.update)
        self._update_or_interrupt()
        if not available:
            raise DriverError(
                f"the pick-and-place node has not provided its action within {timeout_s:.0f} s; see pick_place.log"
            )

    def update(self) -> bool:
        """Show the latest state and return whether the job must be canceled. Raises DriverError if a process has
        exited."""
        self.camera.poll()
        self._live.show(self._monitor.newest)
        self._processes.check()
        return self._signals.count > 0

    def _update_or_interrupt(self) -> None:
        if self.update():
            raise Interrupted("interrupted")

    def _rest(self) -> str | None:
        """Wait until the cube rests in a bin, and return the bin."""
        until_s = perf_counter() + REST_S
        while self.camera.bin is None and perf_counter() < until_s:
            self._monitor.spin(0.05)
            self._update_or_interrupt()
        return self.camera.bin


class Camera:
    """Reader of the simulated world: the bin with the cube, the contacts, and the joint positions between cycles."""

    def __init__(self, client: WorldFeedClient, joints: Sequence[str], prefix: str = "") -> None:
        """``prefix`` is the prefix of all names of the arm, for a robot with several arms."""
        self.bin: str | None = None
        self.newest: dict[str, Any] | None = None
        """Latest message published by the emulator."""
        self.trace = WorldTrace()
        self.contacts: set[str] = set()
        self._client = client
        self._joints = list(joints)
        self._prefix = prefix

    def poll(self) -> None:
        """Read everything that the emulator has published since the last call."""
        for publication in self._client.all():
            self.bin, self.newest = publication["cube_bins"].get(f"{self._prefix}cube"), publication
            self.contacts.update(pair for pair in publication["contacts"] if pair.startswith(self._prefix))
            order = list(publication["joints"])
            places = [order.index(joint) for joint in self._joints]
            for time_s, positions in publication["trace"]:
                self.trace.times_s.append(time_s)
                self.trace.positions.append([positions[place] for place in places])


def _errors(samples: "Sequence[Sample]", trace: WorldTrace) -> tuple[FollowingError, FollowingError]:
    """Return the following errors at the cycles and between cycles.

    The ROS times of the samples are converted to the clock used by the trace.
    """
    if not samples:
        return UNKNOWN, UNKNOWN
    offset_s = wall_offset_s(MonotonicClock(), time)
    stamps = np.array([sample.stamp_s for sample in samples]) - offset_s
    reference = np.array([sample.reference for sample in samples])
    velocity = np.array([sample.reference_velocity for sample in samples])
    feedback = np.array([sample.feedback for sample in samples])
    at = following_error(stamps, reference - feedback, velocity)
    return at, between_cycles(trace.times_s, trace.positions, stamps, reference, velocity)
