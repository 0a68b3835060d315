"""Options of the verbs that open an arm's port to have it moved by hand, and their keys."""

import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Final

import typer

from drivers.errors import DriverError
from servoloop.arms.folder import find_arm, read_arm_files
from servoloop.verbs.line import named_devices

if TYPE_CHECKING:
    from servoloop.teleop.arms import Side
    from servoloop.teleop.dead_man import Keys

SLOWEST_HZ, FASTEST_HZ = 20, 200
RATE_HZ: Final = 50

RateOption = Annotated[int, typer.Option("--rate", min=SLOWEST_HZ, max=FASTEST_HZ, help="Cycles a second.")]
HandsFreeOption = Annotated[
    bool, typer.Option("--hands-free", help="Move without a key that is held: have an emergency stop at hand.")
]
UnattendedOption = Annotated[
    bool,
    typer.Option("--hands-free", "--yes", help="Do not ask for a key that is held: have an emergency stop at hand."),
]
SpeedOption = Annotated[
    float, typer.Option(min=0.05, max=1.0, help="Share of the speed of the hand, or of the recording.")
]


def side_of(arm: str, port: str) -> "Side":
    """An arm's files and its devices. Raises errors that say what to do."""
    from servoloop.teleop.arms import Side

    files = read_arm_files(find_arm(arm))
    return Side(files, named_devices(port.split(","), files.robot.file.lines(), arm))


def require_keys(hands_free: bool) -> None:
    """Raise DriverError where no key could ever be held."""
    if not hands_free and not sys.stdin.isatty():
        raise DriverError("nobody can hold a key here, stdin is no terminal: run it in one, or say --hands-free")


@contextmanager
def permission_of(hands_free: bool, commands: Collection[str] = ()) -> "Iterator[Keys]":
    """The permission to move: a key of this terminal that is held, or always. ``commands``: keys that are none."""
    from servoloop.handling.keys import raw_keys
    from servoloop.teleop.dead_man import DeadMansKey, HandsFree

    if hands_free:
        yield HandsFree()
    else:
        with raw_keys():
            yield DeadMansKey(commands)
