"""Environment with LeRobot and the CPU build of torch, installed once into ``build/``."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

from tests.pages import ROOT

VERSION: Final = "0.6.1"
"""Version of LeRobot that the tests install."""
GIVEN: Final = "SERVOLOOP_LEROBOT"
"""Variable with the folder of an environment that already has LeRobot."""
INSTALL_S: Final = 600.0
"""Maximum time to install LeRobot, in seconds."""


def lerobot_environment() -> Path:
    """Return the folder of an environment with LeRobot. The test is skipped if LeRobot cannot be installed."""
    if given := os.environ.get(GIVEN):
        return Path(given).resolve()
    folder = ROOT / "build" / f"lerobot-{VERSION}"
    complete = folder / "complete"
    if not complete.exists():
        _uv("venv", "--clear", "--python", ">=3.12,<3.14", str(folder))
        install = ("pip", "install", "--python", str(folder / "bin" / "python"))
        wanted = f"lerobot[dataset,dynamixel,hardware]=={VERSION}"
        if _failure(*install, "--torch-backend", "cpu", wanted):
            _uv(*install, wanted)  # the package index of this machine may have the CPU build itself
        complete.touch()
    return folder


def _uv(*arguments: str) -> None:
    if reason := _failure(*arguments):
        pytest.skip(f"LeRobot cannot be installed, and {GIVEN} names no environment that has it: {reason}")


def _failure(*arguments: str) -> str:
    """Run uv, and return its error; an empty string if it succeeded."""
    command = [str(Path(sys.executable).parent / "uv"), "--quiet", *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=INSTALL_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    return done.stderr or "uv failed" if done.returncode else ""
