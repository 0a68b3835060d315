"""The virtual Dynamixel bus on a pseudo-terminal, used by the official SDK as it is."""

import importlib
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from drivers.servos import x
from sim_backend.dynamixel_bus import VirtualDynamixelBus
from sim_backend.emulator import serve
from sim_backend.plant import BenchPlant

# By name, because it has no types.
sdk: Any = importlib.import_module("dynamixel_sdk")
IDS = (1, 2, 3)
POSITION, GOAL = x.present_position.address, x.goal_position.address


@pytest.fixture
def port(tmp_path: Path) -> Iterator[Any]:
    link, ready, ended = tmp_path / "bus", threading.Event(), threading.Event()
    bus = VirtualDynamixelBus.of(BenchPlant(IDS), dict.fromkeys(IDS, x.XL430_W250))
    server = threading.Thread(target=lambda: serve(bus, link, stop=ended.is_set, on_ready=ready.set))
    server.start()
    try:
        assert ready.wait(20)
        handler = sdk.PortHandler(str(link))
        assert handler.openPort()
        yield handler
        handler.closePort()
    finally:
        ended.set()
        server.join(20)


def eventually(answered: Callable[[], bool], within_s: float = 20.0) -> None:
    """A busy machine loses answers: they are asked for again."""
    deadline_s = time.monotonic() + within_s
    while not answered():
        assert time.monotonic() < deadline_s, "waited in vain"
        time.sleep(0.01)


def test_the_sdk_pings_reads_writes_and_moves(port: Any) -> None:
    handler = sdk.PacketHandler(2.0)
    for i in IDS:
        eventually(lambda i=i: handler.ping(port, i) == (1060, sdk.COMM_SUCCESS, 0))  # type: ignore[misc]
        eventually(lambda i=i: handler.write1ByteTxRx(port, i, 64, 1) == (sdk.COMM_SUCCESS, 0))  # type: ignore[misc]
    eventually(lambda: handler.read4ByteTxRx(port, 1, POSITION)[:2] == (2048, sdk.COMM_SUCCESS))
    writer = sdk.GroupSyncWrite(port, handler, GOAL, 4)
    for n, i in enumerate(IDS):
        assert writer.addParam(i, list((2048 + 100 * n).to_bytes(4, "little")))
    eventually(lambda: writer.txPacket() == sdk.COMM_SUCCESS)
    reader = sdk.GroupSyncRead(port, handler, POSITION, 4)
    for i in IDS:
        assert reader.addParam(i)

    def arrived() -> bool:
        if reader.txRxPacket() != sdk.COMM_SUCCESS:
            return False
        return all(abs(reader.getData(i, POSITION, 4) - 2048 - 100 * n) < 15 for n, i in enumerate(IDS))

    eventually(arrived)
    eventually(lambda: reader.fastSyncRead() == sdk.COMM_SUCCESS)
    assert all(abs(reader.getData(i, POSITION, 4) - 2048 - 100 * n) < 15 for n, i in enumerate(IDS))
