"""Measure the ROS 2 interface: the arm's stack runs in its own process, and this process is its client."""

import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Final

from drivers.driver_errors import DriverError
from servoloop.bench.figures import Distribution, RosFigures, Timing
from servoloop.bench.motion import BACK, Pose, seconds_for
from servoloop.bench.ros_stack import RosWork
from servoloop.recording.reader import RecordedRun, read_recording
from servoloop.stack.arm_folders import ArmFolder
from servoloop.stack.processes import Interrupted, Processes, choose_ros_domain
from servoloop.stack.robot_files import Files

if TYPE_CHECKING:
    from nodes.clients.timing_client import Promptness

START_S: Final = 60.0
LISTEN_S: Final = 5.0
"""Duration for which /joint_states is recorded while the arm is at rest, in seconds."""
GOALS: Final = 10
"""Number of goals to send."""
REST_S: Final = 0.5
"""Time at rest before each goal, in seconds, so that settling is not measured as motion."""
STEP: Final = 0.1
"""Distance between two goals, in rad or m; at most a tenth of the joint's range.

A change of a twentieth of this distance, which is three counts of an STS servo, counts as motion.
"""


@dataclass(frozen=True, slots=True)
class RosRun:
    """Results of the ROS measurement, and the measured times from which they were computed, in seconds."""

    figures: RosFigures
    ages_s: Sequence[float]
    motions_s: Sequence[float]
    late_s: Sequence[float]
    took_s: Sequence[float]


def run_ros(
    arm: ArmFolder, files: Files, ready: Pose, lay: Pose, devices: Mapping[str, str], signals: Callable[[], int]
) -> RosRun:
    """Start the stack, send it goals near the ready pose, and shut it down.

    At the end, the arm is in its initial pose with its torque off.

    Args:
        arm: The arm.
        files: Files of the arm, with reduced velocity limits.
        ready: Ready pose of the arm, in its controller's joint order.
        lay: The robot's initial pose.
        devices: Serial device of each bus, keyed by bus name.
        signals: Function that returns the number of signals received.

    Raises:
        DriverError: The stack failed. The message contains the stack's last output.
        Interrupted: A signal was received.
    """
    from nodes.clients.timing_client import Promptness

    choose_ros_domain()
    noted = Promptness()
    with tempfile.TemporaryDirectory(prefix="servoloop-bench-") as folder:
        places = {name: str(Path(device).absolute()) for name, device in devices.items()}
        work = RosWork(str(arm.folder), places, dict(lay), folder)
        with Processes(Path(folder), os.environ, signals) as stack:
            stack.start("stack", "servoloop.bench.ros_stack", str(work.write()))
            stack.wait_until(work.ready.exists, "starting the stack", START_S)
            try:
                _send_goals(noted, ready, lay, files, signals)
            except DriverError:
                if signals():
                    raise Interrupted(f"interrupted; {BACK}") from None
                stack.check()  # If the stack has exited, its output explains the failure better.
                raise
            if status := stack.end()["stack"]:
                output = "\n  ".join((Path(folder) / "stack.log").read_text(errors="replace").splitlines()[-12:])
                raise DriverError(f"the stack exited with status {status}; torque may still be on:\n  {output}")
        return _run(noted, read_recording(work.recording), float(files.controllers.update_rate_hz))


def _send_goals(noted: "Promptness", ready: Pose, lay: Pose, files: Files, signals: Callable[[], int]) -> None:
    """Record /joint_states at rest in the ready pose, then send goals near this pose."""
    from nodes.clients.client_node import client_node
    from nodes.clients.timing_client import TimedController, TimingClient

    joint = next(iter(ready))
    limits = files.limits[joint]
    step = min(STEP, 0.1 * (limits.upper - limits.lower))
    beside = {**ready, joint: ready[joint] + (step if ready[joint] < 0.5 * (limits.lower + limits.upper) else -step)}
    with client_node("servoloop_bench") as (node, executor):
        controller = TimedController(list(ready), _controller_of(ready, files), moved=0.05 * step)
        client = TimingClient(node, executor, controller, noted, stop=lambda: signals() > 0)
        client.go(list(ready.values()), seconds_for(lay, ready, files.limits))
        noted.answers_s.clear()  # the first goal after the start is not representative
        noted.motions_s.clear()
        client.recording = True
        client.spin(LISTEN_S)
        period_s = 1.0 / files.controllers.update_rate_hz
        for number in range(GOALS):
            client.spin(REST_S)
            start, end = (ready, beside) if number % 2 == 0 else (beside, ready)
            client.go(list(end.values()), seconds_for(start, end, files.limits), period_s=period_s)


def _controller_of(pose: Pose, files: Files) -> str:
    """Return the name of the controller that drives the joints of a pose. Raises DriverError."""
    for spec in files.controllers.controllers:
        if tuple(getattr(spec.parameters, "joints", ())) == tuple(pose):
            return spec.name
    raise DriverError(f"{files.controllers.path} has no controller for {', '.join(pose)}: add a controller")


def _run(noted: "Promptness", recorded: RecordedRun, rate_hz: float) -> RosRun:
    late_s, took_s = recorded.late_s.tolist(), recorded.busy_s.tolist()
    periods_s = [b - a for a, b in pairwise(noted.stamps_s)]
    middle_s = median(periods_s) if periods_s else 0.0
    figures = RosFigures(
        goals=noted.goals,
        failed=noted.failed,
        goal_to_answer=Distribution.of(noted.answers_s),
        goal_to_motion=Distribution.of(noted.motions_s),
        joint_states_hz=round(len(periods_s) / sum(periods_s), 2) if periods_s else 0.0,
        joint_states_age=Distribution.of(noted.ages_s),
        joint_states_jitter=Distribution.of(abs(one - middle_s) for one in periods_s),
        loop=Timing(rate_hz, len(late_s), recorded.missed, Distribution.of(late_s), Distribution.of(took_s)),
    )
    return RosRun(figures, noted.ages_s, noted.motions_s, late_s, took_s)
