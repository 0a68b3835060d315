"""The demo's jobs: each sent, watched through the topics and the emulator's feed, and judged."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from time import perf_counter, time
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console, Group
from rich.live import Live as RichLive
from rich.table import Table
from rich.text import Text

from drivers.clock import MonotonicClock, wall_offset_s
from drivers.errors import DriverError
from servoloop.simulation.recording import UNKNOWN, FollowingError, between_cycles, following_error
from servoloop.stack.processes import Interrupted, Processes
from servoloop.stack.signals import Signals
from sim_backend.scene.world_feed import WorldFeedClient

if TYPE_CHECKING:
    from nodes.pick_place.client import PickClient
    from nodes.pick_place.homing import Homing
    from nodes.stack_monitor import NewestMessages, Sample, StackMonitor


class Live:
    """A live view on a terminal; elsewhere one line an event."""

    def __init__(self, console: Console) -> None:
        self.console = console
        self._view = RichLive(console=console, refresh_per_second=8, transient=True)
        self._job = ""
        self._phase = ""

    def __enter__(self) -> "Live":
        if self.console.is_terminal:
            self._view.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._view.stop()

    def say(self, what: str) -> None:
        """Print one line of progress."""
        self.console.print(f"[dim]·[/] {what}")

    def job(self, grade: str) -> None:
        """JobRunner that a job begins."""
        self._job, self._phase = f"grade {grade}", ""

    def phase(self, phase: str, message: str) -> None:
        """JobRunner the node's feedback."""
        self._phase = phase
        if not self.console.is_terminal:
            self.say(f"{self._job}: {phase}")

    def done(self, grade: str, where: str | None, success: bool, message: str) -> None:
        """Print how a job has ended."""
        mark = "[green]✓[/]" if success else "[red]✗[/]"
        place = f"bin {where}" if where else "no bin"
        self.console.print(f"{mark} grade {grade}: cube in {place} [dim]{message}[/]")
        self._job, self._phase = "", ""

    def show(self, newest: "NewestMessages") -> None:
        """JobRunner the newest state."""
        if self.console.is_terminal:
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
        return Text("waiting for the loop's figures")
    return Text(
        f"{loop['rate_hz']} Hz   cycles {loop['cycles']}   missed {loop['missed_cycles']}   "
        f"unmeasured {loop['unmeasured_cycles']}   "
        f"latest wake-up {loop['latest_wake_up_ms']} ms   mean cycle {loop['mean_cycle_ms']} ms"
    )


REST_S = 3.0
HOMING_TRIES = 5
"""One takes a second where the arm cannot move, and there is a rest behind each."""


@dataclass(frozen=True, slots=True)
class Run:
    """A job's results: the grade, where the cube ended, how well the arm followed."""

    grade: str
    success: bool
    bin: str | None
    duration_s: float
    message: str
    at_cycles: FollowingError
    between_cycles: FollowingError


@dataclass(slots=True)
class Trace:
    """A trace of the joints between the cycles, as the simulated world saw them, on the monotonic clock."""

    times_s: list[float] = field(default_factory=list)
    positions: list[list[float]] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class RosClients:
    """The clients with which a demo drives and watches its stack."""

    monitor: "StackMonitor"
    picker: "PickClient"
    homing: "Homing"


class JobRunner:
    """The job runner runs jobs, one after the other, in a cell that is up."""

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
        """The last job. It may have left the arm, the hand and the cube anywhere."""
        self._live = live
        self._camera = camera
        self._signals = signals
        self._processes = processes

    def run(self, grade: str) -> Run:
        """Run one job and watch it. Raises Interrupted where the user ends the demo: the job is cancelled then."""
        if self._failed:
            self._clean_up()
        samples = self._monitor.newest.samples
        self._camera.poll()
        self._camera.trace = Trace()
        samples.clear()
        self._live.job(grade)
        started_s = perf_counter()
        outcome = self._picker.pick(grade, self._live.phase, self.look)
        duration_s = perf_counter() - started_s
        at, between = _errors(samples, self._camera.trace)
        where = self._rest()
        success = outcome.success and where == grade.strip().upper()
        self._failed = not success
        self._live.done(grade, where, success, outcome.message)
        return Run(grade, success, where, duration_s, outcome.message, at, between)

    def _clean_up(self) -> None:
        """Open the hand and bring the arm home. A cube that is not on the stand is laid there as the arm sets out."""
        for _ in range(HOMING_TRIES):
            self._live.say("the arm opens its hand and goes home")
            outcome = self._homing.home(self.look)
            self._look_on()
            self.idle(REST_S)
            if outcome.reached:
                return
            self._live.say(f"it did not get there: {outcome.text}")

    def idle(self, seconds: float) -> None:
        """Look on for so long without a job. Raises Interrupted if the user ends it."""
        until_s = perf_counter() + seconds
        while perf_counter() < until_s:
            self._monitor.spin(0.1)
            self._look_on()

    def wait_for_node(self, timeout_s: float) -> None:
        """Wait until the pick-place node serves its action. Raises DriverError where it does not, or Interrupted."""
        there = self._picker.wait(timeout_s, self.look)
        self._look_on()
        if not there:
            raise DriverError(f"the pick-place node offers no action within {timeout_s:.0f} s: see pick_place.log")

    def look(self) -> bool:
        """Show the newest state; whether the job shall be cancelled. Raises DriverError where a process has ended."""
        self._camera.poll()
        self._live.show(self._monitor.newest)
        self._processes.check()
        return self._signals.count > 0

    def _look_on(self) -> None:
        if self.look():
            raise Interrupted("interrupted")

    def _rest(self) -> str | None:
        """Wait for the cube to come to rest; the bin in which it does."""
        until_s = perf_counter() + REST_S
        while self._camera.bin is None and perf_counter() < until_s:
            self._monitor.spin(0.05)
            self._look_on()
        return self._camera.bin


class Camera:
    """The camera reads the emulator's feed: the cube's bin, and the joints between the cycles."""

    def __init__(self, client: WorldFeedClient, joints: Sequence[str]) -> None:
        self.bin: str | None = None
        self.trace = Trace()
        self._client = client
        self._joints = list(joints)

    def poll(self) -> None:
        """Take in all that the emulator published since the last call."""
        for publication in self._client.all():
            self.bin = publication["cube_bin"]
            for time_s, positions in publication["trace"]:
                self.trace.times_s.append(time_s)
                self.trace.positions.append(positions[: len(self._joints)])


def _errors(samples: "Sequence[Sample]", trace: Trace) -> tuple[FollowingError, FollowingError]:
    """The following errors at the cycles and between them; the samples' ROS time is brought to the trace's clock."""
    if not samples:
        return UNKNOWN, UNKNOWN
    offset_s = wall_offset_s(MonotonicClock(), time)
    stamps = np.array([sample.stamp_s for sample in samples]) - offset_s
    reference = np.array([sample.reference for sample in samples])
    velocity = np.array([sample.reference_velocity for sample in samples])
    feedback = np.array([sample.feedback for sample in samples])
    at = following_error(stamps, reference - feedback, velocity)
    return at, between_cycles(trace.times_s, trace.positions, stamps, reference, velocity)
