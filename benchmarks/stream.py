"""Measure the latency of streamed targets, from the call to the bytes on the bus: ``python -m benchmarks.stream
[--seconds 60] [--rate 50]``.

A stack without ROS runs at 20 Hz with virtual servos in separate processes and records every byte on the bus. This
program stands in for a policy: it sends a new target at each step, as ``Arm.connect().stream()`` does. A target counts
as late if neither this target nor a later one is among the goals on the bus after one cycle. A target counts as lost if
it never reaches the bus.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from mcap.reader import make_reader
from rich.console import Console
from rich.table import Table

from benchmarks.command_socket import started_stack
from benchmarks.shared.arguments import in_words, positive
from drivers.clock import MonotonicClock, wall_offset_s
from hal.types import FloatArray
from servoloop import Arm
from servoloop.recording.mcap_messages import COMMANDS
from servoloop.recording.message_types import typestore
from servoloop.recording.reader import stamp_s

JOINT: Final = "joint6"
STEP_RAD: Final = 4e-4
"""Difference between two consecutive targets. The joint reaches each target within one cycle."""
TRAFFIC: Final = "/servoloop/bus_traffic"
GROUP_WRITE: Final = b"\xff\xff\xfe"
CODE_AT, SYNC_WRITE = 4, 0x83
MAX_AGE_S: Final = 1.0
AFTER_S: Final = 0.3
"""Duration of the recording after the last target, in seconds."""


@dataclass(frozen=True, slots=True)
class Streamed:
    """Targets of one run, with times in seconds on the clock that recordings on this machine use."""

    targets: FloatArray
    """Targets (k,), in rad."""
    called_s: FloatArray
    """Times (k,) of the calls."""
    answered_s: FloatArray
    """Times (k,) at which the calls returned."""
    period_s: float
    """Period of the control loop, in seconds."""


def stream(seconds: int, rate_hz: int) -> Streamed:
    """Stream targets to the running stack at a given rate."""
    clock, count = MonotonicClock(), seconds * rate_hz
    offset_s = wall_offset_s(clock, time.time)
    called, answered = np.empty(count), np.empty(count)
    arm = Arm.connect()
    try:
        first = arm.state.command[JOINT]
        targets = first - np.sign(first or 1.0) * STEP_RAD * np.arange(1, count + 1)
        with arm.stream(max_age=MAX_AGE_S) as policy:
            begun_s = clock.now()
            for number, target in enumerate(targets.tolist()):
                clock.sleep_until(begun_s + number / rate_hz)
                called[number] = clock.now()
                policy.send({JOINT: target})
                answered[number] = clock.now()
            arm.sleep(AFTER_S)
        return Streamed(targets, called + offset_s, answered + offset_s, 1.0 / arm.rate_hz)
    finally:
        arm.close()


def goals_on_the_bus(recording: Path, joint: str = JOINT) -> Iterator[tuple[float, float]]:
    """For each command to a joint, yield the time of the group write that sends it, in seconds, and the command, in
    rad."""
    decode, commanded = typestore().deserialize_cdr, list[tuple[float, float]]()
    writes = list[float]()
    with recording.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(topics=[COMMANDS, TRAFFIC]):
            content: Any = decode(message.data, schema.name) if schema else None
            if channel.topic == COMMANDS:
                commanded.append((stamp_s(content), float(content.position[list(content.name).index(joint)])))
            elif content.sent and _is_group_write(bytes(content.data)):
                writes.append(stamp_s(content))
    times, at = np.sort(np.array(writes)), sorted(commanded)
    for stamp, command in at:
        if (place := int(np.searchsorted(times, stamp))) < len(times):
            yield float(times[place]), command


def _is_group_write(data: bytes) -> bool:
    return data.startswith(GROUP_WRITE) and len(data) > CODE_AT and data[CODE_AT] == SYNC_WRITE


def latencies_s(streamed: Streamed, goals: Iterator[tuple[float, float]]) -> FloatArray:
    """Return the time from each call until its target or a later target is on the bus, (k,) in seconds; NaN if this
    never happens."""
    way = np.sign(streamed.targets[-1] - streamed.targets[0])
    written = np.array([(time_s, way * command) for time_s, command in goals])
    reached = np.maximum.accumulate(written[:, 1])
    places = np.searchsorted(reached, way * streamed.targets - STEP_RAD / 2.0)
    times = np.append(written[:, 0], np.nan)
    found: FloatArray = times[places] - streamed.called_s
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("--seconds", type=positive, default=60, help="duration of the stream")
    parser.add_argument("--rate", type=positive, default=50, help="targets per second")
    options = parser.parse_args()
    table = Table("", "median, ms", "99 %, ms", "longest, ms", title=f"a stream at {options.rate} Hz")
    with in_words(), tempfile.TemporaryDirectory(prefix="bench") as folder:
        recording = Path(folder) / "run.mcap"
        with started_stack("--record", str(recording)):
            streamed = stream(options.seconds, options.rate)
        latency_s = latencies_s(streamed, goals_on_the_bus(recording))
    known = latency_s[np.isfinite(latency_s)]
    for name, values in (("call to reply", streamed.answered_s - streamed.called_s), ("call to bytes", known)):
        figures = (np.median(values), np.percentile(values, 99.0), values.max())
        table.add_row(name, *(f"{1e3 * figure:.2f}" for figure in figures))
    console = Console()
    console.print(table)
    late, lost = int((known > streamed.period_s).sum()), len(latency_s) - len(known)
    cycle = f"one cycle of {1e3 * streamed.period_s:g} ms"
    console.print(f"{len(latency_s)} targets; {late} later than {cycle}; {lost} lost", highlight=False)


if __name__ == "__main__":
    main()
