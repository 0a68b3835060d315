"""A symbolic link that points to itself is reported in one sentence, wherever a path is expected."""

import errno
import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.paths import resolved
from servoloop import cli
from servoloop.recording.stream import LiveError, find_stack
from servoloop.stack.robot_files import read_files
from servoloop.stack.shipped_files import ARMS
from tests.command_socket.rig import served
from tests.complaint import complaint

LEVELS = os.strerror(errno.ELOOP)


@pytest.fixture(autouse=True)
def loops(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Create links that point to themselves: ``loop``, and a file in each of two arm folders."""
    monkeypatch.chdir(tmp_path)
    Path("loop").symlink_to("loop")
    for file in ("controllers.yaml", "scene.xml"):
        folder = Path(shutil.copytree(ARMS / "so101", tmp_path / Path(file).stem))
        (folder / file).unlink(missing_ok=True)
        (folder / file).symlink_to(file)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("arms combine left=so101 right=so101 --out loop", "cannot write into loop"),
        ("up --no-ros --arm ./controllers", f"controllers/controllers.yaml: {LEVELS}"),
        ("simulate --seconds 0.1 --arm ./controllers", f"controllers/controllers.yaml: {LEVELS}"),
        ("simulate --seconds 0.1 --arm ./scene", "scene.xml is missing"),
        ("bench bus --port ./loop", "./loop does not exist"),
        ("doctor --arm ./loop", f"loop/arm.yaml: {LEVELS}"),
    ],
)
def test_a_loop_is_reported(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, words: str, message: str
) -> None:
    said = complaint(capsys, monkeypatch, *words.split())
    assert message in said.replace("\n", " ") and said.count("\n") == 1


def test_a_loop_is_the_folder_of_no_running_stack(monkeypatch: pytest.MonkeyPatch) -> None:
    loop, files = Path("loop").absolute(), replace(read_files(), folder=ARMS / "robot_arm")
    text = rf"no stack of {loop} is running\. Running stacks: robot_arm"
    with served(monkeypatch, files), pytest.raises(LiveError, match=text):
        find_stack(str(loop))


def test_a_loop_that_no_command_expects_is_reported(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cli, "app", lambda: Path("loop").stat())
    assert complaint(capsys, monkeypatch) == f"servoloop: cannot use loop: {LEVELS}; choose another path\n"


def test_links_are_followed_up_to_a_loop(tmp_path: Path) -> None:
    Path("link").symlink_to("scene")
    assert resolved("link/arm.yaml") == tmp_path.resolve() / "scene/arm.yaml"
    assert resolved(Path("loop")).name == "loop"
