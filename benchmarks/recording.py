"""Measure the cost of a recording: ``python -m benchmarks.recording [--json] [--seconds 30]``.

Half a minute of an arm that moves in simulated time is sampled, and the samples are then written as in the recorder
thread. Only the processor time of these two steps is measured.
"""

import argparse
import json
import tempfile
from pathlib import Path
from time import process_time, thread_time
from typing import Any

from hal.types import JointState
from pick_place.settings import JobSettings
from servoloop.recording.bus_tap import BusTaps
from servoloop.recording.messages import Messages
from servoloop.recording.recorder import FLUSH_S, RecordingFile
from servoloop.recording.sampler import CycleSample, Sampler
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.robot_files import servo_ids

BEGIN_S = 3.0


class Sampled:
    """Simulated stack whose cycles are sampled, and the processor time spent on sampling, in seconds."""

    def __init__(self) -> None:
        self.stack = SimulatedStack()
        self.samples: list[CycleSample] = []
        self.sampling_s = 0.0
        taps = BusTaps()
        self.stack.tap = lambda port: taps.tap(port, self.stack.clock)
        self._sampler = Sampler(self.stack.loop, "robot_arm", servo_ids(self.stack.files), taps)
        self.stack.on_state = self._on_state
        self.stack.up()

    def run(self, seconds: float) -> None:
        """Move the arm back and forth for the given duration."""
        settings = JobSettings()
        self.stack.run(BEGIN_S)
        end_s = self.stack.clock.now() + seconds
        while self.stack.clock.now() < end_s:
            for pose in (settings.pick_rad, settings.ready_rad):
                self.stack.go(pose)
                self.stack.run(min(BEGIN_S, max(0.0, end_s - self.stack.clock.now())))

    def _on_state(self, state: JointState) -> None:
        begun_s = thread_time()
        self.samples.append(self._sampler.sample(state))
        self.sampling_s += thread_time() - begun_s


def measure(seconds: float, folder: Path) -> dict[str, float]:
    """Return the results for a recording of this duration, keyed by name. The names include the units."""
    sampled = Sampled()
    sampled.run(seconds)
    stack, samples = sampled.stack, sampled.samples
    hardware = stack.loop.hardware
    messages = Messages(stack.files.description, hardware.joints, hardware.command_interfaces, 0.0)
    file = RecordingFile(folder / "bench.mcap", messages)
    file.write(samples[0])  # writes the schemas and other one-time values
    file.flush()
    chunk = max(1, round(FLUSH_S / stack.loop.period_s))
    begun_s = process_time()
    for number, sample in enumerate(samples[1:], 1):
        file.write(sample)
        if number % chunk == 0:
            file.flush()
    file.close()
    cycles = len(samples) - 1
    writing_s, sampling_s = (process_time() - begun_s) / cycles, sampled.sampling_s / len(samples)
    return {
        "cycles": cycles,
        "sampling_us": sampling_s * 1e6,
        "writing_us": writing_s * 1e6,
        "core_percent": 100.0 * (sampling_s + writing_s) / stack.loop.period_s,
        "bytes_per_cycle": file.path.stat().st_size / cycles,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--seconds", type=float, default=30.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        figures: dict[str, Any] = measure(arguments.seconds, Path(folder))
    if arguments.json:
        print(json.dumps({name: round(value, 3) for name, value in figures.items()}))
    else:
        print(
            f"{figures['cycles']} cycles; each takes {figures['sampling_us']:.0f} µs in the loop thread, "
            f"{figures['writing_us']:.0f} µs in the recorder thread, {figures['core_percent']:.2f} % of a core and "
            f"{figures['bytes_per_cycle']:.0f} bytes"
        )


if __name__ == "__main__":
    main()
