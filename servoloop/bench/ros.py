"""The figures of the ROS 2 surface: the arm's stack in a process of its own, and this process as its client."""

import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Final

from drivers.errors import DriverError
from servoloop.bench.figures import RosFigures, Spread, Timing
from servoloop.bench.motion import Pose, seconds_for
from servoloop.bench.ros_stack import Work
from servoloop.demo.cell import environment
from servoloop.recording.reader import RecordedRun, read_recording
from servoloop.stack.arm_folders import Arm
from servoloop.stack.pick_place import ARM
from servoloop.stack.processes import Interrupted, Processes
from servoloop.stack.robot_files import Files

if TYPE_CHECKING:
    from nodes.timing_client import Promptness

START_S: Final = 60.0
LISTEN_S: Final = 5.0
"""So long /joint_states are listened to while the arm stands."""
GOALS: Final = 10
REST_S: Final = 0.5
"""Before each: what still settles is no motion of the next goal's."""
STEP: Final = 0.1
"""Between two goals, rad or m, where a tenth of the joint's range is not less. A twentieth of it counts as motion:
three counts of an STS."""


@dataclass(frozen=True, slots=True)
class RosRun:
    """One run as it was measured, s."""

    figures: RosFigures
    ages_s: Sequence[float]
    motions_s: Sequence[float]
    late_s: Sequence[float]
    took_s: Sequence[float]


def run_ros(
    arm: Arm, files: Files, ready: Pose, lay: Pose, devices: Mapping[str, str], signals: Callable[[], int]
) -> RosRun:
    """Bring the stack up, send it goals around the ready pose, bring it down; the arm is limp again where it lay.

    ``files``: those of the arm, with slow limits. Raises DriverError with the stack's last words, Interrupted.
    """
    from nodes.timing_client import Promptness

    os.environ.update(environment())
    noted = Promptness()
    with tempfile.TemporaryDirectory(prefix="servoloop-bench-") as folder:
        places = {name: str(Path(device).absolute()) for name, device in devices.items()}
        work = Work(str(arm.folder), places, dict(lay), folder)
        with Processes(Path(folder), os.environ, signals) as stack:
            stack.start("stack", "servoloop.bench.ros_stack", str(work.write()))
            stack.wait_until(work.ready.exists, "starting the stack", START_S)
            try:
                _ask(noted, ready, lay, files, signals)
            except DriverError:
                if signals():
                    raise Interrupted("interrupted: the arm goes back to where it lay and is let go") from None
                stack.check()  # its last words say more
                raise
            if status := stack.end()["stack"]:
                words = "\n  ".join((Path(folder) / "stack.log").read_text(errors="replace").splitlines()[-12:])
                raise DriverError(f"the stack ended with status {status}, torque may still be on:\n  {words}")
        return _run(noted, read_recording(work.recording), float(files.controllers.update_rate_hz))


def _ask(noted: "Promptness", ready: Pose, lay: Pose, files: Files, signals: Callable[[], int]) -> None:
    """Listen while the arm stands at the ready pose, then send it goals beside it."""
    from nodes.client_node import client_node
    from nodes.timing_client import TimingClient

    joint = next(iter(ready))
    limits = files.limits[joint]
    step = min(STEP, 0.1 * (limits.upper - limits.lower))
    beside = {**ready, joint: ready[joint] + (step if ready[joint] < 0.5 * (limits.lower + limits.upper) else -step)}
    with client_node("servoloop_bench") as (node, executor):
        client = TimingClient(
            node, executor, list(ready), noted, ARM, moved=0.05 * step, stop=lambda: signals() > 0
        )  # fmt: skip
        client.go(list(ready.values()), seconds_for(lay, ready, files.limits))
        noted.answers_s.clear()  # this goal came upon an arm that was just let in
        noted.motions_s.clear()
        client.recording = True
        client.spin(LISTEN_S)
        period_s = 1.0 / files.controllers.update_rate_hz
        for number in range(GOALS):
            client.spin(REST_S)
            start, end = (ready, beside) if number % 2 == 0 else (beside, ready)
            client.go(list(end.values()), seconds_for(start, end, files.limits), period_s=period_s)


def _run(noted: "Promptness", recorded: RecordedRun, rate_hz: float) -> RosRun:
    late_s, took_s = recorded.late_s.tolist(), recorded.busy_s.tolist()
    periods_s = [b - a for a, b in pairwise(noted.stamps_s)]
    middle_s = median(periods_s) if periods_s else 0.0
    figures = RosFigures(
        goals=noted.goals,
        failed=noted.failed,
        goal_to_answer=Spread.of(noted.answers_s),
        goal_to_motion=Spread.of(noted.motions_s),
        joint_states_hz=round(len(periods_s) / sum(periods_s), 2) if periods_s else 0.0,
        joint_states_age=Spread.of(noted.ages_s),
        joint_states_jitter=Spread.of(abs(one - middle_s) for one in periods_s),
        loop=Timing(rate_hz, len(late_s), recorded.missed, Spread.of(late_s), Spread.of(took_s)),
    )
    return RosRun(figures, noted.ages_s, noted.motions_s, late_s, took_s)
