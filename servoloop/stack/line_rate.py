"""The control rate against the line's: one that a bus cannot carry is refused before any servo gets torque."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, Protocol

from controller.manager.controllers_file import ControllersFileError
from drivers.bus.types import ServoGoal
from hal.robot_file.robot import Robot

BITS_PER_BYTE: Final = 10
"""On the wire: a start bit, eight of data, a stop bit."""


class Line(Protocol):
    """A line carries a number of bits a second; a bus says how many bytes its cycle has."""

    @property
    def name(self) -> str: ...

    @property
    def baud(self) -> int: ...

    def exchange_size(self, goals: Mapping[int, ServoGoal], servo_ids: Sequence[int]) -> int: ...


def check_rates(buses: Mapping[str, Line], rates_hz: Mapping[str, float], robot: Robot, file: Path) -> None:
    """Compare each open bus with the rate at which it is to be read and written.

    Raises ControllersFileError with the arithmetic, for each bus that has less than its bytes' time on the wire.
    ``file``: where the rate stands.
    """
    problems = [_problem(bus, rates_hz[name], robot, name) for name, bus in buses.items()]
    if any(problems):
        raise ControllersFileError("\n".join(f"{file}: {problem}" for problem in problems if problem))


def _problem(bus: Line, rate_hz: float, robot: Robot, name: str) -> str:
    ids = [joint.servo_id for joint in robot.joints if joint.bus == name]
    size = bus.exchange_size(dict.fromkeys(ids, ServoGoal(0)), ids)
    wire_s = size * BITS_PER_BYTE / bus.baud
    if rate_hz * wire_s <= 1.0:
        return ""
    return (
        f"{rate_hz:g} Hz are more than {bus.name} carries. Goals and states of {len(ids)} servos are {size} bytes a "
        f"cycle, {wire_s * 1e3:.2f} ms at {bus.baud} bit/s, and a cycle has {1e3 / rate_hz:.2f} ms: set update_rate to "
        f"{int(1.0 / wire_s)} at most, or rw_rate in the URDF, or raise the servos' baud rate"
    )
