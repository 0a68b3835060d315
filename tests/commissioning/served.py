"""A virtual bus on a pseudo-terminal in real time, and commands that run on it in this process."""

import io
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from drivers.servos import x
from drivers.servos.register import ServoModel
from servoloop import cli
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.line.line import ServoLine
from sim_backend.mechanics.plant import BenchPlant
from tests.servoloop.served import served as served_line


@contextmanager
def served(link: Path, models: Mapping[int, ServoModel]) -> Iterator[ServoLine[Any]]:
    """Serve a bus at ``link`` in a thread. Tests must only read the memory of the bus."""
    of = VirtualDynamixelBus.of if isinstance(next(iter(models.values())), x.XModel) else VirtualBus.of
    bus: ServoLine[Any] = of(BenchPlant(tuple(models), timestep_s=0.005), models)
    with served_line(bus, link):
        yield bus


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str, answer: str = "") -> int:
    """Run a command with a given standard input and return its exit status."""
    monkeypatch.setattr(sys, "argv", ["servoloop", *arguments])
    monkeypatch.setattr(sys, "stdin", io.StringIO(answer))
    with pytest.raises(SystemExit) as exit_:
        cli.main()
    return int(exit_.value.code or 0)
