"""``servoloop teach`` and ``teleop``: record motions that you demonstrate by hand and play them back, and follow a
leader."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from drivers.driver_errors import DriverError
from drivers.paths import resolved
from drivers.printable import counted
from hal.types import JointLimits
from servoloop.commands.shared.console import JsonOption, YesOption, confirm, print_json, text_console
from servoloop.commands.shared.line_options import require_ports
from servoloop.commands.shared.option_groups import grouped_options
from servoloop.commands.shared.options import (
    FASTEST_HZ,
    RATE_HZ,
    SLOWEST_HZ,
    HandsFreeOption,
    RateOption,
    SpeedOption,
    UnattendedOption,
    permission_of,
    require_keys,
    saved_folder,
    side_of,
)
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.arm_options import RunningNamespace, SavedArm
from servoloop.stack.shipped_files import OWN
from servoloop.stack.terminal import log_to_terminal

if TYPE_CHECKING:
    from servoloop.api.arm import Arm
    from servoloop.teach.motion_files import RecordedMotion


READY_S: Final = 1.5
"""Time from enabling the torque until the servos support the arm and have corrected its sag, in seconds."""
NO_FOLDER: Final = "the motions of the running arm are unknown: its stack does not report the arm's folder"
app = typer.Typer(no_args_is_help=True, help="Record motions that you show by hand, and play them back.")
Name = Annotated[str, typer.Argument(help="Name of the motion.")]


@dataclass(frozen=True, slots=True)
class SelectedArm:
    """Options that select the arm for a motion: an arm at a port or a running arm."""

    port: Annotated[
        list[str] | None,
        typer.Option(help="Serial port of the arm; NAME=PATH for each of several buses."),
    ] = None
    arm: Annotated[
        str | None,
        typer.Option(
            help="Arm: a name that `servoloop arms` lists, or an arm folder. Without --port: name, folder or process "
            "ID of the running arm."
        ),
    ] = None
    namespace: RunningNamespace = None
    rate_hz: Annotated[
        int | None,
        typer.Option(
            "--rate", min=SLOWEST_HZ, max=FASTEST_HZ, help=f"Cycles per second if --port is given. [default: {RATE_HZ}]"
        ),
    ] = None

    def __post_init__(self) -> None:
        """Raise DriverError if an option does not apply."""
        if not self.port and self.rate_hz is not None:
            raise DriverError("--rate applies only with --port: a running arm keeps its rate")
        if self.port and self.namespace is not None:
            raise DriverError("--namespace selects a running arm: omit --namespace with --port")

    @contextmanager
    def opened(self) -> "Iterator[Arm]":
        """Yield the arm with its torque enabled. Raises ArmSetupError.

        At the end, an arm at a port holds its position or parks, as its robot file specifies.
        """
        from servoloop.api.arm import Arm

        if not self.port:
            with Arm.connect(self.arm, namespace=self.namespace) as arm:
                yield arm
            return
        log_to_terminal()
        with Arm(resolved(find_arm(self.arm or OWN).folder), self.port, rate_hz=self.rate_hz or RATE_HZ) as arm:
            yield arm

    def motion(self, of: "MotionOf") -> "RecordedMotion | None":
        """Return the checked motion of an arm at a port, before the port is opened, or None for a running arm."""
        if not self.port:
            return None
        files = side_of(self.arm or OWN, self.port).files
        joints = {joint.name: joint for joint in files.robot.joints}
        return of(find_arm(self.arm or OWN).folder, tuple(joints), [joint.limits for joint in joints.values()])


MotionOf = Callable[[Path | None, Sequence[str], Sequence[JointLimits]], "RecordedMotion"]
"""Function that returns the checked motion for an arm, given the arm's folder (if any), joints and joint limits."""


@app.command()
@grouped_options
def record(
    *,
    name: Name,
    selected: SelectedArm,
    limp: Annotated[
        bool,
        typer.Option("--limp", help="Disable the torque. The arm moves more easily, but falls when you release it."),
    ] = False,
    poses: Annotated[
        bool,
        typer.Option(
            "--poses", help="Record single poses instead of a path. Enter or p records a pose; q ends the recording."
        ),
    ] = False,
    yes: YesOption = False,
) -> None:
    """Record a motion while you move the arm by hand, until you press Enter.

    The arm holds its position softly and gives way to your hand. At the end, the arm holds its last position or parks,
    as set by on_exit in its robot file. Without --port, the arm of the running `servoloop up` is recorded and holds its
    position at the end.
    Example: `servoloop teach record wave --arm so101 --port /dev/ttyACM0`
    """

    from hal.servos.limp_arm import release_question, servo_name
    from servoloop.teach.motion_files import MotionStore
    from servoloop.teach.record import SOFT
    from servoloop.teach.run import record as run
    from servoloop.teach.screen import Teacher

    folder = arm_folder(selected)
    joints = {joint.name: joint for joint in read_arm_files(find_arm(str(folder))).robot.joints}
    motions = MotionStore(folder)
    motions.require_writable()
    if motions.path(name).exists():
        confirm(f"The motion {name} already exists. Replace it?", yes)
    if selected.port:
        side = side_of(selected.arm or OWN, selected.port)
        require_ports(side.devices, side.files.robot.file)
    _print_and_confirm(release_question([servo_name(joint) for joint in joints.values()]) if limp else SOFT, yes)

    teacher = Teacher(text_console(highlight=False))

    def keep(motion: "RecordedMotion", warnings: Sequence[str]) -> None:
        motions.save(name, motion, joints)
        for warning in warnings:
            teacher.say(f"! {warning}", "yellow")
        teacher.say(f"{name}: {summary(motion)}, saved in {motions.path(name)}")

    with selected.opened() as arm:
        run(arm, limp, poses, teacher, keep)


def arm_folder(selected: SelectedArm) -> Path:
    """Return the folder of an arm at a port or of a running arm. Raises HalError, ArmSetupError or TeachError."""
    from servoloop.api.arm import Arm
    from servoloop.teach.motion_files import TeachError

    if selected.port:
        side_of(selected.arm or OWN, selected.port)
        return find_arm(selected.arm or OWN).folder
    with Arm.connect(selected.arm, namespace=selected.namespace) as arm:
        if arm.folder is None:
            raise TeachError(NO_FOLDER)
        return arm.folder


@dataclass(frozen=True, slots=True)
class PlayOptions:
    """Speed and supervision of a motion that is played back."""

    speed: SpeedOption = 1.0
    hands_free: UnattendedOption = False


@app.command()
@grouped_options
def play(*, name: Name, selected: SelectedArm, options: PlayOptions) -> None:
    """Play back a recorded motion while you hold a key.

    You can hold any key except q, which ends the command. The arm first moves slowly to the start of the motion, and
    then follows it. The arm stops when you release the key. At the end, the arm holds its position or parks, as set by
    on_exit in its robot file. Without --port, the motion is played on the arm of the running `servoloop up`, which
    holds its position at the end.
    Example: `servoloop teach play wave --arm so101 --port /dev/ttyACM0 --speed 0.5`
    """
    play_motion(selected, partial(_saved_motion, name), options)


def _saved_motion(
    name: str, folder: Path | None, joints: Sequence[str], limits: Sequence[JointLimits]
) -> "RecordedMotion":
    """Return a saved motion. Raises TeachError if the motion does not match the arm."""
    from servoloop.teach.motion_files import MotionStore, TeachError

    if folder is None:
        raise TeachError(NO_FOLDER)
    motions = MotionStore(folder)
    path, motion = str(motions.path(name)), motions.get(name).of(tuple(joints), name)
    own = {joint.name: joint for joint in read_arm_files(find_arm(str(folder))).robot.joints}
    motion.check_units([own[joint] for joint in joints if joint in own], path)
    motion.check(limits, path)
    return motion


def play_motion(selected: SelectedArm, motion_of: MotionOf, options: PlayOptions) -> None:
    """Play a motion, and show the arm while it moves."""

    from servoloop.teach.run import play as run
    from servoloop.teach.screen import ArmScreen

    require_keys(options.hands_free)
    motion = selected.motion(motion_of)
    with selected.opened() as arm, permission_of(options.hands_free) as permission:
        if motion is None:
            motion = motion_of(arm.folder, arm.joints, [arm.limits[joint] for joint in arm.joints])
        else:
            arm.sleep(READY_S)
        complete = run(arm, motion, options.speed, permission, ArmScreen(text_console(stderr=True)))
        result = "done" if complete else "the motion was ended with q before it was complete"
        if not selected.port:
            typer.echo(f"{arm.name} holds its position: {result}")
        elif not complete:
            typer.echo(result)


@app.command("list")
def list_(arm: SavedArm = None, namespace: RunningNamespace = None, json: JsonOption = False) -> None:
    """List the recorded motions of an arm.

    Example: `servoloop teach list --arm so101`
    """
    from servoloop.teach.motion_files import MotionStore, RecordedMotion, TeachError

    folder = saved_folder(arm, namespace)
    found = MotionStore(folder).all()
    motions = {name: one for name, one in found.items() if isinstance(one, RecordedMotion)}
    if json:
        print_json({name: _plain(motion) for name, motion in motions.items()})
    elif not found:
        typer.echo(f"no motions are saved in {folder}")
    else:
        for name, motion in motions.items():
            typer.echo(f"{name}: {summary(motion)}")
    if problems := [str(one) for one in found.values() if isinstance(one, TeachError)]:
        raise TeachError("\n".join(problems))


@app.command()
def remove(name: Name, arm: SavedArm = None, namespace: RunningNamespace = None) -> None:
    """Remove a recorded motion.

    Example: `servoloop teach remove wave --arm so101`
    """
    from servoloop.teach.motion_files import MotionStore

    MotionStore(saved_folder(arm, namespace)).remove(name)
    typer.echo(f"{name} was removed")


def summary(motion: "RecordedMotion") -> str:
    """Return a short description of a motion."""
    if motion.path is None:
        return counted(len(motion.position), "pose")
    return f"a path of {motion.path.duration_s:.1f} s through {counted(len(motion.position), 'point')}"


def _plain(motion: "RecordedMotion") -> dict[str, object]:
    """Return a motion as data for JSON output."""
    kind, duration_s = ("path", motion.path.duration_s) if motion.path else ("poses", None)
    return {"kind": kind, "joints": motion.joints, "points": len(motion.position), "duration_s": duration_s}


def _print_and_confirm(question: str, yes: bool) -> None:
    """Ask for confirmation; with ``yes``, print the question and continue."""
    if yes:
        typer.echo(question, err=True)
    confirm(question, yes)


def teleop(
    ports: Annotated[
        list[str],
        typer.Argument(
            metavar="LEADER FOLLOWER",
            help="Serial ports of leader and follower, or NAME=PATH,NAME=PATH for several buses. With several arms on "
            "one robot, pass the two ports of each arm, one arm after the other.",
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

    Any key except a and q can be held; q ends the command. The follower first moves slowly to the leader's pose, and
    then follows the leader. The follower holds its position when you release the key or the leader is lost. The a key
    enables the torque of follower servos that have disabled it. At the end, the follower holds its position or parks,
    as set by on_exit in its robot file. The leader's torque is always off. The command asks for confirmation before it
    disables the leader's torque.
    Example: `servoloop teleop /dev/ttyACM0 /dev/ttyACM1`; with two arms on each robot,
    `servoloop teleop ./left_leader ./left ./right_leader ./right --leader-arm leaders --follower-arm bimanual_so101`
    """

    from servoloop.commands.shared.console import confirm
    from servoloop.teleop.arms import TeleopError
    from servoloop.teleop.attendance import HANDS_FREE_HINT, HINT, REACTIVATE
    from servoloop.teleop.pairs import bus_names, port_pairs
    from servoloop.teleop.screen import TeleopScreen
    from servoloop.teleop.teleop import teleop as run

    require_keys(hands_free)
    log_to_terminal()
    leader, follower = port_pairs(ports, bus_names(leader_arm), bus_names(follower_arm))
    sides = side_of(leader_arm, [leader]), side_of(follower_arm, [follower])
    if set(sides[0].devices.values()) & set(sides[1].devices.values()):
        raise TeleopError("leader and follower cannot share a port; pass a different port for each")
    keys = partial(permission_of, hands_free, (REACTIVATE,))
    screen = TeleopScreen(text_console(), keys, partial(confirm, yes=False), HANDS_FREE_HINT if hands_free else HINT)
    status = run(*sides, rate_hz, screen)
    screen.console.print(screen.summary, highlight=False)
    raise typer.Exit(status)
