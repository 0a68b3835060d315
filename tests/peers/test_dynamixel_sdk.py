"""Tests of the ROBOTIS SDK on virtual Dynamixels, as in its published examples, with both protocols.

A busy machine loses replies, so the tests repeat requests that the examples send only once.
"""

import importlib
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from drivers.servos import ax_mx as dxl
from drivers.servos import x, xl320
from tests.peers.conftest import Serve
from tests.peers.waiting import eventually

pytestmark = pytest.mark.slow

# Import by name, because the module has no types.
sdk: Any = importlib.import_module("dynamixel_sdk")
IDS = (1, 2, 3)
POSITION, GOAL, TORQUE, LED = (r.address for r in (x.present_position, x.goal_position, x.torque_enable, x.led))


class Client:
    """The two objects that the examples use, a port and a packet handler."""

    def __init__(self, link: str, protocol: float) -> None:
        self.port = sdk.PortHandler(link)
        self.packets = sdk.PacketHandler(protocol)
        assert self.port.openPort()
        assert self.port.setBaudRate(1_000_000)

    def ask(self, question: str, *arguments: Any) -> Any:
        """Call a method of the handler until the servo answers, and return its first result."""
        answers: list[Any] = []

        def answered() -> bool:
            answers.append(getattr(self.packets, question)(self.port, *arguments))
            return bool(answers[-1][-2:] == (sdk.COMM_SUCCESS, 0))

        eventually(answered)
        return answers[-1][0]


@pytest.fixture
def connect(serve: Serve) -> Iterator[Callable[[str, float], Client]]:
    clients: list[Client] = []

    def connected(model: str, protocol: float) -> Client:
        clients.append(Client(serve(model, *IDS), protocol))
        return clients[-1]

    yield connected
    for client in clients:
        client.port.closePort()


Connect = Callable[[str, float], Client]


def near(goal: int, tolerance: int = 15) -> Any:
    return pytest.approx(goal, abs=tolerance)


def test_ping_and_broadcast_ping(connect: Connect) -> None:
    client = connect("xl430-w250", 2.0)
    assert [client.ask("ping", servo_id) for servo_id in IDS] == [1060] * 3
    eventually(lambda: client.packets.broadcastPing(client.port)[0] == {i: [1060, 46] for i in IDS})


@pytest.mark.parametrize(
    ("model", "protocol", "torque", "goal", "position", "size", "places"),
    [
        ("xl430-w250", 2.0, TORQUE, GOAL, POSITION, 4, (2300, 1800)),
        ("xl330-m288", 2.0, TORQUE, GOAL, POSITION, 4, (2300, 1800)),
        ("xl320", 2.0, xl320.torque_enable.address, xl320.goal_position.address, 37, 2, (700, 500)),
        ("mx-28", 1.0, dxl.torque_enable.address, dxl.goal_position.address, dxl.present_position.address, 2, (2300,)),
    ],
)
def test_read_write(
    connect: Connect,
    model: str,
    protocol: float,
    torque: int,
    goal: int,
    position: int,
    size: int,
    places: tuple[int, ...],
) -> None:
    client = connect(model, protocol)
    client.ask("write1ByteTxRx", 2, torque, 1)
    for place in places:
        client.ask(f"write{size}ByteTxRx", 2, goal, place)
        eventually(lambda place=place: client.ask(f"read{size}ByteTxRx", 2, position) == near(place))  # type: ignore[misc]
    client.ask("write1ByteTxRx", 2, torque, 0)


def test_sync_read_fast_sync_read_and_sync_write(connect: Connect) -> None:
    client = connect("xl430-w250", 2.0)
    goals = {i: 2048 + 100 * i for i in IDS}
    write = sdk.GroupSyncWrite(client.port, client.packets, GOAL, 4)
    read = sdk.GroupSyncRead(client.port, client.packets, POSITION, 4)
    for servo_id, goal in goals.items():
        client.ask("write1ByteTxRx", servo_id, TORQUE, 1)
        assert write.addParam(servo_id, list(goal.to_bytes(4, "little")))
        assert read.addParam(servo_id)
    assert write.txPacket() == sdk.COMM_SUCCESS

    def places(question: Callable[[], int]) -> dict[int, int]:
        if question() != sdk.COMM_SUCCESS or not all(read.isAvailable(i, POSITION, 4) for i in IDS):
            return {}
        return {i: read.getData(i, POSITION, 4) for i in IDS}

    eventually(lambda: places(read.txRxPacket) == {i: near(goal) for i, goal in goals.items()})
    eventually(lambda: places(read.fastSyncRead) == {i: near(goal) for i, goal in goals.items()})


def test_bulk_read_write(connect: Connect) -> None:
    """Read the position of one servo and the LED of another in one request."""
    client = connect("xl430-w250", 2.0)
    client.ask("write1ByteTxRx", 1, TORQUE, 1)
    write = sdk.GroupBulkWrite(client.port, client.packets)
    assert write.addParam(1, GOAL, 4, list((2200).to_bytes(4, "little")))
    assert write.addParam(2, LED, 1, [1])
    assert write.txPacket() == sdk.COMM_SUCCESS
    read = sdk.GroupBulkRead(client.port, client.packets)
    assert read.addParam(1, POSITION, 4)
    assert read.addParam(2, LED, 1)

    def done() -> bool:
        if read.txRxPacket() != sdk.COMM_SUCCESS:
            return False
        return (read.getData(1, POSITION, 4), read.getData(2, LED, 1)) == (near(2200), 1)

    eventually(done)


def test_indirect_addresses(connect: Connect) -> None:
    """The LED and the position are adjacent in the indirect data, as in the example."""
    client = connect("xl430-w250", 2.0)
    for cell, address in enumerate((LED, *range(POSITION, POSITION + 4))):
        client.ask("write2ByteTxRx", 1, 168 + 2 * cell, address)
    client.ask("write1ByteTxRx", 1, 224, 1)
    assert client.ask("read1ByteTxRx", 1, LED) == 1
    assert client.ask("read4ByteTxRx", 1, 225) == near(2048, 2)


def test_protocol_1_group(connect: Connect) -> None:
    """Goals are written together and read one by one, because the SDK's bulk read of protocol 1.0 has a bug."""
    client = connect("mx-28", 1.0)
    goals = {i: 2000 + 50 * i for i in IDS}
    write = sdk.GroupSyncWrite(client.port, client.packets, dxl.goal_position.address, 2)
    for servo_id, goal in goals.items():
        client.ask("write1ByteTxRx", servo_id, dxl.torque_enable.address, 1)
        assert write.addParam(servo_id, list(goal.to_bytes(2, "little")))
    assert write.txPacket() == sdk.COMM_SUCCESS
    for servo_id, goal in goals.items():
        eventually(
            lambda i=servo_id, goal=goal: client.ask("read2ByteTxRx", i, dxl.present_position.address) == near(goal)  # type: ignore[misc]
        )


def test_reboot_and_factory_reset(connect: Connect) -> None:
    client = connect("xl430-w250", 2.0)
    client.ask("write1ByteTxRx", 3, TORQUE, 1)
    eventually(lambda: client.packets.reboot(client.port, 3)[0] == sdk.COMM_SUCCESS)
    assert client.ask("read1ByteTxRx", 3, TORQUE) == 0
    client.ask("write4ByteTxRx", 3, x.homing_offset.address, 77)
    eventually(lambda: client.packets.factoryReset(client.port, 3, 0x02)[0] == sdk.COMM_SUCCESS)
    assert client.ask("read4ByteTxRx", 3, x.homing_offset.address) == 0
