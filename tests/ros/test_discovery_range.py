"""The sockets of the arm are bound to the loopback interface, and clients on this machine find the arm."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from nodes.discovery import PROFILES, RANGE
from tests.ros.stack_process import READY, StackProcess, arm_client, running, until

pytestmark = pytest.mark.slow

LOOPBACK = "127.0.0.1"


def receiving_on(pid: int, domain: int) -> set[str]:
    """Return the addresses of UDP sockets on the ports of a domain (250 ports from 7400)."""
    first_port = 7400 + 250 * domain
    targets = set()
    for link in Path(f"/proc/{pid}/fd").iterdir():
        with suppress(FileNotFoundError):  # The socket has been closed in the meantime.
            targets.add(os.readlink(link))
    found = set()
    for line in Path(f"/proc/{pid}/net/udp").read_text().splitlines()[1:]:
        columns = line.split()
        address, port = columns[1].split(":")
        if f"socket:[{columns[9]}]" in targets and 0 <= int(port, 16) - first_port < 250:
            found.add(".".join(str(byte) for byte in reversed(bytes.fromhex(address))))
    return found


@pytest.fixture
def unset(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Set the domain, but no discovery range."""
    monkeypatch.delenv(RANGE)
    monkeypatch.delenv(PROFILES)
    yield ros_domain


@pytest.mark.parametrize("client_range", ["SUBNET", "LOCALHOST"])
def test_stack_is_open_only_to_this_machine(
    unset: int, client_range: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with running(tmp_path, "--hardware", "mock") as stack:
        assert receiving_on(stack.process.pid, unset) == {LOOPBACK}
        assert f"programs on this machine with ROS_DOMAIN_ID {unset} can command the arm; --network" in stack.words
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", client_range)
        with arm_client() as client:
            response: Any = client.wait(client.send(READY, seconds=1))
            assert response.result.error_code == 0, response


def test_network_option_opens_the_stack(unset: int, tmp_path: Path) -> None:
    with running(tmp_path, "--hardware", "mock", "--network") as stack:
        assert "0.0.0.0" in receiving_on(stack.process.pid, unset)
        assert f"every program on the network with ROS_DOMAIN_ID {unset} can command the arm" in stack.words


@pytest.mark.parametrize(("options", "address"), [([], LOOPBACK), (["--network"], "0.0.0.0")], ids=["here", "network"])
def test_network_option_opens_the_pick_place_node(unset: int, options: list[str], address: str, tmp_path: Path) -> None:
    node = StackProcess(tmp_path / "node.log", *options, module="nodes.vision_pick_place_controller")
    try:
        until(lambda: "can command the arm" in node.words, lambda: node.process.poll() is not None and node.words)
        assert address in receiving_on(node.process.pid, unset)
        assert ({LOOPBACK} == receiving_on(node.process.pid, unset)) is (not options)
    finally:
        node.end()


def test_clients_search_only_this_machine(unset: int) -> None:
    """Each client runs in its own process and inspects its own sockets."""
    program = (
        "import os, sys\nfrom tests.ros.test_discovery_range import receiving_on\n"
        "from nodes.clients.client_node import client_node\nfrom servoloop.commands.shared.options import set_network\n"
        "set_network('--network' in sys.argv)\n"
        f"with client_node('look'): print(*sorted(receiving_on(os.getpid(), {unset})))"
    )

    def addresses(*options: str) -> str:
        command = [sys.executable, "-c", program, *options]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout

    assert addresses() == f"{LOOPBACK}\n"
    assert "0.0.0.0" in addresses("--network")
