"""``python -m tests.servoloop.without EXTRAS [VERB …]``: run servoloop as if these extras were not installed.

EXTRAS are names of extras, separated by commas. Without VERB, each line of stdin is a command line as a JSON list. Each
one runs in a child process, and its exit status and output are printed as JSON.
"""

import json
import os
import sys
import tempfile
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

from servoloop.extras import LIBRARIES

ROS = "ros"
EXTRAS = (*LIBRARIES, ROS)
COMPILER = "llvmlite"
"""Comes with numba."""


class Hiding(MetaPathFinder):
    """Module finder that hides the modules of extras."""

    def __init__(self, extras: Sequence[str], others: Sequence[MetaPathFinder]) -> None:
        self._modules = {module for extra in extras if extra != ROS for module in LIBRARIES[extra]}
        if "sim" in extras:
            self._modules.add(COMPILER)
        self._hides_ros = ROS in extras
        self._others = tuple(others)

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if self._hides(fullname.partition(".")[0]):
            return None
        specs = (other.find_spec(fullname, path, target) for other in self._others)
        return next((spec for spec in specs if spec is not None), None)

    def _hides(self, top: str) -> bool:
        is_ros = top == "rclpy" or top.endswith(("_msgs", "_interfaces"))
        return top in self._modules or (self._hides_ros and is_ros)


def run_forked(arguments: Sequence[str]) -> tuple[int, str]:
    """Run a command in a child process that has imported the command line, and return its status and output."""
    with tempfile.TemporaryFile() as output:
        if not (child := os.fork()):
            for stream in (1, 2):
                os.dup2(output.fileno(), stream)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            sys.argv[1:] = arguments
            status = 1
            try:
                main()
                status = 0
            except SystemExit as error:
                status = error.code if isinstance(error.code, int) else int(error.code is not None)
            except BaseException:
                sys.excepthook(*sys.exc_info())
            finally:
                sys.stdout.flush()
                sys.stderr.flush()
                os._exit(status)
        _, ended = os.waitpid(child, 0)
        output.seek(0)
        return os.waitstatus_to_exitcode(ended), output.read().decode()


if __name__ == "__main__":
    sys.meta_path[:] = [Hiding(sys.argv.pop(1).split(","), sys.meta_path)]  # type: ignore[arg-type]
    from servoloop.cli import main

    if sys.argv[1:]:
        main()
    for line in () if sys.argv[1:] else sys.stdin.readlines():
        print(json.dumps(run_forked(json.loads(line))), flush=True)
