"""Dynamixel clients to compare: each client reads the state of every servo and writes a goal to it."""

from collections.abc import Sequence
from dataclasses import replace
from struct import pack

from benchmarks.clients import peers
from benchmarks.clients.bare import bare
from benchmarks.clients.own import own_client
from benchmarks.clients.peers import Client, Driver, PeerWork, cycle_size
from drivers.bus.bus import Bus
from drivers.clock import MonotonicClock
from drivers.port import Port
from drivers.port.serial_port import SerialPort
from drivers.servos.dynamixel import X
from drivers.servos.indirect import AT_224
from drivers.servos.x import XL430_W250
from drivers.types import ServoGoal

WORK = PeerWork(
    X.blocks[0].address,
    X.blocks[0].size,
    X.goal_address,
    pack(f"<{X.goal_fields}", *X.goal_of(XL430_W250)(ServoGoal(2048))),
)


def _ours(port: Port, servo_ids: Sequence[int], identified: bool = True) -> Client:
    clock = MonotonicClock()
    bus = Bus(port, clock, dict.fromkeys(servo_ids, XL430_W250))
    if identified:
        for servo_id in servo_ids:
            bus.identify(servo_id, XL430_W250)
        bus.read_states(servo_ids)  # detects whether the servos support fast sync reads
    return own_client(bus, clock, servo_ids)


def ours(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """Use a fast sync read of the mapped register block, as the stack does."""
    return _ours(SerialPort(device, baud), servo_ids)


def no_driver(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """Send the same bytes as ``ours``, without decoding the replies."""
    return bare(_ours, device, baud, servo_ids)


def ours_plain(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """Use a sync read of the direct register block, as the other clients do."""
    return _ours(SerialPort(device, baud), servo_ids, identified=False)


def rustypot(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """Use the Rust driver."""
    import rustypot as library

    return peers.rustypot(library.Xl430PyController(device, baud, 0.05), servo_ids, WORK)


def dynamixel_sdk(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """Use the servo manufacturer's SDK."""
    import dynamixel_sdk as sdk

    return peers.makers_sdk(sdk, 2.0, device, baud, servo_ids, WORK)


def fast_sdk(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """Use a fast sync read with the servo manufacturer's SDK."""
    import dynamixel_sdk as sdk

    return peers.makers_sdk(sdk, 2.0, device, baud, servo_ids, replace(WORK, fast=True))


_PLAIN, _FAST = cycle_size(X, X.blocks[0]), cycle_size(X, X.blocks[0], fast=True)
_MAPPED = cycle_size(X, AT_224, fast=True)
CLIENTS: dict[str, Driver] = {
    "system calls alone": Driver(no_driver, _MAPPED),
    "servoloop": Driver(ours, _MAPPED),
    "servoloop, same bytes": Driver(ours_plain, _PLAIN),
    "rustypot": Driver(rustypot, _PLAIN),
    "dynamixel-sdk": Driver(dynamixel_sdk, _PLAIN),
    "dynamixel-sdk, fast sync read": Driver(fast_sdk, _FAST),
}
