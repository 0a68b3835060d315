"""``servoloop teleop``: a follower arm goes where a leader arm is moved by hand."""

from functools import partial
from typing import Annotated

import typer

from servoloop.verbs.by_hand import RATE_HZ, HandsFreeOption, RateOption, permission_of, require_keys, side_of
from servoloop.verbs.ros_options import log_to_terminal


def teleop(
    leader: Annotated[str, typer.Argument(help="Serial device of the leader; NAME=PATH,NAME=PATH of several buses.")],
    follower: Annotated[str, typer.Argument(help="Serial device of the follower.")],
    leader_arm: Annotated[
        str, typer.Option(help="The leader: a name that `servoloop arms` lists, or its folder.")
    ] = "so101_leader",
    follower_arm: Annotated[str, typer.Option(help="The follower, in the same way.")] = "so101",
    rate_hz: RateOption = RATE_HZ,
    hands_free: HandsFreeOption = False,
) -> None:
    """Let a follower arm go where a leader arm is moved by hand, as long as a key is held: any but a and q.

    The follower joins the leader slowly, then follows. It holds when the key is let go or the leader is lost, and
    joins anew when it may go on. Key a gives torque back to servos of the follower that have released, where they
    stand; q ends. In the end the follower is left as its robot file says; the leader is limp all the time. If the
    leader holds torque at the start, a question comes first, because what it holds falls.
    Example: `servoloop teleop /dev/ttyACM0 /dev/ttyACM1`
    """
    from rich.console import Console

    from servoloop.teleop.attendance import HANDS_FREE_HINT, HINT, REACTIVATE
    from servoloop.teleop.errors import TeleopError
    from servoloop.teleop.screen import Screen
    from servoloop.teleop.teleop import teleop as run
    from servoloop.verbs.output import confirm

    require_keys(hands_free)
    log_to_terminal()
    sides = side_of(leader_arm, leader), side_of(follower_arm, follower)
    if set(sides[0].devices.values()) & set(sides[1].devices.values()):
        raise TeleopError("leader and follower cannot share a port: name the device of each")
    keys = partial(permission_of, hands_free, (REACTIVATE,))
    screen = Screen(Console(), keys, partial(confirm, yes=False), HANDS_FREE_HINT if hands_free else HINT)
    status = run(*sides, rate_hz, screen)
    screen.console.print(screen.summary, highlight=False)
    raise typer.Exit(status)
