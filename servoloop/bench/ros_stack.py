"""``python -m servoloop.bench.ros_stack WORK``: the stack of a bench, as ``servoloop up`` runs it, but slow."""

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final, Self

from servoloop.bench.motion import slow
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.hardware import HardwareKind
from servoloop.stack.terminal import log_to_terminal

WORK: Final = "work.json"


@dataclass(frozen=True, slots=True)
class Work:
    """What the stack is told."""

    arm: str
    """The arm's folder."""
    devices: dict[str, str]
    lay: dict[str, float]
    """Where the arm lay: there it goes in the end, to be let go."""
    folder: str
    """For what it leaves behind."""

    @property
    def ready(self) -> Path:
        """Is there once goals are taken."""
        return Path(self.folder) / "ready"

    @property
    def recording(self) -> Path:
        """What the loop did."""
        return Path(self.folder) / "run.mcap"

    def write(self) -> Path:
        """Write it down for the stack's process."""
        path = Path(self.folder) / WORK
        path.write_text(json.dumps(asdict(self)))
        return path

    @classmethod
    def read(cls, path: Path) -> Self:
        """What was written."""
        return cls(**json.loads(path.read_text()))


def main(work: Work) -> int:
    """Run the stack until SIGTERM."""
    from servoloop.up import UpOptions, up

    log_to_terminal()
    files = slow(read_arm_files(find_arm(work.arm)), back_to=work.lay)

    def ready(what: str) -> None:
        work.ready.write_text(what)

    return up(HardwareKind.SERVOS, work.devices, files, ready, UpOptions(record=work.recording))


if __name__ == "__main__":
    raise SystemExit(main(Work.read(Path(sys.argv[1]))))
