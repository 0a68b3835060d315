"""Drivers from other projects as benchmark clients.

In each cycle, each driver reads a block from every servo and writes a goal to it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any, NamedTuple

from drivers.bus.fast_read import fast_plan
from drivers.bus.read_plan import state_plan
from drivers.servos.series import Series, StateBlock

Client = tuple[Callable[[], bool], Callable[[], None]]
"""A pair of functions: the first runs a cycle and returns whether every servo was read; the second closes the port."""


class Driver(NamedTuple):
    """A driver to compare."""

    open: Callable[[str, int, Sequence[int]], Client]
    """Function that opens a device at a baud rate for the servos with these IDs."""
    cycle_size: Callable[[int], int]
    """Function that returns the number of bytes in a cycle for a given number of servos: request, replies and goals."""

    def wire_us(self, servos: int, baud: int) -> float:
        """Return the transmission time of a cycle, in microseconds."""
        return 10.0 * self.cycle_size(servos) * 1e6 / baud


def cycle_size(series: Series, block: StateBlock, *, fast: bool = False) -> Callable[[int], int]:
    """Return the function ``Driver.cycle_size`` for a driver that reads the given block. If ``fast`` is true, the
    driver uses a fast sync read."""
    goal_size = len(series.protocol.packets.sync_write(series.goal_address, series.goal_size, b""))

    def size(servos: int) -> int:
        scales = dict.fromkeys(range(1, servos + 1))
        plain = state_plan(series.protocol, dict.fromkeys(scales, block), scales)
        plan = fast_plan(block, scales) if fast else plain
        return plan.exchange_size + goal_size + (1 + series.goal_size) * servos

    return size


@dataclass(frozen=True, slots=True)
class PeerWork:
    """Registers to read from and write to on each servo."""

    state_address: int
    state_size: int
    goal_address: int
    goal: bytes
    fast: bool = False
    """Whether the manufacturer's SDK uses fast sync reads."""


def rustypot(controller: Any, servo_ids: Sequence[int], work: PeerWork) -> Client:
    """Return a rustypot client, which does not decode the bytes."""
    ids, goals = list(servo_ids), [list(work.goal) for _ in servo_ids]

    def cycle() -> bool:
        try:
            found: Any = controller.sync_read_raw_data(ids, work.state_address, work.state_size)
        except RuntimeError:  # A timeout can occur because the machine is busy.
            return False
        controller.sync_write_raw_data(ids, work.goal_address, goals)
        return len(found) == len(ids)

    return cycle, controller.close


def makers_sdk(
    sdk: ModuleType, protocol: float, device: str, baud: int, servo_ids: Sequence[int], work: PeerWork
) -> Client:
    """Return a client that uses the manufacturer's SDK and its own port."""
    port, packets = sdk.PortHandler(device), sdk.PacketHandler(protocol)
    assert port.openPort() and port.setBaudRate(baud)
    states = sdk.GroupSyncRead(port, packets, work.state_address, work.state_size)
    goals = sdk.GroupSyncWrite(port, packets, work.goal_address, len(work.goal))
    for servo_id in servo_ids:
        states.addParam(servo_id)

    read = states.fastSyncRead if work.fast else states.txRxPacket

    def cycle() -> bool:
        result = read()
        for servo_id in servo_ids:
            goals.addParam(servo_id, list(work.goal))
        goals.txPacket()
        goals.clearParam()
        return bool(result == sdk.COMM_SUCCESS)

    return cycle, port.closePort
