"""The drivers under comparison: each reads eight bytes of state from every servo and writes it a goal."""

from collections.abc import Callable, Sequence

from bench import peers
from bench.bare import bare
from bench.peers import Client, Work
from drivers.bus import ServoFault, ServoGoal
from drivers.clock import MonotonicClock
from drivers.feetech import state
from drivers.feetech.bus import FeetechBus
from drivers.port import Port
from drivers.serial_port import SerialPort

WORK = Work(state.STATE_ADDRESS, state.STATE_SIZE, state.GOAL_ADDRESS, bytes((0, 0, 8, 0, 0, 0, 0)))


def _ours(port: Port, servo_ids: Sequence[int]) -> Client:
    clock = MonotonicClock()
    bus = FeetechBus(port, clock)
    goals = {i: ServoGoal(2048) for i in servo_ids}

    def cycle() -> bool:
        readings = bus.exchange(goals, servo_ids, clock.now() + 0.05)
        return ServoFault not in set(map(type, readings.values()))

    return cycle, bus.close


def ours(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """States in, goals out, states decoded while the goals are on the wire; status too."""
    return _ours(SerialPort(device, baud), servo_ids)


def no_driver(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """The bytes of ``ours``, nothing decoded."""
    return bare(_ours, device, baud, servo_ids)


def ours_apart(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """As the control loop does it: states in and decoded, then goals out."""
    clock = MonotonicClock()
    bus = FeetechBus(SerialPort(device, baud, clock), clock)
    goals = {i: ServoGoal(2048) for i in servo_ids}

    def cycle() -> bool:
        readings = bus.read_states(servo_ids, clock.now() + 0.05)
        bus.write_goals(goals)
        return ServoFault not in set(map(type, readings.values()))

    return cycle, bus.close


def rustypot(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """The Rust driver."""
    import rustypot as library

    return peers.rustypot(library.Sts3215PyController(device, baud, 0.05), servo_ids, WORK)


def feetech_sdk(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """The servo maker's own."""
    import scservo_sdk as sdk

    return peers.makers_sdk(sdk, 0, device, baud, servo_ids, WORK)


CLIENTS: dict[str, Callable[[str, int, Sequence[int]], Client]] = {
    "system calls alone": no_driver,
    "servoloop": ours,
    "servoloop, two calls": ours_apart,
    "rustypot": rustypot,
    "feetech-servo-sdk": feetech_sdk,
}
