"""``servoloop teleop``: a follower arm goes where a leader arm is moved by hand."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from servoloop.arms.folder import find_arm, read_arm_files
from servoloop.ports import parse_ports
from servoloop.verbs.ros_options import log_to_terminal

if TYPE_CHECKING:
    from servoloop.teleop.arms import Side
    from servoloop.teleop.dead_man import Permission

SLOWEST_HZ, FASTEST_HZ = 20, 200


def teleop(
    leader: Annotated[str, typer.Argument(help="Serial device of the leader; NAME=PATH,NAME=PATH of several buses.")],
    follower: Annotated[str, typer.Argument(help="Serial device of the follower.")],
    leader_arm: Annotated[
        str, typer.Option(help="The leader: a name that `servoloop arms` lists, or its folder.")
    ] = "so101_leader",
    follower_arm: Annotated[str, typer.Option(help="The follower, in the same way.")] = "so101",
    rate_hz: Annotated[int, typer.Option("--rate", min=SLOWEST_HZ, max=FASTEST_HZ, help="Cycles a second.")] = 50,
    hands_free: Annotated[
        bool, typer.Option("--hands-free", help="Follow without a key that is held: have an emergency stop at hand.")
    ] = False,
) -> None:
    """Let a follower arm go where a leader arm is moved by hand, as long as a key is held: any but q, which ends.

    The follower joins the leader slowly, then follows. It holds when the key is let go or the leader is lost, and
    joins anew when it may go on. In the end it is left as its robot file says; the leader is limp all the time.
    Example: `servoloop teleop /dev/ttyACM0 /dev/ttyACM1`
    """
    from rich.console import Console

    from servoloop.teleop.errors import TeleopError
    from servoloop.teleop.screen import Screen
    from servoloop.teleop.teleop import teleop as run

    if not hands_free and not sys.stdin.isatty():
        raise TeleopError("nobody can hold a key here, stdin is no terminal: run it in one, or say --hands-free")
    log_to_terminal()
    sides = _side(leader_arm, leader), _side(follower_arm, follower)
    if set(sides[0].devices.values()) & set(sides[1].devices.values()):
        raise TeleopError("leader and follower cannot share a port: name the device of each")
    console = Console()
    with _permission(hands_free) as permission, Screen(console) as screen:
        status = run(*sides, rate_hz, permission, screen.show)
    console.print(screen.summary, highlight=False)
    raise typer.Exit(status)


def _side(arm: str, port: str) -> "Side":
    from servoloop.teleop.arms import Side
    from servoloop.teleop.errors import TeleopError

    files = read_arm_files(find_arm(arm))
    devices = parse_ports(port.split(","), files.robot.file.lines())
    if devices is None:
        raise TeleopError(f"{port!r} is no device: virtual arms are served by `servoloop emulate LINK --arm {arm}`")
    return Side(files, devices)


@contextmanager
def _permission(hands_free: bool) -> "Iterator[Permission]":
    from servoloop.handling.keys import raw_keys
    from servoloop.teleop.dead_man import DeadMansKey, HandsFree

    if hands_free:
        yield HandsFree()
    else:
        with raw_keys():
            yield DeadMansKey()
