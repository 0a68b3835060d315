"""Tests of the Feetech SDK on virtual servos, as in its published examples: ping, read and write, groups.

The tests repeat requests that the examples send only once, because a busy machine may delay a reply. The SDK waits 34
ms, and a later reply collides with the next request.
"""

import contextlib
import importlib
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tests.peers.conftest import Serve
from tests.peers.waiting import eventually

pytestmark = pytest.mark.slow

# Import by name, because the module has no types.
sdk: Any = importlib.import_module("scservo_sdk")
IDS = (1, 2, 3)
ACCELERATION, GOAL, SPEED, POSITION, PRESENT_SPEED, MOVING = 41, 42, 46, 56, 58, 66


class Client:
    """The two objects that the examples use, a port and a packet handler."""

    def __init__(self, link: str) -> None:
        self.port = sdk.PortHandler(link)
        self.packets = sdk.PacketHandler(0)
        assert self.port.openPort()
        assert self.port.setBaudRate(1_000_000)

    def ask(self, question: str, *arguments: Any) -> Any:
        """Call a method of the handler until the servo answers, and return its first result."""
        answers: list[tuple[Any, ...]] = []

        def answered() -> bool:
            self.port.ser.reset_input_buffer()
            with contextlib.suppress(IndexError):
                answer = getattr(self.packets, question)(self.port, *arguments)
                answers.append(answer)
                return bool(answer[-2:] == (sdk.COMM_SUCCESS, 0))
            return False

        eventually(answered)
        return answers[-1][0]


@pytest.fixture
def client(serve: Serve) -> Iterator[Client]:
    client = Client(serve("sts3215", *IDS))
    yield client
    client.port.closePort()


def test_ping(client: Client) -> None:
    assert [client.ask("ping", servo_id) for servo_id in IDS] == [777] * 3
    assert client.packets.ping(client.port, 77)[1] == sdk.COMM_RX_TIMEOUT


def test_read_write(client: Client) -> None:
    """Write acceleration, speed and goal one by one, and read position and speed as one number until the servo
    arrives."""
    client.ask("write1ByteTxRx", 2, ACCELERATION, 50)
    client.ask("write2ByteTxRx", 2, SPEED, 1000)
    for goal in (2300, 1800):
        client.ask("write2ByteTxRx", 2, GOAL, goal)

        def arrived(goal: int = goal) -> bool:
            both = client.ask("read4ByteTxRx", 2, POSITION)
            return abs(sdk.SCS_LOWORD(both) - goal) <= 5 and sdk.SCS_TOHOST(sdk.SCS_HIWORD(both), 15) == 0

        eventually(arrived)
    client.ask("write1ByteTxRx", 2, 40, 0)
    assert client.ask("read1ByteTxRx", 2, 40) == 0


def arrived_together(client: Client, read: Any, goals: dict[int, int]) -> Callable[[], bool]:
    def arrived() -> bool:
        client.port.ser.reset_input_buffer()
        if read.txRxPacket() != sdk.COMM_SUCCESS:
            return False
        assert all(read.isAvailable(i, POSITION, 4) for i in goals)
        return all(abs(sdk.SCS_LOWORD(read.getData(i, POSITION, 4)) - goal) <= 5 for i, goal in goals.items())

    return arrived


def test_sync_read_write(client: Client) -> None:
    write = sdk.GroupSyncWrite(client.port, client.packets, GOAL, 6)
    read = sdk.GroupSyncRead(client.port, client.packets, POSITION, 4)
    assert all(read.addParam(servo_id) for servo_id in IDS)
    for goals in ({1: 1900, 2: 2100, 3: 2300}, {1: 2200, 2: 2000, 3: 2048}):
        for servo_id, goal in goals.items():
            assert write.addParam(servo_id, [sdk.SCS_LOBYTE(goal), sdk.SCS_HIBYTE(goal), 0, 0, 0xE8, 0x03])
        assert write.txPacket() == sdk.COMM_SUCCESS
        write.clearParam()
        eventually(arrived_together(client, read, goals))
    assert client.ask("read1ByteTxRx", 1, 62) in {119, 120}


def test_reg_write_and_action(client: Client) -> None:
    for servo_id in IDS:
        client.ask("regWriteTxRx", servo_id, ACCELERATION, 1, [20 + servo_id])
    assert client.ask("read1ByteTxRx", 3, ACCELERATION) == 0
    assert client.packets.action(client.port, sdk.BROADCAST_ID) == sdk.COMM_SUCCESS
    assert [client.ask("read1ByteTxRx", servo_id, ACCELERATION) for servo_id in IDS] == [21, 22, 23]
