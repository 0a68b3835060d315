"""The drivers under comparison on a Dynamixel line: each reads the state of every servo and writes it a goal."""

from collections.abc import Callable, Sequence
from typing import Any

from bench.clients import Client
from drivers.bus import ServoFault, ServoGoal
from drivers.clock import MonotonicClock
from drivers.dynamixel import x_series
from drivers.dynamixel.bus import DynamixelBus
from drivers.dynamixel.models import X
from drivers.serial_port import SerialPort

BLOCK = X.blocks[0]
GOAL = X.goal(ServoGoal(2048))


def _ours(device: str, baud: int, servo_ids: Sequence[int], identified: bool) -> Client:
    clock = MonotonicClock()
    bus = DynamixelBus(SerialPort(device, baud, clock), clock, dict.fromkeys(servo_ids, x_series.XL430_W250))
    if identified:
        for servo_id in servo_ids:
            bus.identify(servo_id, x_series.XL430_W250)
        bus.read_states(servo_ids)  # finds out whether they answer fast sync reads
    goals = {i: ServoGoal(2048) for i in servo_ids}

    def cycle() -> bool:
        readings = bus.exchange(goals, servo_ids, clock.now() + 0.05)
        return ServoFault not in set(map(type, readings.values()))

    return cycle, bus.close


def ours(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """As the stack uses it: fast sync read of the mapped block."""
    return _ours(device, baud, servo_ids, identified=True)


def ours_plain(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """The very bytes that the others send and read: sync read of the direct block."""
    return _ours(device, baud, servo_ids, identified=False)


def rustypot(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """The Rust driver. Its bytes stay bytes: nothing is decoded."""
    import rustypot as library

    controller = library.Xl430PyController(device, baud, 0.05)
    ids, goals = list(servo_ids), [list(GOAL) for _ in servo_ids]

    def cycle() -> bool:
        found: Any = controller.sync_read_raw_data(ids, BLOCK.address, BLOCK.size)
        controller.sync_write_raw_data(ids, X.goal_address, goals)
        return len(found) == len(ids)

    return cycle, controller.close


def dynamixel_sdk(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """The servo maker's own, with its own port."""
    import dynamixel_sdk as sdk

    port, packets = sdk.PortHandler(device), sdk.PacketHandler(2.0)
    assert port.openPort() and port.setBaudRate(baud)
    states = sdk.GroupSyncRead(port, packets, BLOCK.address, BLOCK.size)
    goals = sdk.GroupSyncWrite(port, packets, X.goal_address, X.goal_size)
    for servo_id in servo_ids:
        states.addParam(servo_id)

    def cycle() -> bool:
        result = states.txRxPacket()
        for servo_id in servo_ids:
            goals.addParam(servo_id, list(GOAL))
        goals.txPacket()
        goals.clearParam()
        return bool(result == sdk.COMM_SUCCESS)

    return cycle, port.closePort


CLIENTS: dict[str, Callable[[str, int, Sequence[int]], Client]] = {
    "servoloop": ours,
    "servoloop, same bytes": ours_plain,
    "rustypot": rustypot,
    "dynamixel-sdk": dynamixel_sdk,
}
