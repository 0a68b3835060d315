"""Assign the ports given on the command line to the buses of the leader and the follower."""

from collections.abc import Sequence

from servoloop.stack.arm_folders import find_arm, read_arm_servos
from servoloop.teleop.arms import TeleopError


def bus_names(arm: str) -> tuple[str, ...]:
    """Return the names of the buses of an arm, such as ``left`` and ``right``. Raises HalError."""
    return tuple(read_arm_servos(find_arm(arm)).robot.file.lines())


def port_pairs(ports: Sequence[str], leader: Sequence[str], follower: Sequence[str]) -> tuple[str, str]:
    """Return the port options for the leader and the follower.

    Args:
        ports: Ports from the command line: leader and follower, or leader and follower for each bus, in the order of
            the follower's buses.
        leader: Buses of the leader.
        follower: Buses of the follower.

    Returns:
        One option for each arm. If an arm has several buses, its option contains NAME=PATH for each bus.

    Raises:
        TeleopError: The ports do not match the buses.
    """
    if len(ports) == 2:
        return ports[0], ports[1]
    if len(ports) < 2 or len(ports) % 2:
        raise TeleopError(f"{len(ports)} ports cannot form leader-follower pairs: pass both ports of each pair")
    pairs = len(ports) // 2
    if pairs != len(follower) or set(leader) != set(follower):
        raise TeleopError(
            f"{pairs} pairs of ports do not match the buses of the leader ({_listed(leader)}) and the follower "
            f"({_listed(follower)}): combine the arms of each side with `servoloop arms combine`, use the same "
            "prefixes on both sides, and pass --leader-arm and --follower-arm"
        )
    named = [",".join(f"{bus}={port}" for bus, port in zip(follower, ports[side::2], strict=True)) for side in (0, 1)]
    return named[0], named[1]


def _listed(buses: Sequence[str]) -> str:
    return ", ".join(bus or "one without a name" for bus in buses)
