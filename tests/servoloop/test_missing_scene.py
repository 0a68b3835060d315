"""If an arm has no scene, commands that need a scene report how to create one."""

import shutil
from pathlib import Path

import pytest

from servoloop.stack.shipped_files import ARMS
from tests.complaint import complaint

COMMANDS = [
    "emulate BUS --arm ARM",
    "simulate --arm ARM",
    "up --hardware mujoco --arm ARM",
    "arms moveit ARM OUT",
]


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """Copy an arm, so that its scene can be removed or damaged."""
    return Path(shutil.copytree(ARMS / "so101", tmp_path / "mine"))


def words(command: str, arm: Path) -> list[str]:
    """Return the arguments of a command with the paths of the test."""
    places = {"BUS": arm.parent / "bus", "ARM": arm, "OUT": arm.parent / "out"}
    return [str(places.get(word, word)) for word in command.split()]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_missing_scene_is_reported_with_the_command_that_creates_it(
    arm: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    (arm / "scene.xml").unlink()
    text = complaint(capsys, monkeypatch, *words(command, arm))
    assert f"{arm / 'scene.xml'} is missing" in text and "servoloop arms new" in text


@pytest.mark.parametrize("command", COMMANDS)
def test_a_scene_that_is_not_mjcf_is_reported(
    arm: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    (arm / "scene.xml").write_text("<mujoco><world/></mujoco>")
    assert f"{arm / 'scene.xml'}: MuJoCo cannot read the scene" in complaint(capsys, monkeypatch, *words(command, arm))
