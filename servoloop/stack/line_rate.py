"""Reject a control rate that is too high for a bus, before any servo is enabled."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

from controller.manager_errors import ControllersFileError
from drivers.port.line import BITS_PER_BYTE
from drivers.types import ServoGoal
from hal.robot_file.robot import Robot


class RatedLine(Protocol):
    """Bus with a baud rate and a known number of bytes per cycle."""

    @property
    def name(self) -> str: ...

    @property
    def baud(self) -> int: ...

    def exchange_size(self, goals: Mapping[int, ServoGoal], servo_ids: Sequence[int]) -> int: ...


def check_rates(buses: Mapping[str, RatedLine], rates_hz: Mapping[str, float], robot: Robot, file: Path) -> None:
    """Check that each open bus can transfer its goals and states at the required rate.

    Args:
        buses: Open buses, keyed by name.
        rates_hz: Read and write rate of each bus, in Hz.
        robot: The robot file.
        file: Path of the controllers file, for the message.

    Raises:
        ControllersFileError: The transfers of one cycle take longer than the cycle period. The message shows the
            calculation.
    """
    problems = [_problem(bus, rates_hz[name], robot, name) for name, bus in buses.items()]
    if any(problems):
        raise ControllersFileError("\n".join(f"{file}: {problem}" for problem in problems if problem))


def _problem(bus: RatedLine, rate_hz: float, robot: Robot, name: str) -> str:
    ids = [joint.servo_id for joint in robot.joints if joint.bus == name]
    size = bus.exchange_size(dict.fromkeys(ids, ServoGoal(0)), ids)
    wire_s = size * BITS_PER_BYTE / bus.baud
    if rate_hz * wire_s <= 1.0:
        return ""
    return (
        f"{rate_hz:g} Hz is too fast for {bus.name}. The goals and states of {len(ids)} servos take {size} bytes or "
        f"{wire_s * 1e3:.2f} ms per cycle at {bus.baud} bit/s, but the period is {1e3 / rate_hz:.2f} ms: set "
        f"update_rate to {int(1.0 / wire_s)} or less, set rw_rate in the URDF, or raise the servos' baud rate"
    )
