"""``python -m servoloop.bench.ros_stack WORK``: run the stack as ``servoloop up`` does, with reduced velocities."""

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
class RosWork:
    """Parameters of the stack process."""

    arm: str
    """Folder of the arm."""
    devices: dict[str, str]
    """Serial device of each bus, keyed by bus name."""
    lay: dict[str, float]
    """Initial pose, to which the arm returns before its torque is disabled."""
    folder: str
    """Folder for the stack's output."""

    @property
    def ready(self) -> Path:
        """File that is created when the stack starts to accept goals."""
        return Path(self.folder) / "ready"

    @property
    def recording(self) -> Path:
        """Recording made by the stack."""
        return Path(self.folder) / "run.mcap"

    def write(self) -> Path:
        """Write the parameters to a file for the stack process, and return its path."""
        path = Path(self.folder) / WORK
        path.write_text(json.dumps(asdict(self)))
        return path

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read the parameters from a file."""
        return cls(**json.loads(path.read_text()))


def main(work: RosWork) -> int:
    """Run the stack until SIGTERM."""
    from servoloop.up import up
    from servoloop.up_options import UpOptions

    log_to_terminal()
    files = slow(read_arm_files(find_arm(work.arm)), back_to=work.lay)

    def ready(text: str) -> None:
        work.ready.write_text(text)

    return up(HardwareKind.SERVOS, work.devices, files, ready, UpOptions(record=work.recording))


if __name__ == "__main__":
    raise SystemExit(main(RosWork.read(Path(sys.argv[1]))))
