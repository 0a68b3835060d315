"""A stack with a long namespace or a long arm name has all its sockets, and is listed with its full names."""

import socket
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import cast

import pytest
from typer.testing import CliRunner

from hal.robot_description.node_names import LONGEST_NAME
from servoloop.cli import app
from servoloop.command_server.requests import StackRequests
from servoloop.command_server.server import CommandServer
from servoloop.command_socket.client import CommandClient
from servoloop.recording.feed import LiveFeed
from servoloop.recording.stream import (
    NAME,
    LiveError,
    find_stack,
    live_folder,
    make_live_folder,
    running_stacks,
    socket_path,
)
from servoloop.stack.robot_files import read_files
from tests.command_socket.rig import SocketRig, served
from tests.live.rig import runtime_folder
from tests.recorder.rig import Rig

NAMESPACE = "/" + "n" * (LONGEST_NAME - 1)
LONGEST_ARM = "a" * 255  # the maximum length of a folder's name
NAMES = [("robot_arm", NAMESPACE), (LONGEST_ARM, ""), (LONGEST_ARM, NAMESPACE), ("robot_arm", "/lab_1/" + "n" * 93)]


@pytest.fixture(params=NAMES, ids=["namespace", "arm", "both", "nested namespace"])
def rig(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[SocketRig]:
    arm, namespace = request.param
    files = read_files()
    files = replace(files, arm=arm, controllers=replace(files.controllers, namespace=namespace))
    with served(monkeypatch, files) as rig:
        yield rig
    assert not list(live_folder().glob("*"))


def test_a_stack_with_a_long_name_is_found_stopped_and_recorded(rig: SocketRig) -> None:
    files = rig.stack.files
    assert (rig.running.arm, rig.running.namespace) == (files.arm, files.namespace)
    assert find_stack(files.arm) == find_stack(None, files.namespace) == rig.running
    with CommandClient.find(files.arm, namespace=files.namespace) as client:
        assert client.arm["arm"] == files.arm
    words = ["--namespace", files.namespace or "/", "--arm", files.arm]
    assert CliRunner().invoke(app, ["stop", *words]).exit_code == 0
    result = CliRunner().invoke(app, ["record", "--seconds", "0.2", *words])
    assert result.exit_code == 0, result.output
    (path,) = Path("out").iterdir()
    assert rig.running.file_name in path.name and (files.arm[:90] in path.name or NAMESPACE[1:] in path.name)


def test_the_sockets_of_a_killed_stack_with_a_long_name_are_removed(monkeypatch: pytest.MonkeyPatch) -> None:
    with runtime_folder(monkeypatch):
        make_live_folder()
        path = socket_path("koch", 7, NAMESPACE)
        path.with_suffix(NAME).symlink_to(f"{NAMESPACE[1:]}@koch")
        with socket.socket(socket.AF_UNIX) as killed:
            killed.bind(str(path))
        assert running_stacks() == [] and not list(live_folder().iterdir())


def test_stacks_whose_long_names_differ_at_the_end_have_different_sockets() -> None:
    one, other = (socket_path("so101", 7, f"{NAMESPACE[:-1]}{end}") for end in "ab")
    assert one != other and socket_path("so101", 7, f"{NAMESPACE[:-1]}a") == one


def test_a_runtime_folder_whose_path_is_too_long_is_named_with_the_remedy(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder := tmp_path / ("x" * 100)))
    with pytest.raises(LiveError, match=rf"{folder}/servoloop is too long for .*set XDG_RUNTIME_DIR to a shorter path"):
        socket_path("so101", 7)


def test_sockets_that_cannot_be_created_leave_no_files(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    class Full(socket.socket):
        def listen(self, backlog: int = 0) -> None:
            raise OSError("no space left on the device")

    messages, requests = Rig().messages, cast(StackRequests, None)
    with runtime_folder(monkeypatch):
        make_live_folder()
        monkeypatch.setattr("socket.socket", Full)
        path = socket_path("koch", 7)
        for create in (lambda: LiveFeed(path, messages, tmp_path, "name"), lambda: CommandServer(path, requests)):
            with pytest.raises(LiveError, match="no space left"):
                create()
        assert not list(live_folder().iterdir())
