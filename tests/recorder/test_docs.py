"""Run the first command and the programs of docs/recordings.md. tests/ros/test_recordings.py runs the other
commands."""

import re
import shlex
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pick_place.settings import JobSettings
from servoloop.cli import app
from servoloop.recording.fault_files import FILES, KEPT_S
from servoloop.recording.recorder import WAITING
from servoloop.simulation.schedule import Schedule
from servoloop.simulation.simulate import simulate
from servoloop.stack.robot_files import read_files
from tests.live.rig import LiveRig, runtime_folder
from tests.pages import DOCS, codes, commands
from tests.recorder.reading import by_mcap, by_rosbags
from tests.servoloop.served import eventually

PAGE = "recordings.md"
TEXT = (DOCS / PAGE).read_text()
PROSE = " ".join(TEXT.split())


SIMULATE, _, _, *RUNNING, PLOT = commands(PAGE)
READING, RECOVERING = codes(PAGE, "python")


@pytest.mark.slow
@pytest.mark.runs(SIMULATE, PLOT, f"{PAGE} python 1")
def test_documented_simulated_job_is_recorded_and_readable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, shlex.split(SIMULATE)[1:])
    assert result.exit_code == 0, result.output
    done = subprocess.run([sys.executable, "-c", READING], capture_output=True, text=True, check=True)
    assert len(done.stdout.splitlines()) == len(by_rosbags(tmp_path / "job.mcap")["/joint_states"])
    assert "'joint3': " in done.stdout.splitlines()[-1]
    result = CliRunner().invoke(app, shlex.split(PLOT)[1:])
    assert result.exit_code == 0 and result.output.startswith("job.html: "), result.output


@pytest.mark.slow
@pytest.mark.runs(*RUNNING)
def test_documented_commands_record_a_running_stack(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One recording lasts until the end of the stack, and the other for ten seconds of the stack's time."""
    monkeypatch.chdir(tmp_path)
    for command, words, seconds in zip(RUNNING, ("out/", "run.mcap: "), (1.0, 10.0), strict=True):
        with runtime_folder(monkeypatch), ended_after(seconds + 0.2):
            result = CliRunner().invoke(app, shlex.split(command)[1:])
        assert result.exit_code == 0 and result.stdout.startswith(words), result.output
    (unnamed,) = (tmp_path / "out").iterdir()
    assert len(by_rosbags(unnamed)["/joint_states"]) > 20
    assert len(by_rosbags(tmp_path / "run.mcap")["/joint_states"]) in (200, 201)


@contextmanager
def ended_after(seconds: float) -> Iterator[None]:
    """Run a stack for a given time, faster than real time. The run begins when a viewer has connected."""
    rig = LiveRig()

    def run() -> None:
        eventually(lambda: rig.play(0.05) and rig.feed.eager)
        rig.play(seconds)
        rig.wait_until_read()
        rig.feed.close((), failed=False)

    thread = threading.Thread(target=run)
    thread.start()
    yield
    thread.join(30.0)


@pytest.mark.slow
def test_documented_topics_match_a_recording(tmp_path: Path) -> None:
    simulate(read_files(), {"": JobSettings()}, Schedule(job=("B",)), tmp_path / "job.mcap")
    found = {re.sub("^/(arm|hand)_controller/", "/NAME/", topic) for topic in by_mcap(tmp_path / "job.mcap")}
    first_cells = [row.split("|")[1] for row in TEXT.splitlines() if row.startswith("| `/")]
    assert {name for cell in first_cells for name in re.findall("`(.*?)`", cell)} == found


@pytest.mark.slow
@pytest.mark.runs(f"{PAGE} python 2")
def test_documented_repair_of_a_truncated_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    simulate(read_files(), {"": JobSettings()}, Schedule(seconds=60.0), tmp_path / "all.mcap")
    data = (tmp_path / "all.mcap").read_bytes()
    Path("killed.mcap").write_bytes(data[: len(data) * 3 // 4])
    exec(compile(RECOVERING, "recordings.md", "exec"), {})
    assert "was not written" in capsys.readouterr().out
    every, rest = by_rosbags(Path("all.mcap")), by_rosbags(Path("whole.mcap"))
    assert set(rest) == set(every)
    count = len(rest["/joint_states"])
    assert 0.3 * len(every["/joint_states"]) < count < len(every["/joint_states"])
    for one, other in zip(rest["/joint_states"], every["/joint_states"], strict=False):
        assert (one.position == other.position).all()


def test_figures_in_the_docs_match_the_code() -> None:
    assert f"keeps the last {KEPT_S:.0f} s in memory" in PROSE
    assert f"Only the latest {FILES} files are kept" in PROSE
    assert f"that {WAITING:,} cycles wait" in PROSE
