"""``servoloop plot``: values of a recording, and the page that shows them."""

import contextlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from typer.testing import CliRunner

from pick_place.settings import JobSettings
from servoloop.cli import app
from servoloop.recording.mcap import RecordingError
from servoloop.recording.reader import RecordedRun, read_recording
from servoloop.recording.recorder import RecordingFile
from servoloop.simulation.schedule import Schedule
from servoloop.simulation.simulate import simulate
from servoloop.stack.robot_files import read_files
from sim_backend.faults.text import parse
from tests.complaint import complaint
from tests.recorder.reading import by_rosbags
from tests.recorder.rig import Rig


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record a job in which a servo is silent for some time."""
    path = tmp_path_factory.mktemp("recording") / "run.mcap"
    schedule = Schedule(seed=1, job=("B",), faults=(parse("silent id=3 at=4s for=0.3s"),))
    simulate(read_files(), {"": JobSettings()}, schedule, record=path)
    return path


@pytest.fixture(scope="module")
def run(recording: Path) -> RecordedRun:
    return read_recording(recording)


def test_plot_has_every_cycle_of_the_recording(recording: Path, run: RecordedRun) -> None:
    states = by_rosbags(recording)["/joint_states"]
    assert run.joints == tuple(states[0].name) and len(run.time_s) == len(states)
    np.testing.assert_array_equal(run.position, [state.position for state in states])
    assert run.time_s[0] == 0.0 and np.all(np.diff(run.time_s) > 0.0)
    assert run.command.shape == run.position.shape and np.isfinite(run.command[-1]).all()
    assert run.missed == 0 and len(run.late_s) == len(run.busy_s) == len(run.time_s) - 1


def test_faults_and_goal_results_have_times(run: RecordedRun) -> None:
    ((name, begin_s, end_s),) = [fault for fault in run.faults if "joint3" in fault[0]]
    assert name == "joint3 (servo 3)" and 0.2 < end_s - begin_s < 0.6
    ((ended_s, text),) = run.results
    assert begin_s < ended_s < end_s and text == "arm_controller: aborted joint3: servo 3 does not respond"


def test_a_recording_whose_name_is_not_utf8_is_plotted(recording: Path, tmp_path: Path) -> None:
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/x\xff.mcap"))
    path.write_bytes(recording.read_bytes())
    done = subprocess.run([sys.executable, "-m", "servoloop", "plot", path], capture_output=True)
    assert done.returncode == 0, done.stderr
    assert "<h1>x\\udcff.mcap</h1>" in path.with_suffix(".html").read_text()


@pytest.mark.parametrize("failed", [False, True])
def test_a_run_that_ended_with_an_error_has_a_fault_at_its_end(tmp_path: Path, failed: bool) -> None:
    """A lost arm ends the loop, so that no further cycle shows the loss."""
    rig = Rig()
    file = RecordingFile(tmp_path / "run.mcap", rig.messages)
    for sample in rig.run(0.5):
        file.write(sample)
    file.close((), failed)
    run = read_recording(file.path)
    assert run.faults == ([("control loop", run.time_s[-1], run.time_s[-1])] if failed else [])


def test_page_needs_no_network_and_shows_all_joints(recording: Path, run: RecordedRun) -> None:
    done = CliRunner().invoke(app, ["plot", str(recording), "--json"])
    assert done.exit_code == 0, done.output
    output = json.loads(done.stdout)
    text = Path(output["page"]).read_text()
    assert output["page"] == str(recording.with_suffix(".html")) and output["cycles"] == len(run.time_s)
    assert not re.search(r"(src|href)=\"https?:", text) and "<script" not in text
    for element in re.findall(r"<svg.*?</svg>", text, re.DOTALL):
        ElementTree.fromstring(element)
    assert text.count("<svg") == 2 and all(joint in text for joint in run.joints) and "joint3 (servo 3)" in text


def test_incomplete_recording_is_read_up_to_its_end(recording: Path, run: RecordedRun, tmp_path: Path) -> None:
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(recording.read_bytes()[: recording.stat().st_size // 2])
    left = read_recording(torn)
    assert 0 < len(left.time_s) < len(run.time_s)
    np.testing.assert_array_equal(left.position, run.position[: len(left.time_s)])


def test_unwritable_page_is_an_error(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "is a folder: choose the name of a file" in complaint(
        capsys, monkeypatch, "plot", str(recording), "--out", str(tmp_path)
    )


def test_file_that_is_not_a_recording_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "x.mcap").write_text("nothing of the kind")
    assert "x.mcap" in complaint(capsys, monkeypatch, "plot", str(tmp_path / "x.mcap"))
    assert "cannot read" in complaint(capsys, monkeypatch, "plot", str(tmp_path / "y.mcap"))
    (tmp_path / "z.mcap").write_bytes(b"")
    with pytest.raises(RecordingError):
        read_recording(tmp_path / "z.mcap")


def test_progress_is_shown_and_removed_on_a_terminal(recording: Path, tmp_path: Path) -> None:
    reading, ours = os.openpty()
    command = [sys.executable, "-m", "servoloop", "plot", str(recording), "--out", str(tmp_path / "run.html")]
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "100"}
    shown = bytearray()
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=ours, env=environment) as process:
        os.close(ours)
        with contextlib.suppress(OSError):  # raised when the program has ended and closed the terminal
            while data := os.read(reading, 65536):
                shown += data
    os.close(reading)
    assert process.returncode == 0, shown
    assert b"reading run.mcap" in shown and b"drawing" in shown


def test_pipe_receives_only_the_result(recording: Path, tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["plot", str(recording), "--out", str(tmp_path / "run.html")])
    assert done.exit_code == 0 and len(done.output.splitlines()) == 1
