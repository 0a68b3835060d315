"""Measure the latency of a stack below ros2_control: ``python -m benchmarks.topic_host [--arm so101] [--seconds 60]``.

``servoloop topic-host`` runs with virtual servos in a separate process and records every byte on the bus. This process
stands in for the plugin JointStateTopicSystem: it sends new commands over DDS at the given rate. The table shows the
time from a command to its bytes on the bus, and the time from a reply's last byte to the state message. A command
counts as late if neither this command nor a later one is on the bus after one cycle. A command counts as lost if it
never reaches the bus.
"""

import argparse
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from mcap.reader import make_reader
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rich.console import Console
from rich.table import Table
from sensor_msgs.msg import JointState

from benchmarks.shared.arguments import in_words, positive
from benchmarks.stream import STEP_RAD, TRAFFIC, Streamed, goals_on_the_bus, latencies_s
from drivers.driver_errors import DriverError
from hal.types import FloatArray
from nodes.clients.client_node import client_node
from nodes.discovery import stay_on_this_machine
from nodes.topic_host.topics import COMMANDS, STATES
from servoloop.recording.message_types import typestore
from servoloop.recording.reader import stamp_s
from servoloop.stack.processes import claim_realtime_priority, end, end_with_parent

PATIENCE_S: Final = 60.0
JOINTS: Final = {"so101": "wrist_roll", "robot_arm": "joint6"}
"""Joint of each arm that moves during the benchmark. The joint's range is large enough for a one-minute stream."""
AFTER_S: Final = 0.5
"""Duration of the recording after the last command, in seconds."""


@contextmanager
def host(arm: str, rate_hz: int, recording: Path) -> Iterator[None]:
    """Run ``servoloop topic-host`` in a separate ROS domain until the context ends. The host is ready for commands when
    the context begins."""
    settings = {"ROS_DOMAIN_ID": str(random.randint(1, 100))}
    stay_on_this_machine(settings)
    os.environ |= settings  # this also applies to this process's own node
    ready = recording.with_name("ready")
    command = [sys.executable, "-m", "servoloop", "topic-host", "--arm", arm, "--rate", str(rate_hz)]
    command += ["--record", str(recording), "--ready-file", str(ready)]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL, preexec_fn=end_with_parent)
    try:
        deadline_s = time.monotonic() + PATIENCE_S
        while not ready.exists():
            if process.poll() is not None or time.monotonic() > deadline_s:
                raise DriverError("the host did not start: run `servoloop topic-host`")
            time.sleep(0.05)
        yield
    finally:
        end(process)


class Plugin:
    """Stand-in for the plugin, which sends commands and records when states arrive. All times are system clock times,
    in seconds."""

    def __init__(self, joint: str, rate_hz: int) -> None:
        self.joint = joint
        self.period_s = 1.0 / rate_hz
        self.states: list[tuple[float, float]] = []
        """Stamp and arrival time of each state."""
        self.newest: JointState | None = None

    def on_state(self, message: JointState) -> None:
        """Record the arrival of a state."""
        self.states.append((stamp_s(message), time.time()))
        self.newest = message

    def stream(self, seconds: int) -> Streamed:
        """Send commands for ``seconds`` seconds. Each command is one step away from the previous one."""
        with client_node("benchmark") as (node, executor):
            node.create_subscription(JointState, STATES, self.on_state, qos_profile_sensor_data)
            publisher = node.create_publisher(JointState, COMMANDS, QoSProfile(depth=1))

            def spin(until_s: float) -> None:
                while (left_s := until_s - time.time()) > 0.0:
                    executor.spin_once(timeout_sec=left_s)

            deadline_s = time.time() + PATIENCE_S
            while (first := self.newest) is None or not publisher.get_subscription_count():
                if time.time() > deadline_s:
                    raise DriverError(f"no state arrives on {STATES}")
                spin(time.time() + 0.1)
            names, here = list(first.name), list(first.position)
            place, count = names.index(self.joint), round(seconds / self.period_s)
            targets = here[place] - np.sign(here[place] or 1.0) * STEP_RAD * np.arange(1, count + 1)
            called = np.empty(count)
            begun_s = time.time()
            for number, target in enumerate(targets.tolist()):
                spin(begun_s + number * self.period_s)
                here[place] = target
                command = JointState(name=names, position=here)
                called[number] = time.time()
                publisher.publish(command)
            spin(time.time() + AFTER_S)
        return Streamed(targets, called, called, self.period_s)


def replies_s(recording: Path) -> FloatArray:
    """Return the times (k,) at which reply bytes arrived, in seconds."""
    decode = typestore().deserialize_cdr
    with recording.open("rb") as file:
        found: list[Any] = [
            decode(message.data, schema.name)
            for schema, _, message in make_reader(file).iter_messages(topics=[TRAFFIC])
            if schema
        ]
    return np.sort(np.array([stamp_s(content) for content in found if not content.sent]))


def state_ages_s(states: FloatArray, replies: FloatArray, period_s: float) -> FloatArray:
    """Return the time from the last reply of each measurement to the arrival of its state, (k,) in seconds.

    Args:
        states: Stamp and arrival time of each state, (k, 2) in seconds.
        replies: Times at which replies arrived, in seconds.
        period_s: Period of the control loop, in seconds.
    """
    last = np.searchsorted(replies, states[:, 0] + 0.5 * period_s) - 1
    ages: FloatArray = states[:, 1] - replies[np.maximum(last, 0)]
    return ages


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("--arm", choices=JOINTS, default="so101", help="arm with virtual servos")
    parser.add_argument("--seconds", type=positive, default=60, help="duration of the command stream")
    parser.add_argument("--rate", type=positive, default=100, help="command rate, and cycle rate of the host, in Hz")
    options = parser.parse_args()
    claim_realtime_priority()
    plugin = Plugin(JOINTS[options.arm], options.rate)
    with in_words(), tempfile.TemporaryDirectory(prefix="bench") as folder:
        recording = Path(folder) / "run.mcap"
        with host(options.arm, options.rate, recording):
            streamed = plugin.stream(options.seconds)
        to_bytes = latencies_s(streamed, goals_on_the_bus(recording, plugin.joint))
        to_topic = state_ages_s(np.array(plugin.states), replies_s(recording), streamed.period_s)
    known = to_bytes[np.isfinite(to_bytes)]
    if not known.size:
        raise SystemExit("no command reached the bus")
    title = f"topic-host of {options.arm} at {options.rate} Hz over DDS"
    table = Table("", "median, ms", "99 %, ms", "longest, ms", title=title)
    for name, values in (("command topic to bytes", known), ("bytes to state topic", to_topic)):
        figures = (np.median(values), np.percentile(values, 99.0), values.max())
        table.add_row(name, *(f"{1e3 * figure:.2f}" for figure in figures))
    console = Console()
    console.print(table)
    late, lost = int((known > streamed.period_s).sum()), len(to_bytes) - len(known)
    cycle = f"one cycle of {1e3 * streamed.period_s:g} ms"
    console.print(f"{len(to_bytes)} commands; {late} later than {cycle}; {lost} lost", highlight=False)


if __name__ == "__main__":
    main()
