"""Drivers of other projects as clients of a benchmark.

In each cycle, they read a block from every servo and write a goal to it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

Client = tuple[Callable[[], bool], Callable[[], None]]
"""Function that runs one cycle and returns whether every servo was read, and function that closes the port."""


@dataclass(frozen=True, slots=True)
class Work:
    """Registers that are read from and written to each servo."""

    state_address: int
    state_size: int
    goal_address: int
    goal: bytes


def rustypot(controller: Any, servo_ids: Sequence[int], work: Work) -> Client:
    """Return a rustypot client, which does not decode the bytes."""
    ids, goals = list(servo_ids), [list(work.goal) for _ in servo_ids]

    def cycle() -> bool:
        found: Any = controller.sync_read_raw_data(ids, work.state_address, work.state_size)
        controller.sync_write_raw_data(ids, work.goal_address, goals)
        return len(found) == len(ids)

    return cycle, controller.close


def makers_sdk(
    sdk: ModuleType, protocol: float, device: str, baud: int, servo_ids: Sequence[int], work: Work
) -> Client:
    """Return a client with the manufacturer's SDK and its own port."""
    port, packets = sdk.PortHandler(device), sdk.PacketHandler(protocol)
    assert port.openPort() and port.setBaudRate(baud)
    states = sdk.GroupSyncRead(port, packets, work.state_address, work.state_size)
    goals = sdk.GroupSyncWrite(port, packets, work.goal_address, len(work.goal))
    for servo_id in servo_ids:
        states.addParam(servo_id)

    def cycle() -> bool:
        result = states.txRxPacket()
        for servo_id in servo_ids:
            goals.addParam(servo_id, list(work.goal))
        goals.txPacket()
        goals.clearParam()
        return bool(result == sdk.COMM_SUCCESS)

    return cycle, port.closePort
