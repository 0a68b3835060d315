"""A live table and log lines on one terminal do not overwrite each other."""

import logging
import shutil
import subprocess
import sys
import time
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console
from rich.table import Table

from servoloop.manual.live_table import LiveTable
from servoloop.stack.terminal import log_to_terminal

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = """
import logging, time
from rich.console import Console
from rich.table import Table
from servoloop.manual.live_table import LiveTable
from servoloop.stack.terminal import log_to_terminal

def table(number):
    found = Table("joint", "position")
    for joint in range(6):
        found.add_row(f"joint{joint}", str(number))
    return found

log_to_terminal()
with LiveTable(Console()) as live:
    for number in range(12):
        live.draw("holds" if number < 6 else "moves", lambda: table(number))
        if number in (3, 9):
            logging.getLogger("servoloop").info("line %d", number)
        time.sleep(0.1)
print("the end")
time.sleep(30.0)
"""
SHOWN = ["· holds", "INFO servoloop: line 3", "· moves", "INFO servoloop: line 9", "the end"]


def test_log_lines_are_printed_above_the_live_table(monkeypatch: pytest.MonkeyPatch) -> None:
    logger = logging.getLogger("servoloop")
    monkeypatch.setattr(logging.getLogger(), "handlers", [])
    monkeypatch.setattr(logging.getLogger(), "level", logging.INFO)
    log_to_terminal()
    console = Console(file=StringIO(), force_terminal=True, width=80)
    with LiveTable(console) as live:
        live.draw("moves", Table)
        logger.info("parking")
    assert "INFO servoloop: parking" in console.file.getvalue()  # type: ignore[attr-defined]


def test_a_result_printed_during_the_table_stays_above_the_table() -> None:
    """A line that is printed in another way is overwritten when the table is erased."""
    console = Console(file=StringIO(), force_terminal=True, width=40)
    with LiveTable(console) as live:
        live.draw("moves", lambda: Table("joint"))
        live.say("wave: a path, saved in a file with a long name [1]")
    _, _, after = console.file.getvalue().partition("[1]")  # type: ignore[attr-defined]
    assert "joint" in after, "the table is drawn again below the line"


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("tmux") is None, reason="needs tmux")
def test_no_remains_of_the_table_are_left_in_tmux(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(PROGRAM)
    tmux = ["tmux", "-S", str(tmp_path / "tmux"), "-f", "/dev/null"]
    program = f"env PYTHONPATH={ROOT} {sys.executable} {tmp_path / 'program.py'}"
    subprocess.run([*tmux, "new-session", "-d", "-x", "80", "-y", "24", program], check=True)
    try:
        lines: list[str] = []
        until_s = time.monotonic() + 60.0
        while "the end" not in lines and time.monotonic() < until_s:
            time.sleep(0.2)
            shown = subprocess.run([*tmux, "capture-pane", "-p"], capture_output=True, text=True, check=True).stdout
            lines = [line.rstrip() for line in shown.splitlines() if line.strip()]
    finally:
        subprocess.run([*tmux, "kill-server"], check=False)
    assert lines == SHOWN
