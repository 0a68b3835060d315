"""Run the perception node with the virtual camera: ``python -m servoloop.demo.camera_process LINK SCENE``.

The process has a lower priority than the control loop, so that rendering and grading do not delay a cycle.
"""

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from drivers.clock import MonotonicClock
from hal.hal_errors import HalError
from servoloop.virtual_camera import VirtualCamera

NICE: Final = 5
"""Nice value of the process."""


def main(arguments: Sequence[str]) -> int:
    """Grade the emulator's apples until a signal ends the process, and return the exit status."""
    from nodes.perception.process import run_source

    os.setpriority(os.PRIO_PROCESS, 0, NICE)
    program, link, scene, *rest = arguments
    try:
        camera = VirtualCamera(Path(link), Path(scene), MonotonicClock())
        return run_source(camera, camera.view, camera.settings, (program, *rest))
    except HalError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv))
