"""``servoloop teach``: motions that a hand shows, recorded and played back."""

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

from drivers.printable import counted
from servoloop.commands.console import JsonOption, YesOption, confirm, print_json
from servoloop.commands.options import (
    RATE_HZ,
    HandsFreeOption,
    RateOption,
    SpeedOption,
    UnattendedOption,
    permission_of,
    require_keys,
    side_of,
)
from servoloop.stack.arm_folders import OWN, find_arm
from servoloop.stack.terminal import log_to_terminal, print_styled

if TYPE_CHECKING:
    from servoloop.teach.taught import RecordedMotion
    from servoloop.teleop.arms import Side


app = typer.Typer(no_args_is_help=True, help="Motions that a hand shows: recorded, played back.")
Name = Annotated[str, typer.Argument(help="The motion's name.")]
Port = Annotated[str, typer.Option(help="Serial device of the arm; NAME=PATH,NAME=PATH of several buses.")]
AnArm = Annotated[str, typer.Option("--arm", help="The arm: a name that `servoloop arms` lists, or its folder.")]


@app.command()
def record(
    name: Name,
    port: Port,
    arm: AnArm = OWN,
    limp: Annotated[
        bool,
        typer.Option("--limp", help="Torque off: the arm moves more easily, and falls if it is let go."),
    ] = False,
    poses: Annotated[
        bool, typer.Option("--poses", help="Poses instead of a path: one at each Enter or p; q ends.")
    ] = False,
    yes: YesOption = False,
    rate_hz: RateOption = RATE_HZ,
) -> None:
    """Record how the arm is moved by hand, until Enter.

    It holds itself softly, and gives way to the hand. In the end it holds itself as it is left, and then is held or
    parked as its robot file says. Example: `servoloop teach record wave --arm so101 --port /dev/ttyACM0`
    """
    from rich.console import Console

    from servoloop.teach.run import record as run
    from servoloop.teach.screen import Teacher
    from servoloop.teach.taught import MotionStore

    side, motions = side_of(arm, port), MotionStore(find_arm(arm).folder)
    motions.require_writable()
    if motions.path(name).exists():
        confirm(f"{name} is there already. Record it anew?", yes)

    def keep(taught: "RecordedMotion", warnings: Sequence[str]) -> None:
        motions.save(name, taught, {joint.name: joint for joint in side.files.robot.joints})
        for warning in warnings:
            print_styled(f"! {warning}", fg="yellow")
        typer.echo(f"{name}: {said(taught)}, kept in {motions.path(name)}")

    log_to_terminal()
    teacher = Teacher(Console(), lambda question: _say_and_confirm(question, yes))
    raise typer.Exit(run(side, rate_hz, limp, poses, teacher, keep))


@app.command()
def play(
    name: Name,
    port: Port,
    arm: AnArm = OWN,
    speed: SpeedOption = 1.0,
    hands_free: UnattendedOption = False,
    rate_hz: RateOption = RATE_HZ,
) -> None:
    """Play a motion back, as long as a key is held: any but q, which ends.

    The arm goes slowly to where the motion begins, then follows it. Without the key it stands. In the end it is left
    as its robot file says. Example: `servoloop teach play wave --arm so101 --port /dev/ttyACM0 --speed 0.5`
    """
    from servoloop.teach.taught import MotionStore

    require_keys(hands_free)
    side, motions = side_of(arm, port), MotionStore(find_arm(arm).folder)
    joints = side.files.robot.joints
    taught = motions.get(name).of([joint.name for joint in joints], name)
    taught.check_units(joints, str(motions.path(name)))
    taught.check([joint.limits for joint in joints], str(motions.path(name)))
    raise typer.Exit(played(side, taught, speed, hands_free, rate_hz))


@app.command("list")
def list_(arm: AnArm = OWN, json: JsonOption = False) -> None:
    """List an arm's motions.

    Example: `servoloop teach list --arm so101`
    """
    from servoloop.teach.taught import MotionStore

    motions = MotionStore(find_arm(arm).folder).all()
    if json:
        print_json({name: _plain(taught) for name, taught in motions.items()})
        return
    for name, taught in motions.items():
        typer.echo(f"{name}: {said(taught)}")


@app.command()
def remove(name: Name, arm: AnArm = OWN) -> None:
    """Forget a motion.

    Example: `servoloop teach remove wave --arm so101`
    """
    from servoloop.teach.taught import MotionStore

    MotionStore(find_arm(arm).folder).remove(name)
    typer.echo(f"{name} is forgotten")


def played(side: "Side", taught: "RecordedMotion", speed: float, hands_free: bool, rate_hz: int) -> int:
    """Play a motion of the arm's joints, and show how it goes; the exit status."""
    from rich.console import Console

    from servoloop.teach.run import play as run
    from servoloop.teach.screen import Screen

    log_to_terminal()
    with permission_of(hands_free) as permission, Screen(Console()) as screen:
        return run(side, rate_hz, taught, speed, permission, screen.show)


def said(taught: "RecordedMotion") -> str:
    """A motion in words."""
    if taught.path is None:
        return counted(len(taught.position), "pose")
    return f"a path of {taught.path.duration_s:.1f} s through {counted(len(taught.position), 'point')}"


def _plain(taught: "RecordedMotion") -> dict[str, object]:
    """A motion for programs."""
    kind, duration_s = ("path", taught.path.duration_s) if taught.path else ("poses", None)
    return {"kind": kind, "joints": taught.joints, "points": len(taught.position), "duration_s": duration_s}


def _say_and_confirm(question: str, yes: bool) -> None:
    """Ask; where nobody wants to be asked, say it nevertheless."""
    if yes:
        typer.echo(question, err=True)
    confirm(question, yes)


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

    from servoloop.commands.console import confirm
    from servoloop.teleop.arms import TeleopError
    from servoloop.teleop.attendance import HANDS_FREE_HINT, HINT, REACTIVATE
    from servoloop.teleop.screen import Screen
    from servoloop.teleop.teleop import teleop as run

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
