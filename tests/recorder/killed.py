"""A program that records a simulated stack until it is killed: ``python -m tests.recorder.killed FILE``.

It prints the number of cycles that the recorder's thread has handed to the system, each time that it has.
"""

import sys
from pathlib import Path

from servoloop.recording.recorder import Recorder, RecordingFile
from servoloop.recording.sampler import CycleSample
from tests.recorder.rig import Rig


class Telling(RecordingFile):
    """A file that prints how many cycles are safe."""

    cycles = 0

    def write(self, sample: CycleSample) -> None:
        super().write(sample)
        self.cycles += 1

    def flush(self) -> None:
        super().flush()
        print(self.cycles, flush=True)


def main() -> None:
    rig = Rig()
    recorder = Recorder(rig.sampler, rig.taps, [Telling(Path(sys.argv[1]), rig.messages)])
    rig.stack.on_state = recorder.post
    while True:
        rig.run(1.0)
        recorder.drain()


main()
