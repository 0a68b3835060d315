"""Commands in messages that install optional parts, and the version."""

import shlex
import sys
from pathlib import Path

from typer.testing import CliRunner

from servoloop.cli import app
from servoloop.extras import install_command

ROOT = Path(__file__).parents[2]


def test_the_command_installs_from_the_source_of_servoloop() -> None:
    python, *words = shlex.split(install_command("view"))
    assert python == sys.executable and words == ["-m", "pip", "install", f"{ROOT}[view]"]


def test_no_message_names_an_index_that_has_no_servoloop() -> None:
    for path in (ROOT / "servoloop").rglob("*.py"):
        assert "pip install 'servoloop[" not in path.read_text(), path


def test_the_version_is_printed() -> None:
    done = CliRunner().invoke(app, ["--version"])
    assert done.exit_code == 0 and done.output.startswith("servoloop ")
