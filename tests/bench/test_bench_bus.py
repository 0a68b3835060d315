"""Tests of ``servoloop bench bus`` on a bus in another process, and of its messages. Figures are not checked."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.bus import simulator
from benchmarks.decoder import KINDS, StreamKind, flood, pieces
from drivers.bus.bus import Bus
from drivers.driver_errors import DriverError
from drivers.servos import sts
from drivers.types import ServoGoal
from servoloop.bench.bus import bench_bus, parse_ids
from servoloop.cli import app
from sim_backend.buses.feetech import VirtualBus
from sim_backend.mechanics.plant import BenchPlant
from tests.commissioning.served import run
from tests.servoloop.served import eventually, served

pytestmark = pytest.mark.slow

KEYS = {"hz", "p50_us", "p99_us", "max_us", "cpu_us", "wire_us", "ratio", "faults", "silent_servos"}


@pytest.fixture(scope="module")
def device() -> Iterator[str]:
    with simulator("1-7") as path:
        yield path


def test_json_output_is_one_line(device: str) -> None:
    result = CliRunner().invoke(
        app, ["bench", "bus", "--port", device, "--ids", "1-7", "--cycles", "50", "--hold", "--json"]
    )
    assert result.exit_code == 0
    (line,) = result.stdout.splitlines()
    figures = json.loads(line)
    assert set(figures) == KEYS
    assert {"silent", "corrupt", "late"} <= set(figures["faults"])
    assert figures["wire_us"] == 1770.0
    assert figures["hz"] > 0.0


def test_figures_are_printed_as_a_table(device: str) -> None:
    result = CliRunner().invoke(app, ["bench", "bus", "--port", device, "--cycles", "20", "--hold"])
    assert result.exit_code == 0
    assert "p50_us" in result.stdout


def test_the_bench_continues_without_an_absent_servo(device: str) -> None:
    figures = bench_bus(device, parse_ids("1-8"), "sts3215", 1_000_000, 60)
    assert figures.faults["silent"] >= 60 and figures.silent_servos == (8,)


def test_the_exit_status_is_1_and_the_silent_servos_are_named(
    device: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(monkeypatch, "bench", "bus", "--port", device, "--ids", "1-9", "--cycles", "20", "--json") == 1
    said = capsys.readouterr()
    assert json.loads(said.out)["silent_servos"] == [8, 9]
    assert "no reply from the servo IDs 8, 9: check their power and cables, or correct --ids" in " ".join(
        said.err.split()
    )


def test_the_bench_runs_on_one_processor_and_restores_the_affinity(
    device: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, meanwhile = os.sched_getaffinity(0), list[set[int]]()
    write_goals = Bus.write_goals

    def watched(bus: Bus, goals: Mapping[int, ServoGoal]) -> None:
        meanwhile.append(os.sched_getaffinity(0))
        write_goals(bus, goals)

    bench_bus(device, [1], "sts3215", 1_000_000, 1, hold=True)
    monkeypatch.setattr(Bus, "write_goals", watched)
    bench_bus(device, [1], "sts3215", 1_000_000, 10, hold=True)
    measured = meanwhile[1:]  # the first goals hold the servos before the measurement
    assert len(measured) == 10
    assert all(processors == measured[0] and len(processors) == 1 for processors in measured)
    assert os.sched_getaffinity(0) == before


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_releases_the_held_servos(number: signal.Signals, tmp_path: Path) -> None:
    line = VirtualBus.of(BenchPlant((1, 2)))
    words = ["bench", "bus", "--port", str(tmp_path / "bus"), "--ids", "1,2", "--cycles", "1000000", "--hold"]

    def held() -> bool:
        return all(servo.memory.get(sts.torque_enable) for servo in line.servos)

    with served(line, tmp_path / "bus"), subprocess.Popen([sys.executable, "-m", "servoloop", *words]) as bench:
        eventually(held)
        bench.send_signal(number)
        assert bench.wait(20.0) == 130
        assert not any(servo.memory.get(sts.torque_enable) for servo in line.servos)


def test_a_bus_without_replies_is_reported(device: str) -> None:
    with pytest.raises(DriverError, match="no servo responds on"):
        bench_bus(device, [20, 21], "sts3215", 1_000_000, 10)


@pytest.mark.parametrize("model", ["mx-28", "scs15"])
def test_servos_with_another_control_table_are_refused(device: str, model: str) -> None:
    with pytest.raises(DriverError, match="servo 1: is model"):
        bench_bus(device, [1, 2], model, 1_000_000, 10)


def test_more_servos_than_a_packet_holds_are_refused_before_the_run() -> None:
    with (
        simulator("1-32") as device,
        pytest.raises(DriverError, match="32 goals do not fit into a packet, which holds at most 31"),
    ):
        bench_bus(device, range(1, 33), "sts3215", 1_000_000, 10, hold=True)


def test_an_unsupported_baud_rate_is_refused(device: str) -> None:
    result = CliRunner().invoke(app, ["bench", "bus", "--port", device, "--baud", "99999999999"])
    assert result.exit_code == 2
    assert "--baud" in result.output


def test_a_simulator_does_not_replace_an_existing_path(tmp_path: Path) -> None:
    taken = tmp_path / "bus"
    taken.write_text("mine")
    command = [sys.executable, "-m", "benchmarks.simulator", str(taken)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30)
    assert done.returncode == 2
    assert f"{taken} exists and is not a symbolic link" in done.stderr
    assert taken.read_text() == "mine"


@pytest.mark.parametrize("model", ["sts9999", ""])
def test_an_unsupported_model_is_refused(device: str, model: str) -> None:
    with pytest.raises(DriverError, match="unknown servo model"):
        bench_bus(device, [1], model, 1_000_000, 10)


def test_a_missing_device_is_reported(tmp_path: Path) -> None:
    with pytest.raises(DriverError, match="does not exist"):
        bench_bus(str(tmp_path / "none"), [1], "sts3215", 1_000_000, 10)


@pytest.mark.parametrize(("text", "ids"), [("1-7", [1, 2, 3, 4, 5, 6, 7]), ("3", [3]), ("1,5-6", [1, 5, 6])])
def test_ids(text: str, ids: list[int]) -> None:
    assert parse_ids(text) == ids


@pytest.mark.parametrize("text", ["", "a", "7-1", "1,7-1", "1-", "1,1", "254", "-3", "1-100000000000"])
def test_invalid_ids_are_refused(text: str) -> None:
    with pytest.raises(DriverError, match="--ids"):
        parse_ids(text)


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_ten_million_random_bytes(kind: StreamKind) -> None:
    """Two thirds of the stream are fragments of frames or bytes that occur often in frames. ``python -m
    benchmarks.decoder`` prints the counts."""
    believed, wrong = flood(kind, pieces(kind, 10_000_000, 7))
    assert wrong == 0 and believed > 10_000
