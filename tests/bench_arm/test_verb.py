"""``servoloop bench arm`` as it is typed: it asks first; on a pseudo-terminal and with ROS every figure is there."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drivers.servos import sts
from servoloop.cli import app
from sim_backend.bus import VirtualBus
from sim_backend.plant import BenchPlant
from tests.complaint import complaint
from tests.servoloop.served import served

SPREADS = ("goal_to_answer", "goal_to_motion", "joint_states_age", "joint_states_jitter")


def test_without_a_yes_nothing_is_opened_nor_moved(tmp_path: Path) -> None:
    line = VirtualBus.of(BenchPlant(tuple(range(1, 8))))
    with served(line, tmp_path / "bus") as port:
        done = CliRunner().invoke(
            app, ["bench", "arm", "--port", port, "--out", str(tmp_path / "page.html")], input="n\n"
        )
        assert done.exit_code == 1 and "See that it has room. Go on?" in done.output
        assert not any(servo.memory.get(sts.torque_enable) for servo in line.servos)
    assert not (tmp_path / "page.html").exists()


def test_what_cannot_be_written_is_said_before_anything_is_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("mine")
    said = complaint(
        capsys, monkeypatch, "bench", "arm", "--port", "./bus", "--out", str(tmp_path / "file" / "page.html")
    )
    assert "cannot write into" in said


@pytest.mark.ros
@pytest.mark.slow
def test_an_so101_on_a_pseudo_terminal(tmp_path: Path, ros_domain: int) -> None:
    pytest.importorskip("rclpy")
    link, page = tmp_path / "bus", tmp_path / "out" / "page.html"
    command = [sys.executable, "-m", "servoloop"]
    with subprocess.Popen(
        [*command, "emulate", str(link), "--arm", "so101"], stdout=subprocess.PIPE, text=True
    ) as emulator:
        try:
            assert emulator.stdout is not None and "ready" in emulator.stdout.readline()
            words = ("bench", "arm", "--arm", "so101", "--port", str(link), "--out", str(page), "--yes", "--json")
            done = subprocess.run([*command, *words], capture_output=True, text=True, timeout=110, cwd=tmp_path)
            assert done.returncode == 0, done.stderr
            hand = subprocess.run(
                [*command, "scan", str(link), "--ids", "1-6", "--baud", "1000000", "--json"],
                capture_output=True,
                text=True,
                timeout=60,
            )
        finally:
            emulator.terminate()
    figures = json.loads(done.stdout)
    assert figures["page"] == str(page) and page.read_text().count("<svg") == 6
    assert figures["ros"]["goals"] == 11 and figures["ros"]["failed"] == 0
    assert all(figures["ros"][name]["p50_ms"] > 0.0 for name in SPREADS)
    assert figures["ros"]["loop"]["cycles"] > 100 and figures["loop"]["cycles"] > 100
    assert len(figures["motions"]) == 5
    assert [servo["torque"] for servo in json.loads(hand.stdout)["servos"]] == [False] * 6
