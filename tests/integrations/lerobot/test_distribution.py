"""The plugin for LeRobot is a separate distribution that LeRobot finds by its name."""

import ast
import sys
from importlib.metadata import Distribution
from pathlib import Path

from tests.integrations.lerobot.conftest import PLUGIN
from tests.integrations.lerobot.plugin import install_plugin
from tests.pages import ROOT

PACKAGES = {"lerobot_servoloop", "lerobot_robot_servoloop", "lerobot_teleoperator_servoloop"}


def imports_of(path: Path) -> set[str]:
    """Return the top-level packages that a file imports."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {name.name.partition(".")[0] for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(str(node.module).partition(".")[0])
    return found


def test_the_plug_in_imports_only_lerobot_and_the_standard_library() -> None:
    files = sorted(PLUGIN.rglob("*.py"))
    assert {path.parent.name for path in files} == PACKAGES
    for path in files:
        assert imports_of(path) <= {*sys.stdlib_module_names, "lerobot", *PACKAGES}, path


def test_the_part_that_talks_to_a_stack_imports_only_the_standard_library() -> None:
    for name in ("connection.py", "units.py", "arm.py"):
        path = PLUGIN / "lerobot_servoloop" / name
        assert imports_of(path) <= {*sys.stdlib_module_names, "lerobot_servoloop"}, path


def test_lerobot_finds_the_wheel_by_its_name(tmp_path: Path) -> None:
    """LeRobot imports each distribution whose name starts with ``lerobot_robot_``, by exactly this name."""
    installed = install_plugin(tmp_path)
    (info,) = installed.glob("*.dist-info")
    found = Distribution.at(info)
    assert found.metadata["Name"] == "lerobot_robot_servoloop" and found.requires is None
    assert {path.name for path in installed.iterdir()} == PACKAGES | {info.name}
    assert list(info.rglob("LICENSE"))


def test_both_distributions_have_the_same_license_and_version() -> None:
    assert (PLUGIN / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()
    versions = [path.read_text().partition('\nversion = "')[2].partition('"')[0] for path in projects()]
    assert versions[0] == versions[1] != ""


def projects() -> tuple[Path, Path]:
    return ROOT / "pyproject.toml", PLUGIN / "pyproject.toml"
