"""``make setup`` detects a lock that does not satisfy pyproject.toml."""

import importlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
PYPROJECT = """
[project]
name = "servoloop"
dependencies = ["numpy>=1.26.4; python_version < '3.13'", "PyYAML>=6.0.2"]
[project.optional-dependencies]
sim = ["mujoco>=3.2.6,!=4.0.0"]
ros = ["ros-jazzy-rclpy[fastrtps]>=7.1.6,<7.2; platform_machine == 'x86_64'"]
all = ["servoloop[sim,ros]"]
[dependency-groups]
dev = ["ruff==0.17.5"]
"""
LOCKED = {"numpy": "2.4.6", "pyyaml": "6.0.3", "mujoco": "3.17.0", "ros-jazzy-rclpy": "7.1.6", "ruff": "0.17.5"}


@pytest.fixture
def requirements(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    yield importlib.import_module("requirements")
    sys.modules.pop("requirements", None)


def test_a_lock_that_satisfies_all_ranges_is_accepted(requirements: ModuleType) -> None:
    assert requirements.outdated(PYPROJECT, LOCKED) == ""
    assert requirements.outdated(PYPROJECT, LOCKED | {"mujoco": "3.2.6"}) == ""


@pytest.mark.parametrize(
    ("package", "version"),
    [
        ("mujoco", "3.2.5"),
        ("mujoco", "4.0"),
        ("ros-jazzy-rclpy", "7.2.0"),
        ("ruff", "0.17.6"),
        ("pyyaml", "6.0"),
        ("numpy", None),
    ],
)
def test_a_version_outside_its_range_is_reported(requirements: ModuleType, package: str, version: str | None) -> None:
    locked = {name: found for name, found in LOCKED.items() if name != package}
    sentence = requirements.outdated(PYPROJECT, locked | ({package: version} if version else {}))
    assert re.search(package, sentence, re.IGNORECASE) and sentence.endswith(f"has {version}: run make lock.")


def test_a_requirement_without_a_bound_is_refused(requirements: ModuleType) -> None:
    with pytest.raises(ValueError, match="must give ruff a lower bound"):
        requirements.outdated(PYPROJECT.replace("ruff==0.17.5", "ruff"), LOCKED)


def test_dependencies_are_ranges_that_the_lock_satisfies(requirements: ModuleType) -> None:
    """A program that depends on servoloop may use other versions of the same packages."""
    text = (ROOT / "pyproject.toml").read_text()
    locked = dict(re.findall(r"^([a-z0-9-]+)==(\S+)", (ROOT / "requirements.lock").read_text(), re.MULTILINE))
    assert requirements.outdated(text, locked) == ""
    published = text[: text.index("[dependency-groups]")].split("[project.optional-dependencies]")
    assert not re.search(r'"[\w\[\]-]+==', published[0].partition("dependencies = [")[2] + published[1])
