"""The drivers under comparison: each reads eight bytes of state from every servo and writes it a goal."""

from collections.abc import Callable, Sequence
from typing import Any

from drivers.bus import ServoFault, ServoGoal
from drivers.clock import MonotonicClock
from drivers.feetech import state
from drivers.feetech.bus import FeetechBus
from drivers.serial_port import SerialPort

Client = tuple[Callable[[], bool], Callable[[], None]]
"""One cycle, which says whether every servo was read, and how to close the port."""

GOAL = bytes((0, 0, 8, 0, 0, 0, 0))


def ours(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """States in, goals out, states decoded while the goals are on the wire; status too."""
    clock = MonotonicClock()
    bus = FeetechBus(SerialPort(device, baud, clock), clock)
    goals = {i: ServoGoal(2048) for i in servo_ids}

    def cycle() -> bool:
        readings = bus.exchange(goals, servo_ids, clock.now() + 0.05)
        return ServoFault not in set(map(type, readings.values()))

    return cycle, bus.close


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
    """The Rust driver. Its bytes stay bytes: nothing is decoded."""
    import rustypot as library

    controller = library.Sts3215PyController(device, baud, 0.05)
    ids, goals = list(servo_ids), [list(GOAL) for _ in servo_ids]

    def cycle() -> bool:
        found: Any = controller.sync_read_raw_data(ids, state.STATE_ADDRESS, state.STATE_SIZE)
        controller.sync_write_raw_data(ids, state.GOAL_ADDRESS, goals)
        return len(found) == len(ids)

    return cycle, controller.close


def feetech_sdk(device: str, baud: int, servo_ids: Sequence[int]) -> Client:
    """The servo maker's own, with its own port."""
    import scservo_sdk as sdk

    port, packets = sdk.PortHandler(device), sdk.PacketHandler(0)
    assert port.openPort() and port.setBaudRate(baud)
    states = sdk.GroupSyncRead(port, packets, state.STATE_ADDRESS, state.STATE_SIZE)
    goals = sdk.GroupSyncWrite(port, packets, state.GOAL_ADDRESS, state.GOAL_SIZE)
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
    "servoloop, two calls": ours_apart,
    "rustypot": rustypot,
    "feetech-servo-sdk": feetech_sdk,
}
