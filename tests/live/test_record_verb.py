"""``servoloop record`` as users call it: names, sentences, and what a killed one leaves."""

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
    """Do something in another thread."""
    thread = threading.Thread(target=work)
    thread.start()
    yield
    thread.join(30.0)


def called(rig: LiveRig, *arguments: str) -> Result:
    """The verb, of a stack that ends after half a second."""

    def run() -> None:
        eventually(lambda: rig.play(0.05) and rig.feed.eager)
        rig.play(0.5)
        rig.feed.close((), failed=False)

    with meanwhile(run):
        return CliRunner().invoke(app, ["record", *arguments])


def test_without_a_name_it_is_below_out_by_date_and_arm_and_the_stacks_end_is_said(tmp_path: Path) -> None:
    result = called(LiveRig())
    assert result.exit_code == 0, result.output
    (path,) = (tmp_path / "out").glob("????-??-??_??-??-??_robot_arm.mcap")
    stamps = [stamp_s(message) for message in by_mcap(path)["/joint_states"]]
    assert result.stdout.splitlines() == [
        f"{path.relative_to(tmp_path)}: {len(stamps)} cycles in {stamps[-1] - stamps[0]:.1f} s; the stack has ended"
    ]
    assert f"Recording robot_arm to out/{path.name}; press Ctrl-C to stop" in result.stderr


def test_its_figures_are_for_programs_too() -> None:
    rig = LiveRig()
    result = called(rig, "run.mcap", "--arm", "robot_arm", "--seconds", "0.2", "--json")
    said = json.loads(result.stdout)
    assert said.pop("length_s") == pytest.approx(0.2, abs=0.051)
    assert said.pop("cycles") in (4, 5)
    assert said == {"file": "run.mcap", "lost_cycles": 0, "stack_ended": False}


def test_what_is_wrong_is_said_before_a_file_is_made(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert "no stack is running: start one" in complaint(capsys, monkeypatch, "record", "run.mcap")
    assert "name ends in .mcap" in complaint(capsys, monkeypatch, "record", "run.bag")
    assert not list(tmp_path.iterdir())
    (tmp_path / "there.mcap").touch()
    rig = LiveRig()
    assert "is there already" in complaint(capsys, monkeypatch, "record", "there.mcap")
    assert "no stack of koch is running" in complaint(capsys, monkeypatch, "record", "--arm", "koch")
    rig.feed.close((), failed=False)


@pytest.mark.parametrize("signal", ["terminate", "kill"])
def test_a_signal_ends_the_file_and_what_a_killed_program_leaves_can_be_read(tmp_path: Path, signal: str) -> None:
    rig, path = LiveRig(), tmp_path / "run.mcap"
    command = [sys.executable, "-m", "servoloop", "record", str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT) as process:
        eventually(lambda: rig.play(0.05) and rig.feed.eager, 60.0)
        eventually(lambda: rig.play(0.05) and path.exists() and path.stat().st_size > 20_000)
        getattr(process, signal)()
        said, _ = process.communicate(timeout=30.0)
    stamps = []
    with path.open("rb") as stream, suppress(Exception):  # whatever the library makes of an end that was not written
        for _, _, message in NonSeekingReader(stream).iter_messages("/joint_states", log_time_order=False):
            stamps.append(message.log_time)
    assert len(stamps) > 2 and stamps == sorted(stamps)
    if signal == "terminate":
        assert process.returncode == 0 and said.startswith(f"{path}: {len(stamps)} cycles in ")
        assert len(by_mcap(path)["/joint_states"]) == len(stamps)
    rig.feed.close((), failed=False)
