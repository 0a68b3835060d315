"""Simulated stack with a sampler and the other parts of a recording."""

from collections.abc import Sequence
from pathlib import Path

from hal.types import JointState
from servoloop.recording.bus_tap import BusTaps
from servoloop.recording.messages import Messages
from servoloop.recording.recorder import RecordingFile
from servoloop.recording.sampler import CycleSample, Sampler
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.robot_files import servo_ids
from tests.stack.rig import READY


class Rig:
    """Active stack at rest. ``samples`` contains all cycles of the stack."""

    def __init__(self, start: Sequence[float] = READY) -> None:
        self.stack = SimulatedStack(start=(*start, 0.0), keep_alive=True)
        self.taps = BusTaps()
        self.stack.tap = lambda port: self.taps.tap(port, self.stack.clock)
        self.sampler = Sampler(self.stack.loop, "robot_arm", servo_ids(self.stack.files), self.taps)
        self.samples: list[CycleSample] = []
        self.stack.on_state = self._on_state
        hardware, description = self.stack.loop.hardware, self.stack.files.description
        self.messages = Messages(description, hardware.joints, hardware.command_interfaces, 0.0)
        self.stack.up()

    def run(self, seconds: float) -> list[CycleSample]:
        """Run for a given time, and return the cycles of that time."""
        begun = len(self.samples)
        self.stack.run(seconds)
        return self.samples[begun:]

    def record(self, path: Path) -> Path:
        """Write all cycles so far to a file."""
        file = RecordingFile(path, self.messages)
        for sample in self.samples:
            file.write(sample)
        file.close()
        return path

    def _on_state(self, state: JointState) -> None:
        self.samples.append(self.sampler.sample(state))
