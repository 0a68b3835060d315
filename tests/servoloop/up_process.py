"""``servoloop up`` without ROS in a separate process."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.servoloop.served import eventually


@contextmanager
def running_up(folder: Path, *arguments: str) -> Iterator["subprocess.Popen[bytes]"]:
    """Run ``servoloop up`` from its first goal to the end of the block. The log is ``up.log`` in the folder."""
    ready, log = folder / f"ready{len(list(folder.iterdir()))}", folder / "up.log"
    with log.open("ab") as output:
        command = [sys.executable, "-m", "servoloop", "up", *arguments, "--ready-file", str(ready)]
        process = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)
    try:
        eventually(lambda: ready.exists() or process.poll() is not None, 60.0)
        assert process.poll() is None, log.read_text()
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(60.0)
