"""``servoloop teach`` and ``teleop``: record motions that you show by hand and play them back, and follow a leader."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, Final

import typer

from drivers.printable import counted
from servoloop.commands.shared.console import JsonOption, YesOption, confirm, print_json
from servoloop.commands.shared.option_groups import grouped_options
from servoloop.commands.shared.options import (
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
from servoloop.stack.arm_options import ArmOption, RunningChoice, RunningNamespace
from servoloop.stack.terminal import log_to_terminal, print_styled

if TYPE_CHECKING:
    from servoloop.api.arm import Arm
    from servoloop.teach.taught import MotionStore, RecordedMotion
    from servoloop.teleop.arms import Side


PLAY_S: Final = 0.02
"""Period at which the dead-man key is checked, in seconds."""
app = typer.Typer(no_args_is_help=True, help="Record motions that you show by hand, and play them back.")
Name = Annotated[str, typer.Argument(help="Name of the motion.")]


@dataclass(frozen=True, slots=True)
class ArmAtPort:
    """Real or emulated arm, and its serial port."""

    port: Annotated[str, typer.Option(help="Serial port of the arm, or NAME=PATH,NAME=PATH for several buses.")]
    arm: ArmOption = OWN

    def opened(self) -> "tuple[Side, MotionStore]":
        """Return the files and devices of the arm, and its recorded motions. Raises HalError or DriverError."""
        from servoloop.teach.taught import MotionStore

        return side_of(self.arm, self.port), MotionStore(find_arm(self.arm).folder)


@app.command()
@grouped_options
def record(
    name: Name,
    place: ArmAtPort,
    limp: Annotated[
        bool,
        typer.Option("--limp", help="Switch the torque off. The arm moves more easily, but falls when you release it."),
    ] = False,
    poses: Annotated[
        bool, typer.Option("--poses", help="Record single poses instead of a path: one at each Enter or p; q ends.")
    ] = False,
    yes: YesOption = False,
    rate_hz: RateOption = RATE_HZ,
) -> None:
    """Record a motion while you move the arm by hand, until you press Enter.

    The arm holds its position softly and yields to your hand. At the end the arm holds its last position, or parks, as
    set by on_exit in its robot file. Example: `servoloop teach record wave --arm so101 --port /dev/ttyACM0`
    """
    from rich.console import Console

    from servoloop.teach.run import record as run
    from servoloop.teach.screen import Teacher

    side, motions = place.opened()
    motions.require_writable()
    if motions.path(name).exists():
        confirm(f"The motion {name} exists already. Replace it?", yes)

    def keep(motion: "RecordedMotion", warnings: Sequence[str]) -> None:
        motions.save(name, motion, {joint.name: joint for joint in side.files.robot.joints})
        for warning in warnings:
            print_styled(f"! {warning}", fg="yellow")
        typer.echo(f"{name}: {summary(motion)}, saved in {motions.path(name)}")

    log_to_terminal()
    teacher = Teacher(Console(), lambda question: _print_and_confirm(question, yes))
    raise typer.Exit(run(side, rate_hz, limp, poses, teacher, keep))


@dataclass(frozen=True, slots=True)
class PlayOptions:
    """Speed and supervision of a motion that is played back."""

    speed: SpeedOption = 1.0
    hands_free: UnattendedOption = False
    rate_hz: RateOption = RATE_HZ


@app.command()
@grouped_options
def play(
    *,
    name: Name,
    port: Annotated[
        str | None,
        typer.Option(
            help="Serial port of the arm, or NAME=PATH,NAME=PATH for several buses (default: the arm of the running "
            "`servoloop up`)."
        ),
    ] = None,
    arm: Annotated[
        str | None,
        typer.Option(
            help="Arm: a name that `servoloop arms` lists, or an arm folder. Without --port: name, folder or process "
            "ID of the running arm."
        ),
    ] = None,
    namespace: RunningNamespace = None,
    options: PlayOptions,
) -> None:
    """Play back a recorded motion while you hold a key.

    Any key except q works; q ends the command. The arm first moves slowly to the start of the motion, then it follows
    the motion. The arm stops when you release the key. At the end the arm holds or parks, as set by on_exit in its
    robot file. Without --port, the motion is played on the arm of the running `servoloop up`, which then holds its
    position.
    Example: `servoloop teach play wave --arm so101 --port /dev/ttyACM0 --speed 0.5`
    """
    require_keys(options.hands_free)
    if port is None:
        chosen = RunningChoice(arm, namespace)
        played_on_running_arm(chosen, partial(_saved_motion, name=name), options.speed, options.hands_free)
        return
    side, motions = ArmAtPort(port, arm or OWN).opened()
    joints = side.files.robot.joints
    motion = motions.get(name).of([joint.name for joint in joints], name)
    motion.check_units(joints, str(motions.path(name)))
    motion.check([joint.limits for joint in joints], str(motions.path(name)))
    raise typer.Exit(played(side, motion, options.speed, options.hands_free, options.rate_hz))


def _saved_motion(arm: "Arm", name: str) -> "RecordedMotion":
    """Return a saved motion of a running arm. Raises TeachError if the motion does not fit the arm."""
    from servoloop.teach.taught import MotionStore, TeachError

    if arm.folder is None:
        raise TeachError(f"the motions of {arm.name} are unknown: its stack does not report its folder")
    motions = MotionStore(arm.folder)
    motion = motions.get(name).of(arm.joints, name)
    motion.check([arm.limits[joint] for joint in arm.joints], str(motions.path(name)))
    return motion


def played_on_running_arm(
    choice: RunningChoice, motion_of: Callable[["Arm"], "RecordedMotion"], speed: float, hands_free: bool
) -> None:
    """Play a motion on the arm of ``servoloop up`` and print each phase.

    Args:
        choice: The running arm.
        motion_of: Returns the motion for an arm, with its joints in their order.
        speed: Share of the recorded speed, from 0 to 1.
        hands_free: Whether to move without a dead-man key.
    """
    from servoloop.api.arm import Arm
    from servoloop.stack.processes import Interrupted
    from servoloop.stack.signals import Signals
    from servoloop.teach.running_play import RunningPlay

    with (
        Signals() as signals,
        Arm.connect(choice.arm, namespace=choice.namespace) as arm,
        permission_of(hands_free) as permission,
    ):
        playing, shown = RunningPlay(arm, motion_of(arm), speed, permission), ""
        while playing.update():
            if signals.count:
                raise Interrupted("interrupted; the arm has stopped")
            if playing.phase != shown:
                shown = playing.phase
                typer.echo(f"{shown}\r", err=True)
            arm.sleep(PLAY_S)
        typer.echo(f"{arm.name} holds its position: {playing.phase}")


@app.command("list")
def list_(arm: ArmOption = OWN, json: JsonOption = False) -> None:
    """List the recorded motions of an arm.

    Example: `servoloop teach list --arm so101`
    """
    from servoloop.teach.taught import MotionStore

    motions = MotionStore(find_arm(arm).folder).all()
    if json:
        print_json({name: _plain(motion) for name, motion in motions.items()})
        return
    for name, motion in motions.items():
        typer.echo(f"{name}: {summary(motion)}")


@app.command()
def remove(name: Name, arm: ArmOption = OWN) -> None:
    """Remove a recorded motion.

    Example: `servoloop teach remove wave --arm so101`
    """
    from servoloop.teach.taught import MotionStore

    MotionStore(find_arm(arm).folder).remove(name)
    typer.echo(f"{name} was removed")


def played(side: "Side", motion: "RecordedMotion", speed: float, hands_free: bool, rate_hz: int) -> int:
    """Play a motion, show its progress, and return the exit status."""
    from rich.console import Console

    from servoloop.teach.run import play as run
    from servoloop.teach.screen import TeachScreen

    log_to_terminal()
    with permission_of(hands_free) as permission, TeachScreen(Console()) as screen:
        return run(side, rate_hz, motion, speed, permission, screen.show)


def summary(motion: "RecordedMotion") -> str:
    """Return a short description of a motion."""
    if motion.path is None:
        return counted(len(motion.position), "pose")
    return f"a path of {motion.path.duration_s:.1f} s through {counted(len(motion.position), 'point')}"


def _plain(motion: "RecordedMotion") -> dict[str, object]:
    """Return a motion as JSON content."""
    kind, duration_s = ("path", motion.path.duration_s) if motion.path else ("poses", None)
    return {"kind": kind, "joints": motion.joints, "points": len(motion.position), "duration_s": duration_s}


def _print_and_confirm(question: str, yes: bool) -> None:
    """Ask for a confirmation; with ``yes``, print the question and continue."""
    if yes:
        typer.echo(question, err=True)
    confirm(question, yes)


def teleop(
    ports: Annotated[
        list[str],
        typer.Argument(
            metavar="LEADER FOLLOWER",
            help="Serial ports of leader and follower, or NAME=PATH,NAME=PATH for several buses. With several arms on "
            "one robot, the two ports of each arm, one arm after the other.",
        ),
    ],
    leader_arm: Annotated[
        str, typer.Option(help="Leader: a name that `servoloop arms` lists, or an arm folder.")
    ] = "so101_leader",
    follower_arm: Annotated[
        str, typer.Option(help="Follower: a name that `servoloop arms` lists, or an arm folder.")
    ] = "so101",
    rate_hz: RateOption = RATE_HZ,
    hands_free: HandsFreeOption = False,
) -> None:
    """Let a follower arm follow a leader arm that you move by hand, while you hold a key.

    Any key except a and q works; q ends the command. The follower first moves slowly to the pose of the leader, then it
    follows the leader. The follower holds its position when you release the key or the leader is lost. Key a re-enables
    servos of the follower that have switched their torque off. At the end the follower holds or parks, as set by
    on_exit in its robot file. The torque of the leader is always off; the command asks before it switches the leader's
    torque off.
    Example: `servoloop teleop /dev/ttyACM0 /dev/ttyACM1`; with two arms on each robot,
    `servoloop teleop ./left_leader ./left ./right_leader ./right --leader-arm leaders --follower-arm bimanual_so101`
    """
    from rich.console import Console

    from servoloop.commands.shared.console import confirm
    from servoloop.teleop.arms import TeleopError
    from servoloop.teleop.attendance import HANDS_FREE_HINT, HINT, REACTIVATE
    from servoloop.teleop.pairs import bus_names, port_pairs
    from servoloop.teleop.screen import TeleopScreen
    from servoloop.teleop.teleop import teleop as run

    require_keys(hands_free)
    log_to_terminal()
    leader, follower = port_pairs(ports, bus_names(leader_arm), bus_names(follower_arm))
    sides = side_of(leader_arm, leader), side_of(follower_arm, follower)
    if set(sides[0].devices.values()) & set(sides[1].devices.values()):
        raise TeleopError("leader and follower cannot share a port; pass a different port for each")
    keys = partial(permission_of, hands_free, (REACTIVATE,))
    screen = TeleopScreen(Console(), keys, partial(confirm, yes=False), HANDS_FREE_HINT if hands_free else HINT)
    status = run(*sides, rate_hz, screen)
    screen.console.print(screen.summary, highlight=False)
    raise typer.Exit(status)
