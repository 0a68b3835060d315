"""``servoloop view`` in a separate process."""

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

PATIENCE_S = 60.0


@contextmanager
def viewing(*arguments: str) -> Iterator[str]:
    """Yield the address of the page. At the end of the block, a signal must end the program without an error."""
    command = [sys.executable, "-u", "-m", "servoloop", "view", "--no-browser", "--port", "0", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        try:
            assert process.stdout is not None
            words = process.stdout.readline()
            address = re.search(r"the page is at (\S+)", words)
            assert address is not None, words + process.stdout.read()
            yield address[1]
        finally:
            process.terminate()
            status = process.wait(PATIENCE_S)
    assert status == 0
