"""The first start of virtual servos compiles the simulation, which may take minutes on a slow machine."""

import subprocess
import sys

import pytest

from drivers.driver_errors import DriverError
from servoloop.stack import emulator_process
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.emulator_process import START_S, virtual_servos


def test_the_first_start_may_take_minutes() -> None:
    assert START_S >= 300.0


def test_an_emulator_that_never_serves_is_ended_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    sleeping = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])

    monkeypatch.setattr(emulator_process, "START_S", 0.1)
    monkeypatch.setattr(subprocess, "Popen", lambda command, **options: sleeping)
    with (
        pytest.raises(DriverError, match=r"not ready within 0\.1 s: stop other programs .*, then start"),
        virtual_servos(read_arm_files(find_arm("so101"))),
    ):
        pass
    assert sleeping.returncode is not None
