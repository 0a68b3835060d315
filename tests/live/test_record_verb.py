"""``servoloop record`` on the command line: file names, messages, and the file of a killed program."""

import json
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader
from typer.testing import CliRunner, Result

from servoloop.cli import app
from tests.complaint import complaint
from tests.live.rig import LiveRig, runtime_folder
from tests.recorder.reading import by_mcap, stamp_s
from tests.servoloop.served import eventually

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    monkeypatch.chdir(tmp_path)
    with runtime_folder(monkeypatch):
        yield


@contextmanager
def meanwhile(work: Callable[[], object]) -> Iterator[None]:
    """Run a function in another thread."""
    thread = threading.Thread(target=work)
    thread.start()
    yield
    thread.join(30.0)


def called(rig: LiveRig, *arguments: str) -> Result:
    """Run the command on a stack that ends after half a second."""

    def run() -> None:
        eventually(lambda: rig.play(0.05) and rig.feed.eager)
        rig.play(0.5)
        rig.feed.close((), failed=False)

    with meanwhile(run):
        return CliRunner().invoke(app, ["record", *arguments])


def test_default_file_name_has_date_and_arm_and_the_end_of_the_stack_is_reported(tmp_path: Path) -> None:
    result = called(LiveRig())
    assert result.exit_code == 0, result.output
    (path,) = (tmp_path / "out").glob("????-??-??_??-??-??_robot_arm.mcap")
    stamps = [stamp_s(message) for message in by_mcap(path)["/joint_states"]]
    assert result.stdout.splitlines() == [
        f"{path.relative_to(tmp_path)}: {len(stamps)} cycles in {stamps[-1] - stamps[0]:.1f} s; the stack has ended"
    ]
    assert f"Recording robot_arm to out/{path.name}; press Ctrl-C to stop" in result.stderr


def test_record_prints_json() -> None:
    rig = LiveRig()
    result = called(rig, "run.mcap", "--arm", "robot_arm", "--seconds", "0.2", "--json")
    output = json.loads(result.stdout)
    assert output.pop("length_s") == pytest.approx(0.2, abs=0.051)
    assert output.pop("cycles") in (4, 5)
    assert output == {"file": "run.mcap", "lost_cycles": 0, "stack_ended": False}


def test_errors_are_reported_before_a_file_is_created(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert "no stack is running: start one" in complaint(capsys, monkeypatch, "record", "run.mcap")
    assert "name must end in .mcap" in complaint(capsys, monkeypatch, "record", "run.bag")
    for seconds in ("inf", "1e+300", "1000001.0"):
        endless = complaint(capsys, monkeypatch, "record", "run.mcap", "--seconds", seconds)
        assert f"--seconds must be 0 to 1000000, not {seconds}: omit --seconds to record without a limit" in endless
    assert not list(tmp_path.iterdir())
    (tmp_path / "there.mcap").touch()
    rig = LiveRig()
    assert "already exists" in complaint(capsys, monkeypatch, "record", "there.mcap")
    assert "no stack of koch is running" in complaint(capsys, monkeypatch, "record", "--arm", "koch")
    rig.feed.close((), failed=False)


@pytest.mark.parametrize("signal", ["terminate", "kill"])
def test_recording_is_readable_after_a_signal_or_kill(tmp_path: Path, signal: str) -> None:
    rig, path = LiveRig(), tmp_path / "run.mcap"
    command = [sys.executable, "-m", "servoloop", "record", str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT) as process:
        eventually(lambda: rig.play(0.05) and rig.feed.eager, 60.0)
        eventually(lambda: rig.play(0.05) and path.exists() and path.stat().st_size > 20_000)
        getattr(process, signal)()
        output, _ = process.communicate(timeout=30.0)
    stamps = []
    with path.open("rb") as stream, suppress(Exception):  # the library may raise any error for an incomplete end
        for _, _, message in NonSeekingReader(stream).iter_messages("/joint_states", log_time_order=False):
            stamps.append(message.log_time)
    assert len(stamps) > 2 and stamps == sorted(stamps)
    if signal == "terminate":
        assert process.returncode == 0 and output.startswith(f"{path}: {len(stamps)} cycles in ")
        assert len(by_mcap(path)["/joint_states"]) == len(stamps)
    rig.feed.close((), failed=False)
