"""Every command that switches torque off asks for confirmation, or refuses, if torque is enabled. These tests run in
real time."""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.core import TyperGroup

from commissioning.passport.compare import take_passport
from commissioning.passport.file import Passport, write_passport
from drivers.bus.bus import Bus
from drivers.servos import sts
from servoloop import cli
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.emulator import virtual_bus
from servoloop.stack.shipped_files import ARMS
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.line.line import ServoLine
from sim_backend.mechanics.plant import BenchPlant
from tests.servoloop.served import served

SO101 = read_arm_files(find_arm("so101")).robot
IDS = tuple(joint.servo_id for joint in SO101.joints)
ALL = ", ".join(f"{joint.name} (servo {joint.servo_id})" for joint in SO101.joints)
FALL = "and the arm may fall"
FALLS = "its load falls"


@dataclass(frozen=True)
class Row:
    """Command on an arm with torque enabled (``{held}``), without confirmation."""

    command: str
    said: Sequence[str]
    """Texts that the message of the command must contain."""
    asks: bool = True
    status: int = 1


ROWS = {
    "teleop": Row(
        "teleop {held} {limp} --hands-free", ["leader/shoulder_pan (servo 1), ", "leader/gripper (servo 6) have", FALL]
    ),
    "teach record": Row("teach record wave --arm {arm} --port {held} --limp", [ALL, FALL]),
    "calibrate": Row("calibrate --arm {arm} --port {held}", [ALL, FALL]),
    "register write": Row("register write torque_enable 0 --id 3 --port {held}", ["servo 3", "drop its load"]),
    "reboot": Row("reboot 3 --port {held}", ["servo 3", FALL]),
    "tune": Row("tune wrist_roll --arm {arm} --port {held} --out {folder}/one.svg", [ALL, FALL]),
    "factory-reset": Row("factory-reset 3 --port {held} --yes", ["servo 3", FALLS], asks=False),
    "passport restore": Row(
        "passport restore {passport} --port {held} --yes", ["servo 3 has torque enabled", FALL], False
    ),
    "doctor": Row("doctor --move --arm {arm} --port {held} --yes", [ALL, FALL], asks=False, status=0),
    "bench arm": Row("bench arm --arm {arm} --port {held} --out {folder}/bench.html --yes", [ALL, FALL], asks=False),
    "set-id": Row("set-id 3 9 --port {held}", ["servo 3", "Support the arm"], asks=False),
    "set-baud": Row("set-baud 3 500000 --port {held} --yes", ["servo 3", "Support the arm"], asks=False),
}
LEAVES_TORQUE = {
    "bench bus": "releases only servos that it has switched on itself",
    "setup": "writes nothing to a servo whose torque is enabled, and releases only one that it has turned itself",
    "up": "parks the arm at its end and releases it only if the robot file requires it",
    "topic-host": "ends as up does",
    "replay": "ends as up does",
    "teach play": "ends as up does",
    **dict.fromkeys(("ports", "scan", "register list", "register read", "passport save", "passport diff"), "reads"),
    **dict.fromkeys(
        ("goto", "jog", "stop", "pick", "plan-server", "pose save", "pose go"), "is a client of a running stack"
    ),
    **dict.fromkeys(("view", "monitor", "record", "plot"), "shows"),
    **dict.fromkeys(("demo", "emulate", "hand", "fault", "simulate", "campaign"), "has virtual servos"),
    **dict.fromkeys(("pose list", "pose remove", "teach list", "teach remove", "register tables"), "opens no port"),
    **dict.fromkeys(("scene add", "scene list", "scene load", "scene remove"), "is a client of a planner"),
    **dict.fromkeys(
        ("camera list", "camera show", "camera calibrate", "camera plane", "camera board"), "has no servos"
    ),
    **dict.fromkeys(("calibration import", "calibration export", "calibration show"), "opens no port"),
}


def verbs(group: TyperGroup, before: str = "") -> Iterator[str]:
    """Yield the full names of all commands."""
    for name, command in group.commands.items():
        if isinstance(command, TyperGroup):
            yield from verbs(command, f"{before}{name} ")
        else:
            yield before + name


def test_the_table_has_every_command() -> None:
    app = typer.main.get_command(cli.app)
    assert isinstance(app, TyperGroup)
    names = {name for name in verbs(app) if not name.startswith("arms ")}
    assert names == ROWS.keys() | LEAVES_TORQUE.keys()


def so101_line() -> ServoLine[Any]:
    """Return the servos of an SO-101, each in the middle of its range."""
    plant = BenchPlant(IDS, timestep_s=0.005)
    plant.place([pi] * len(IDS))
    return virtual_bus(SO101, plant)


def changed_passport() -> Passport:
    """Return the passport of these servos with one setting that differs."""
    line, clock = so101_line(), SimulatedClock(10.0)
    line.servo(3).memory.save(sts.position_p, 16)
    models = {joint.servo_id: joint.model for joint in SO101.joints}
    return take_passport(Bus(VirtualPort(line, clock), clock, models), models)


@pytest.fixture(scope="module")
def held(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[ServoLine[Any], Path]]:
    """Serve an SO-101 with torque enabled at ``held`` and another with torque off at ``limp``."""
    folder = tmp_path_factory.mktemp("lines")
    lines = [so101_line() for _ in range(2)]
    with served(lines[0], folder / "held"), served(lines[1], folder / "limp"):
        (folder / "arm.yaml").write_text(f"description: mine\nlike: {ARMS / 'so101'}\n")
        write_passport(folder / "passport.yaml", changed_passport())
        yield lines[0], folder


def torque(line: ServoLine[Any]) -> list[int]:
    return [servo.memory.get(sts.torque_enable) for servo in line.servos]


@pytest.mark.parametrize(
    ("verb", "answer"), [(verb, answer) for verb, row in ROWS.items() for answer in (["", "n\n"] if row.asks else [""])]
)
def test_torque_is_not_switched_off_without_confirmation(
    held: tuple[ServoLine[Any], Path],
    verb: str,
    answer: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    line, folder = held
    row = ROWS[verb]
    for servo in line.servos:
        servo.memory.put(sts.torque_enable, 1)
    typed = folder / "typed"
    typed.write_text(answer)
    words = row.command.format(
        held=folder / "held", limp=folder / "limp", arm=folder, folder=folder, passport=folder / "passport.yaml"
    )
    monkeypatch.setattr(sys, "argv", ["servoloop", *words.split()])
    with typed.open() as stdin, pytest.raises(SystemExit) as ended:
        monkeypatch.setattr(sys, "stdin", stdin)
        cli.main()
    said = " ".join("".join(capsys.readouterr()).split())
    assert bool(ended.value.code) == bool(row.status), said
    for text in row.said:
        assert text in said
    assert torque(line) == [1] * len(IDS), said
