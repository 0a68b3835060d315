"""A running stack is monitored in a terminal and recorded by programs that start later."""

import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from sim_backend.control import ask, control_path
from tests.live.rig import runtime_folder
from tests.monitor.terminal import in_terminal
from tests.monitor.test_docs import LIVE
from tests.recorder.reading import by_mcap, stamp_s
from tests.ros.stack_process import PICK, arm_client, emulating, running

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]


@contextmanager
def recording() -> "Iterator[subprocess.Popen[str]]":
    """Run a program that writes a recording into a folder, and end it after the block in all cases."""
    record = [sys.executable, "-m", "servoloop", "record", "run.mcap"]
    with subprocess.Popen(record, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as recorder:
        try:
            yield recorder
        finally:
            recorder.kill()


@pytest.mark.runs(LIVE)
def test_running_stack_is_monitored_and_recorded_until_its_end(
    ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with (
        runtime_folder(monkeypatch),
        emulating(tmp_path) as link,
        running(tmp_path, "--port", str(link)) as stack,
        in_terminal(*shlex.split(LIVE)[1:], folder=tmp_path) as terminal,
        recording() as recorder,
    ):
        terminal.wait_for("robot_arm: live", "joint6", "arm_controller", " V")
        assert recorder.stderr is not None and "Recording robot_arm" in recorder.stderr.readline()
        with arm_client() as client:
            client.wait(client.send(PICK))
        terminal.wait_for(f"{np.degrees(PICK[5]):.1f}", "succeeded")
        ask(control_path(link), {"do": "fault", "text": "silent id=3"})
        terminal.wait_for("servo 3 does not respond")
        assert stack.end() == 0
        terminal.wait_for("the stack has stopped. Waiting for it to restart")
        terminal.process.send_signal(signal.SIGTERM)
        assert terminal.process.wait(30.0) == 0 and terminal.restored
        said, _ = recorder.communicate(timeout=30.0)
        assert recorder.returncode == 0
    messages = by_mcap(tmp_path / "run.mcap")
    stamps = [stamp_s(message) for message in messages["/joint_states"]]
    assert f"run.mcap: {len(stamps)} cycles in {stamps[-1] - stamps[0]:.1f} s; the stack has ended\n" == said
    numbers = [cycle.number for cycle in messages["/servoloop/cycles"]]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers))), "no cycle is missing"
    (result,) = messages["/arm_controller/goal_result"]
    assert result.status == "succeeded"
