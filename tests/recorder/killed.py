"""Record a simulated stack until the program is killed: ``python -m tests.recorder.killed FILE``.

After each flush, the program prints the number of flushed cycles.
"""

import sys
from pathlib import Path

from servoloop.recording.recorder import Recorder, RecordingFile
from servoloop.recording.sampler import CycleSample
from tests.recorder.rig import Rig


class Telling(RecordingFile):
    """Recording that prints the number of flushed cycles."""

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
