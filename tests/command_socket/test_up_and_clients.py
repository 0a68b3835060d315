"""``servoloop up`` without ROS, and clients of its command socket that break the rules."""

import signal
import socket
from pathlib import Path

import pytest

from servoloop.command_socket.client import CommandClient
from tests.command_socket.test_bad_clients import GOAL, child
from tests.live.rig import runtime_folder
from tests.servoloop.served import eventually
from tests.servoloop.up_process import running_up

pytestmark = pytest.mark.slow


def test_the_stack_survives_its_clients_and_ends_normally(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with runtime_folder(monkeypatch) as folder, running_up(tmp_path, "--hardware", "mock", "--no-ros") as stack:
        process = child(GOAL)
        process.send_signal(signal.SIGKILL)
        process.wait(20.0)
        with CommandClient.find(name="test") as client, socket.socket(socket.AF_UNIX) as foreign:
            foreign.connect(str(client.stack.commands))
            foreign.sendall(b"GET / HTTP/1.1\r\n\r\n" * 100)
            client.request("take")
            assert client.request("state")["owner"].startswith("test")
            eventually(lambda: not any(one["busy"] for one in client.request("controllers")["controllers"]))
        assert list(folder.rglob("*.command"))
    assert stack.returncode == 0 and "Traceback" not in (tmp_path / "up.log").read_text()
