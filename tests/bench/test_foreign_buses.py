"""Tests of ``servoloop bench bus`` with independent simulators, each of which writes its replies in another way."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from servoloop.cli import app

pytestmark = pytest.mark.slow

CYCLES = 60


@pytest.fixture
def device(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    link = str(tmp_path / request.param)
    command = [sys.executable, str(Path(__file__).with_name("foreign_bus.py")), link, request.param]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    process.stdout.readline()
    yield link
    process.kill()
    process.communicate()


def measure(device: str, model: str, ids: str) -> dict[str, float]:
    options = ["--port", device, "--ids", ids, "--model", model, "--cycles", str(CYCLES), "--hold", "--json"]
    result = CliRunner().invoke(app, ["bench", "bus", *options])
    assert result.exit_code == 0, result.output
    figures = json.loads(result.stdout.splitlines()[-1])
    return {"hz": figures["hz"], "wire_us": figures["wire_us"], **figures["faults"]}


def check_lines_are_whole(figures: dict[str, float], echo: bool) -> None:
    """Check that all replies are complete. A busy machine may delay some of them.

    A delayed echo no longer belongs to a request and counts as noise.
    """
    assert figures["corrupt"] + figures["noise"] <= (CYCLES / 4 if echo else 0)
    assert figures["silent"] + figures["late"] < 7 * CYCLES / 4


@pytest.mark.parametrize("device", ["whole", "each", "dribble", "slow", "echo"], indirect=True)
def test_feetech_servos_of_any_simulator_are_measured(device: str) -> None:
    figures = measure(device, "sts3215", "1-7")
    assert figures["hz"] > 0.0
    check_lines_are_whole(figures, echo=device.endswith("echo"))


@pytest.mark.parametrize("device", ["whole", "echo"], indirect=True)
def test_a_missing_servo_does_not_silence_the_others(device: str) -> None:
    figures = measure(device, "sts3215", "1-8")
    assert CYCLES <= figures["silent"] < CYCLES + 7 * CYCLES / 4
    assert figures["corrupt"] == 0


@pytest.mark.parametrize("device", ["x_whole", "x_each", "x_dribble", "x_echo"], indirect=True)
def test_dynamixels_of_any_simulator_are_measured(device: str) -> None:
    figures = measure(device, "xl430-w250", "1-7")
    check_lines_are_whole(figures, echo=device.endswith("echo"))
