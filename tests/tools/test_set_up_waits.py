"""Tests that the setup ends even if a command hangs, a command ignores the signal to end, or another setup never
ends."""

import fcntl
import importlib
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

TOOLS = Path(__file__).parents[2] / "tools"
STUBBORN = "trap '' TERM; echo up; sleep 99; echo never"
WAITS = "import sys, set_up; from pathlib import Path; set_up.LOGS = Path(sys.argv[1]); sys.exit(set_up.main())"


@pytest.fixture
def commands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """Import the module, with its logs in a temporary folder."""
    monkeypatch.syspath_prepend(str(TOOLS))
    module = importlib.import_module("commands")
    for name in ("ROOT", "LOGS"):
        monkeypatch.setattr(module, name, tmp_path)
    yield module
    for name in ("commands", "places"):
        sys.modules.pop(name, None)


def test_a_command_that_hangs_is_killed_and_named(commands: ModuleType) -> None:
    with pytest.raises(commands.ToolError, match=r"(?s)sleep 99 … failed with status -9.*The command hangs: check"):
        commands.Commands(limit_s=0.2).run("log", "sleep", "99")


def test_a_command_that_ends_in_time_is_not_killed(commands: ModuleType, tmp_path: Path) -> None:
    lines: list[str] = []
    commands.Commands().run("log", "echo", "done", on_line=lines.append)
    assert lines == ["done\n"]
    assert (tmp_path / "log.log").read_text() == "$ echo done\ndone\n"


def test_a_command_that_ignores_sigterm_is_killed_with_its_children(
    commands: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(commands, "STOP_S", 0.2)
    running, up = commands.Commands(), threading.Event()
    failures: list[str] = []

    def run() -> None:
        try:
            running.run("log", "sh", "-c", STUBBORN, on_line=lambda line: up.set())
        except commands.ToolError as error:
            failures.append(str(error))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    assert up.wait(20.0)
    running.stop()
    thread.join(20.0)
    assert len(failures) == 1 and "failed with status -9" in failures[0]
    assert "    never" not in failures[0]
    with pytest.raises(commands.ToolError, match="stopped"):
        running.run("log", "true")


@pytest.fixture
def other(tmp_path: Path) -> Iterator[Path]:
    """Return the folder in which another setup holds the lock."""
    with (tmp_path / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield tmp_path


def test_the_wait_for_another_set_up_is_limited(other: Path) -> None:
    program = WAITS.replace("sys.exit(set_up.main())", "set_up.only_one_at_a_time(0.1)")
    done = subprocess.run(
        [sys.executable, "-B", "-c", program, str(other)], cwd=TOOLS, capture_output=True, text=True, timeout=60
    )
    assert done.stdout == "Another make setup is running in this checkout; waiting until it finishes.\n"
    assert done.stderr.endswith("ToolError: the other make setup did not finish within 0 minutes: stop it first.\n")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_wait_for_another_set_up(other: Path, number: signal.Signals) -> None:
    command = [sys.executable, "-B", "-u", "-c", WAITS, str(other)]
    with subprocess.Popen(command, cwd=TOOLS, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as waiting:
        assert waiting.stdout is not None and waiting.stdout.readline().startswith("Another make setup")
        waiting.send_signal(number)
        _, words = waiting.communicate(timeout=60)
    assert waiting.returncode == 130
    assert words == "\nmake setup: interrupted; run it again to continue from here.\n"
