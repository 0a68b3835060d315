"""Clients that are killed, stall, flood the socket or belong to another user affect neither the stack nor other
clients."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from hal.servos.soft_torque import Softening
from servoloop import Arm
from servoloop.api.freedrive import FREEDRIVE
from servoloop.command_server import connection, server, session
from servoloop.command_socket.client import CommandClient
from servoloop.command_socket.command_errors import CommandError
from tests.command_socket.rig import SocketRig, served
from tests.servoloop.served import eventually
from tests.stack.rig import READY

PROGRAM = """
import time
from servoloop.command_socket.client import CommandClient
from tests.stack.rig import ARM, READY
with CommandClient.find(name="child") as client:
    client.request("take")
    {move}
    print("moves", flush=True)
    {then}
"""
GOAL = """client.request(
        "goal", joints=ARM, points=[{"positions": [*READY[:5], READY[5] + 1.0], "time_s": 6.0}]
    )"""
STREAM = """for step in range(100):
        client.request("set_point", controller="hand_controller", values=[0.05], time_s=0.3)
        values = [*READY[:5], READY[5] + 0.01 * step]
        client.request("set_point", controller="arm_controller", values=values)
        time.sleep(0.005)
        if step == 20:
            print("moves", flush=True)"""


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Iterator[SocketRig]:
    with served(monkeypatch) as rig:
        yield rig


def child(move: str, then: str = "time.sleep(60)") -> "subprocess.Popen[str]":
    """Start a client in a separate process, and wait until it moves the arm."""
    program = PROGRAM.format(move=move, then=then)
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "moves\n"
    return process


def at_rest(rig: SocketRig) -> list[float]:
    """Wait until the commands no longer change, and return them."""
    last: list[bytes] = []

    def still() -> bool:
        last.append(rig.stack.loop.command.tobytes())
        time.sleep(0.1)
        return len(last) > 4 and len(set(last[-4:])) == 1

    eventually(still)
    return rig.positions()


@pytest.mark.parametrize("move", [GOAL, STREAM], ids=["goal", "stream"])
def test_motion_of_a_killed_client_ends_within_the_limits_and_holds(move: str, rig: SocketRig) -> None:
    commands: list[float] = []
    rig.stack.on_state = lambda state: commands.append(float(rig.stack.loop.command[5]))
    process = child(move)
    eventually(lambda: rig.positions()[5] > READY[5] + 0.03)
    process.send_signal(signal.SIGKILL)
    process.wait(20.0)
    held = at_rest(rig)
    assert READY[5] + 0.03 < held[5] < READY[5] + 0.95
    period_s, limit = rig.stack.loop.period_s, rig.stack.files.limits["joint6"]
    velocity = np.diff(commands) / period_s
    assert np.abs(velocity).max() <= limit.velocity
    assert np.abs(np.diff(velocity)).max() / period_s <= 1.1 * limit.acceleration
    with rig.client() as other:
        other.request("take")  # no other client has control of the arm


def test_freedrive_of_a_killed_client_ends_and_the_arm_holds(rig: SocketRig) -> None:
    registry = rig.stack.loop.manager.registry
    process = child("client.request('freedrive', on=True)")
    assert registry.loaded[FREEDRIVE].active and not registry.loaded["arm_controller"].active
    with rig.client() as other, pytest.raises(CommandError, match=r"child \(process \d+\) has control"):
        other.request("freedrive", on=False)
    process.send_signal(signal.SIGKILL)
    process.wait(20.0)
    eventually(lambda: registry.loaded["arm_controller"].active and not registry.loaded[FREEDRIVE].active)
    assert at_rest(rig) == pytest.approx(READY, abs=0.05)
    (hardware,) = (component.hardware for component in rig.stack.loop.hardware.components)
    assert isinstance(hardware, Softening) and not hardware.soft_torque.reduced


def test_freedrive_whose_start_is_interrupted_ends_although_its_client_stays_connected(
    rig: SocketRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    request, registry = CommandClient.request, rig.stack.loop.manager.registry

    def interrupted(commands: CommandClient, op: str, *arguments: Any, **fields: Any) -> dict[str, Any]:
        reply = request(commands, op, *arguments, **fields)
        if fields.get("on"):
            assert registry.loaded[FREEDRIVE].active
            raise KeyboardInterrupt
        return reply

    monkeypatch.setattr(CommandClient, "request", interrupted)
    with Arm.connect() as arm:
        with pytest.raises(KeyboardInterrupt), arm.freedrive():
            pass
        assert registry.loaded["arm_controller"].active and not registry.loaded[FREEDRIVE].active


def test_a_stalled_client_loses_the_motion_to_a_client_that_takes_it_by_force(rig: SocketRig) -> None:
    process = child(GOAL)
    process.send_signal(signal.SIGSTOP)
    try:
        with rig.client("other") as other:
            with pytest.raises(CommandError, match="child"):
                other.request("take")
            other.request("take", force=True)
            assert at_rest(rig)[5] < READY[5] + 0.95
    finally:
        process.kill()
        process.wait(20.0)


def test_commands_that_waited_in_the_socket_of_a_stalled_stack_are_stale(
    rig: SocketRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    with rig.client() as client:
        client.request("take")
        monkeypatch.setattr(session, "MESSAGES_PER_S", 100.0)  # as slow as a stack on a very busy machine
        monkeypatch.setattr(session, "BURST", 1)
        with rig.client() as slow:
            slow.request("take", force=True)
            with pytest.raises(CommandError, match=r"s old; the limit is 0\.5 s") as caught:
                for _ in range(100):
                    client_time_s = time.monotonic()
                    line = (
                        b'{"v":1,"id":1,"op":"set_point","controller":"hand_controller","values":[0.05],"sent_s":%f}\n'
                    )
                    slow._socket.sendall(line % client_time_s * 30)
                    slow.request("set_point", controller="hand_controller", values=[0.05], sent_s=client_time_s)
            assert caught.value.kind == "stale"


def test_clients_of_other_users_are_refused(rig: SocketRig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "peer_user", lambda connection: (4711, os.getuid() + 1))
    with pytest.raises(CommandError, match="process 4711 and this stack belong to different users") as caught:
        rig.client()
    assert caught.value.kind == "foreign_user"


def test_only_this_user_can_open_the_socket(rig: SocketRig) -> None:
    path = rig.running.commands
    assert path.stat().st_mode & 0o777 == 0o600 and path.parent.stat().st_mode & 0o777 == 0o700
    here, there = socket.socketpair(socket.AF_UNIX)
    with here, there:
        assert connection.peer_user(here) == (os.getpid(), os.getuid())


def test_too_many_clients_are_refused_until_one_leaves(rig: SocketRig) -> None:
    clients = [rig.client() for _ in range(server.MAX_CLIENTS)]
    with pytest.raises(CommandError, match="16 clients are connected") as caught:
        rig.client()
    assert caught.value.kind == "too_many"
    clients.pop().close()

    def connects() -> bool:
        try:
            clients.append(rig.client())
        except CommandError:
            return False
        return True

    eventually(connects)
    for client in clients:
        client.close()


def test_a_client_that_floods_or_never_reads_does_not_delay_the_others(
    rig: SocketRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "MAX_UNREAD_BYTES", 10_000)
    with rig.client() as client, socket.socket(socket.AF_UNIX) as flood:
        flood.connect(str(rig.running.commands))
        flood.setblocking(False)
        slowest_s, closed = 0.0, False
        end_s = time.monotonic() + 20.0
        while not closed and time.monotonic() < end_s:
            try:
                flood.send(b"nonsense\n" * 1000)
            except BlockingIOError:
                pass
            except OSError:
                closed = True
            began_s = time.monotonic()
            client.request("state")
            slowest_s = max(slowest_s, time.monotonic() - began_s)
        assert closed and slowest_s < 0.5


def test_the_end_of_the_stack_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    with served(monkeypatch) as rig:
        client = rig.client()
        client.request("state")
    with pytest.raises(CommandError, match="has ended") as caught:
        client.request("state")
    assert caught.value.kind == "ended"
    with pytest.raises(CommandError, match="has no command socket: the stack has ended"):
        CommandClient(client.stack)


def test_a_defect_in_the_stack_is_reported_and_ends_nothing(rig: SocketRig, monkeypatch: pytest.MonkeyPatch) -> None:
    with rig.client() as client:
        monkeypatch.setattr(rig.stack.loop.manager.registry, "loaded", None)
        with pytest.raises(CommandError, match="internal error") as caught:
            client.request("controllers")
        monkeypatch.undo()
        assert caught.value.kind == "internal" and client.request("hello")["ok"]
