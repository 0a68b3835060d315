"""Run the commands and the program of docs/plan-over-ros.md."""

import shlex
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("moveit_msgs")
pytest.importorskip("ompl")

from tests.pages import ROOT, code, commands
from tests.ros.planned_stack import planning_up, program, servoloop

PAGE = "plan-over-ros.md"
UP, *CLIENTS, _DEMO = commands(PAGE)
OUTPUT = {
    "goto": "done: the tool is at the pose",
    "list": "stand: box at 0.288, 0.000",
    "add": "added box",
    "--plan-only": "a motion is possible",
    "remove": "removed box",
}
"""Expected beginning of an output line, keyed by a word of the command."""


@pytest.fixture(scope="module")
def stack(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with planning_up(tmp_path_factory.mktemp("up"), UP):
        yield


@pytest.mark.slow
@pytest.mark.runs(UP, *CLIENTS)
def test_commands_of_the_page_move_the_tool_and_change_the_scene(stack: None) -> None:
    for command in CLIENTS:
        words = shlex.split(command)
        ran = servoloop(*words[1:])
        expected = [text for word, text in OUTPUT.items() if word in words][-1]
        assert ran.returncode == 0, command + ran.stderr
        assert expected in ran.stdout, command


@pytest.mark.slow
@pytest.mark.runs(f"{PAGE} python 1", f"{PAGE} yaml 1")
def test_program_and_scene_file_of_the_page(stack: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = tmp_path / "bench.yaml"
    bench.write_text(code(PAGE, "yaml"))
    assert servoloop("scene", "load", str(bench)).stdout == "added shelf, cup\n"
    monkeypatch.setenv("PYTHONPATH", ":".join([str(ROOT / "integrations" / "moveit_py"), *sys.path[1:]]))
    sweep = tmp_path / "sweep.py"
    sweep.write_text(code(PAGE, "python"))
    program(str(sweep))
