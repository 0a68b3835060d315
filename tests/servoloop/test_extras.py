"""Installation commands in messages about missing extras, and the version."""

import shlex
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from servoloop.cli import app
from servoloop.extras import ExtraError, extra_error, install_command, require_extras
from servoloop.testing import plugin

ROOT = Path(__file__).parents[2]


def test_the_command_installs_from_the_source_of_servoloop() -> None:
    python, *words = shlex.split(install_command("view"))
    assert python == sys.executable and words == ["-m", "pip", "install", f"{ROOT}[view]"]


def test_no_message_names_an_index_that_has_no_servoloop() -> None:
    for path in (ROOT / "servoloop").rglob("*.py"):
        assert "pip install 'servoloop[" not in path.read_text(), path


def test_an_environment_without_pip_is_installed_into_with_uv(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda module: None)
    assert shlex.split(install_command("view")) == [
        *["uv", "pip", "install", "--python"],
        sys.executable,
        f"{ROOT}[view]",
    ]


def test_all_missing_libraries_are_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("mujoco", "PIL", "viser"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(
        ExtraError, match=r"^the arm needs mujoco, pillow and viser; install them with: .*\[sim,view\]'?$"
    ):
        require_extras("the arm", "sim", "view")


def test_a_failed_import_names_its_extra() -> None:
    found = extra_error(ModuleNotFoundError("no", name="matplotlib.axes"))
    assert str(found).startswith("this command needs matplotlib; install it with: ")
    assert extra_error(ModuleNotFoundError("no", name="of_no_extra")) is None


def test_a_fixture_without_the_simulation_fails_with_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "numba", None)
    with pytest.raises(pytest.fail.Exception, match=r"^the fixture virtual_arm needs numba; install it with: "):
        plugin._require_simulation("virtual_arm")


def test_the_version_is_printed() -> None:
    done = CliRunner().invoke(app, ["--version"])
    assert done.exit_code == 0 and done.output.startswith("servoloop ")
