"""Feetech clients to compare: each client reads an eight-byte state from every servo and writes a goal to it."""

from collections.abc import Sequence

from benchmarks.clients import peers
from benchmarks.clients.bare import bare
from benchmarks.clients.own import own_client
from benchmarks.clients.peers import Client, Driver, PeerWork, cycle_size
from drivers.bus.bus import Bus
from drivers.clock import MonotonicClock
from drivers.port import Port
from drivers.port.serial_port import SerialPort
from drivers.servos.feetech import STS

WORK = PeerWork(STS.blocks[0].address, STS.blocks[0].size, STS.goal_address, bytes((0, 0, 8, 0, 0, 0, 0)))


def _ours(port: Port, servo_ids: Sequence[int]) -> Client:
    clock = MonotonicClock()
    bus = Bus(port, clock)
    return own_client(bus, clock, servo_ids)


def ours(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """Read and decode the states, including the status, and then write the goals, as the control loop does."""
    return _ours(SerialPort(device, baud), servo_ids)


def no_driver(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """Send the same bytes as ``ours``, without decoding the replies."""
    return bare(_ours, device, baud, servo_ids)


def rustypot(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """Use the Rust driver."""
    import rustypot as library

    return peers.rustypot(library.Sts3215PyController(device, baud, 0.05), servo_ids, WORK)


def feetech_sdk(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """Use the servo maker's SDK."""
    import scservo_sdk as sdk

    return peers.makers_sdk(sdk, 0, device, baud, servo_ids, WORK)


_SIZE = cycle_size(STS, STS.blocks[0])
CLIENTS: dict[str, Driver] = {
    "system calls alone": Driver(no_driver, _SIZE),
    "servoloop": Driver(ours, _SIZE),
    "rustypot": Driver(rustypot, _SIZE),
    "feetech-servo-sdk": Driver(feetech_sdk, _SIZE),
}
