"""``servoloop bench arm`` on the command line: it asks for confirmation, and it measures all figures with ROS."""

import errno
import json
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from drivers.servos import sts
from servoloop import cli
from servoloop.bench.figures import ArmFigures, MachineFigures, Timing
from servoloop.cli import app
from sim_backend.buses.feetech import VirtualBus
from sim_backend.mechanics.plant import BenchPlant
from tests.complaint import complaint
from tests.pages import commands
from tests.servoloop.served import served

(COMMAND,) = commands("bench.md")
SPREADS = ("goal_to_answer", "goal_to_motion", "joint_states_age", "joint_states_jitter")


def test_without_confirmation_nothing_moves(tmp_path: Path) -> None:
    line = VirtualBus.of(BenchPlant(tuple(range(1, 8))))
    with served(line, tmp_path / "bus") as port:
        done = CliRunner().invoke(
            app, ["bench", "arm", "--port", port, "--out", str(tmp_path / "page.html")], input="n\n"
        )
        assert done.exit_code == 1 and "Make sure that the arm has room. Continue?" in done.output
        assert not any(servo.memory.get(sts.torque_enable) for servo in line.servos)
    assert not (tmp_path / "page.html").exists()


def test_an_unwritable_page_is_reported_before_the_question(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("mine")
    said = complaint(
        capsys, monkeypatch, "bench", "arm", "--port", "./bus", "--out", str(tmp_path / "file" / "page.html")
    )
    assert "cannot write into" in said
    said = complaint(capsys, monkeypatch, "bench", "arm", "--port", "./bus", "--out", str(tmp_path))
    assert f"{tmp_path} is a folder: choose the name of a file" in said


@pytest.mark.parametrize("json_", [True, False])
def test_figures_are_printed_even_if_the_page_cannot_be_written(
    json_: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def no_room(fd: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    machine = MachineFigures("Linux", "one", 1, "3.11", False, ())
    figures = ArmFigures("so101", {}, machine, {}, Timing(20.0, 100, 0, None, None), (), None, "no rclpy")
    monkeypatch.setattr("servoloop.bench.arm.bench_arm", lambda *_, **__: SimpleNamespace(figures=figures))
    monkeypatch.setattr("servoloop.bench.page.page", lambda measured: "<html>")
    monkeypatch.setattr("os.fsync", no_room)
    page = str(tmp_path / "page.html")
    words = ("bench", "arm", "--port", "./bus", "--out", page, "--yes", *(("--json",) if json_ else ()))
    monkeypatch.setattr(sys, "argv", ["servoloop", *words])
    with pytest.raises(SystemExit) as exit_:
        cli.main()
    said = capsys.readouterr()
    assert exit_.value.code == 1 and f"cannot write {page}: No space left on device" in said.err
    if json_:
        assert json.loads(said.out)["page"] is None
    else:
        assert "0 of 100 cycles missed" in said.out and "Report page" not in said.out


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.runs(COMMAND)
def test_the_command_of_the_page_works_on_a_pseudo_terminal(tmp_path: Path, ros_domain: int) -> None:
    pytest.importorskip("rclpy")
    link, page = tmp_path / "bus", tmp_path / "out" / "bench.html"
    with running("emulate", str(link), "--arm", "so101"):
        words = shlex.split(COMMAND.replace("/dev/ttyACM0", str(link)))[1:]
        done = once("tests.bench_arm.short", *words, "--yes", "--json", folder=tmp_path)
        assert done.returncode == 0, done.stderr
        ids = ("--ids", "1-6", "--baud", "1000000")
        found = json.loads(once("servoloop", "scan", str(link), *ids, "--json", folder=tmp_path).stdout)
    figures = json.loads(done.stdout)
    assert (tmp_path / figures["page"]).samefile(page) and page.read_text().count("<svg") == 8
    ros = figures["ros"]
    assert (ros["goals"], ros["failed"]) == (3, 0)
    assert all(ros[name]["p50_ms"] > 0.0 for name in SPREADS)
    assert ros["loop"]["cycles"] > 50 and figures["loop"]["cycles"] > 50
    assert len(figures["motions"]) == 5
    assert [servo["torque"] for servo in found["servos"]] == [False] * 6


@contextmanager
def running(*words: str) -> Iterator[None]:
    """Run an emulator until the end of the block."""
    command = [sys.executable, "-m", "servoloop", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as emulator:
        try:
            assert emulator.stdout is not None and "ready" in emulator.stdout.readline()
            yield
        finally:
            emulator.terminate()


def once(module: str, *words: str, folder: Path) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", module, *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=100, cwd=folder)
