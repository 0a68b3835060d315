"""``Arm`` in real time, on virtual servos in a separate process: the contract, and programs that are terminated."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import numpy as np
import psutil
import pytest

from servoloop import Arm, ArmEndedError, ArmError
from servoloop.stack.processes import realtime_priority
from tests.api.contract import PAN, ArmContract, policy_waits_s
from tests.api.loaded_arm import FREE
from tests.conftest import once_more
from tests.pages import ROOT

pytestmark = [pytest.mark.slow, once_more]


@pytest.fixture(scope="module")
def served_arm() -> Iterator[Arm]:
    with Arm("so101") as arm:
        arm.move_to(FREE, duration=1.5)
        yield arm


class TestServedArm(ArmContract):
    """The contract of ``Arm`` in real time."""

    @pytest.fixture
    def arm(self, served_arm: Arm) -> Arm:
        return served_arm


def test_a_policy_at_fifty_hertz_loses_no_target_and_waits_at_most_a_cycle(served_arm: Arm) -> None:
    """Each target is commanded at most one cycle after the call. The measured time also includes the delay until the
    state shows the command."""
    waited_s = policy_waits_s(served_arm, 100)
    assert len(waited_s) > 30 and np.median(waited_s) < 1.2 / served_arm.rate_hz


def test_the_thread_of_the_loop_has_real_time_priority_if_the_system_grants_it(served_arm: Arm) -> None:
    with realtime_priority():
        granted = os.sched_getscheduler(0)
    (loop,) = (one.native_id for one in threading.enumerate() if one.name == "control loop")
    assert loop is not None and os.sched_getscheduler(loop) == granted
    assert os.sched_getscheduler(0) == os.sched_getscheduler(os.getpid())


def test_a_lost_bus_ends_a_waiting_program_with_the_reason() -> None:
    before = psutil.Process().children()
    arm = Arm("so101")
    motion = arm.move_to({PAN: 0.3}, duration=20.0, wait=False)
    (emulator,) = (one for one in psutil.Process().children() if one not in before)
    emulator.kill()
    with pytest.raises(ArmEndedError, match=r"the control loop has ended: .*create a new Arm"):
        motion.wait(30.0)
    with pytest.raises(ArmEndedError):
        arm.move_to({PAN: 0.0})
    with pytest.raises(ArmError, match="was not shut down completely"):
        arm.close()


PROGRAM = """
from servoloop import Arm

with Arm("so101") as arm:
    print("ready", flush=True)
    arm.move_to({"shoulder_pan": 0.5}, duration=30.0)
"""


@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, -signal.SIGINT)])
def test_a_signal_ends_a_program_by_the_rules_of_the_arm(number: signal.Signals, status: int) -> None:
    command = [sys.executable, "-c", f"import logging; logging.basicConfig(level=logging.INFO)\n{PROGRAM}"]
    program = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    try:
        assert program.stdout is not None and program.stdout.readline() == "ready\n"
        time.sleep(1.0)
        program.send_signal(number)
        _, log = program.communicate(timeout=60)
    finally:
        program.kill()
    assert program.returncode == status, log
    assert re.search(r"^INFO:servoloop.controller:.*\bhold", log, re.MULTILINE), log
