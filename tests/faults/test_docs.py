"""The commands, the file and the program of docs/faults.md work."""

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from servoloop.cli import app
from sim_backend.control import ask, control_path
from sim_backend.faults.events import KINDS
from sim_backend.faults.text import words
from tests.faults.rig import FaultRig
from tests.pages import DOCS, code, commands
from tests.servoloop.served import eventually

PAGE = "faults.md"
FAULT = "servoloop fault "
COMMANDS = commands(PAGE)
FAULTS = [command for command in COMMANDS if command.startswith(FAULT)]
EMULATE, EMULATE_FILE = (command for command in COMMANDS if command.startswith("servoloop emulate"))
(SIMULATE,) = (command for command in COMMANDS if command.startswith("servoloop simulate"))


@contextmanager
def emulating(command: str, folder: Path) -> Iterator[None]:
    words = [sys.executable, "-m", *shlex.split(command)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, cwd=folder) as process:
        try:
            assert process.stdout is not None and "ready" in process.stdout.readline()
            yield
        finally:
            process.terminate()


def fault(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["fault", *arguments])


@pytest.mark.slow
@pytest.mark.runs(EMULATE, *FAULTS)
def test_the_commands_start_faults_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    said: dict[str, str] = {}
    with emulating(EMULATE, tmp_path):
        for command in FAULTS:
            result = fault(*shlex.split(command.removeprefix(FAULT)))
            assert result.exit_code == 0, command
            said[command] = result.output
        assert fault("bus", "stall for=1s").exit_code == fault("bus", "silent id=8").exit_code == 1
        eventually(lambda: fault("bus").output == "no faults\n")
        assert fault("bus", "brown_out id=1").output == "done: brown_out id=1\n"
        fault("bus", "adapter_unplugged for=200ms as=another")
        assert not (tmp_path / "bus").is_symlink()
        eventually((tmp_path / "another").exists)
        fault("bus", "adapter_unplugged for=200ms")
        assert not (tmp_path / "another").is_symlink()
        eventually((tmp_path / "bus").exists)
    assert said["servoloop fault ./bus silent id=3 for=2s"] == "active: silent id=3 for=2.0s\n"
    assert "pending: brown_out id=2 at=0.5s" in said["servoloop fault ./bus brown_out id=2 at=500ms"]
    assert said["servoloop fault ./bus --clear jammed"].startswith("removed: jammed id=4\n")
    assert all(kind in said["servoloop fault --list"] for kind in KINDS)


@pytest.mark.slow
@pytest.mark.runs(EMULATE_FILE, f"{PAGE} yaml 1")
def test_the_file_is_played_from_when_the_emulator_is_ready(tmp_path: Path) -> None:
    (tmp_path / "faults.yaml").write_text(code(PAGE, "yaml"))
    with emulating(EMULATE_FILE, tmp_path):

        def happening() -> list[str]:
            kinds: list[str] = ask(control_path(tmp_path / "bus"), {"do": "fault"})["active"]
            return kinds

        assert happening()[0] == "flipped_replies chance=0.1 seed=7"
        eventually(lambda: any("silent" in text for text in happening()))
        eventually(lambda: happening() == ["flipped_replies chance=0.1 seed=7", "weak_supply voltage=6.0 at=2.0s"])


@pytest.mark.runs(SIMULATE, f"{PAGE} yaml 1")
def test_the_file_is_played_on_the_whole_stack(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "faults.yaml").write_text(code(PAGE, "yaml"))
    result = CliRunner().invoke(app, [*shlex.split(SIMULATE)[1:], "--json"])
    assert json.loads(result.output)["faulty_cycles"]["joint3: silent"] >= 10


@pytest.mark.runs(f"{PAGE} python 1")
def test_the_program_does_what_it_shows() -> None:
    rig = FaultRig()
    names = {"lines": rig.lines, "world": rig.world}
    exec(compile(code(PAGE, "python"), PAGE, "exec"), names)
    player = names["player"]
    player.update(rig.world.time_s)  # type: ignore[attr-defined]
    assert not rig.bus.faults.mute.isdisjoint(rig.bus.servos)


def test_all_kinds_are_listed_as_json() -> None:
    listed = json.loads(fault("--list", "--json").output)
    assert list(listed) == list(KINDS)
    assert listed["silent"] == {"does": listed["silent"]["does"], "parameters": ["id", "bus", "at", "since", "for"]}


def test_errors_name_the_missing_emulator_and_the_wrong_faults(tmp_path: Path) -> None:
    assert "no emulator serves" in str(fault(str(tmp_path / "bus"), "silent id=3").exception)
    assert "LINK" in str(fault().exception)
    broken = tmp_path / "faults.yaml"
    broken.write_text("- {kind: silent}\n")
    result = CliRunner().invoke(app, ["emulate", str(tmp_path / "bus"), "--faults", str(broken)])
    assert f"{broken}:1: 0.silent.servo_id: is missing" in str(result.exception)
    broken.write_text("- {kind: silent, servo_id: 9}\n- {kind: stall, for_s: 1}\n")
    result = CliRunner().invoke(app, ["emulate", str(tmp_path / "bus"), "--faults", str(broken)])
    assert "there is no servo 9" in str(result.exception) and "there is no stack" in str(result.exception)


def test_the_table_of_problems_names_existing_kinds() -> None:
    section = (DOCS / PAGE).read_text().partition("## Reported problems")[2].partition("\n\n## ")[0]
    named = [
        text
        for text in re.findall(r"`([a-z_]+(?: [a-z_]+=\S*)?)`", section)
        if text not in ("after", "as=", "since=start")
    ]
    assert len(named) > 25
    for text in named:
        kind, _, parameter = text.partition(" ")
        assert parameter.partition("=")[0] in ("", *words(KINDS[kind])), text
