"""``servoloop jog``: keys that turn joints of a running arm."""

import sys
from pathlib import Path
from time import monotonic, sleep
from typing import TYPE_CHECKING, Annotated, Final

import typer

from drivers.errors import DriverError
from drivers.printable import counted
from nodes.ros_environment import require_ros
from servoloop.commands.options import NetworkOption, set_network
from servoloop.manual.poses import FILE, Poses
from servoloop.stack.arm_folders import OWN, find_arm

if TYPE_CHECKING:
    from rich.table import Table

    from nodes.handling.robot_client import RobotClient
    from servoloop.manual.robot import LiveRobot


TICK_S: Final = 0.04
TAP_S: Final = 0.1
"""A tap turns a joint for so long."""
WAYS: Final = {"right": 1.0, "+": 1.0, "left": -1.0, "-": -1.0}
HELP: Final = "up, down or 1 to 9: which joint · hold left or right: turn it\nspace: stop everything · q: end"
WIDTH: Final = 64
"""Of the table, in columns: so wide is the help."""


def jog(
    arm: Annotated[str | None, typer.Option(help="Which running arm, of several: name, folder or process.")] = None,
    network: NetworkOption = False,
) -> None:
    """Turn joints of a running arm with the arrow keys, slowly, through its controllers; it stops with the key.

    Example: `servoloop jog`
    """
    from nodes.handling.robot import HandlingError

    require_ros()
    if not sys.stdin.isatty():
        raise HandlingError("stdin is no terminal, and jogging needs keys: run it in one")
    from rich.live import Live

    from nodes.client_node import client_node
    from nodes.handling.robot_client import RobotClient
    from servoloop.manual.robot import LiveRobot
    from servoloop.stack.signals import Signals
    from servoloop.stack.terminal import raw_keys

    set_network(network)
    with Signals() as signals, LiveRobot.find(arm) as robot, client_node("servoloop_jog") as (node, executor):
        robot.wait()
        client = RobotClient(node, executor, robot)
        client.connect()
        jogging = Jogging(client, robot)
        with raw_keys(), Live(get_renderable=jogging.table, refresh_per_second=8, transient=True):
            while not (jogging.ended or signals.count):
                jogging.step()


class Jogging:
    """What keys do."""

    def __init__(self, client: "RobotClient", robot: "LiveRobot") -> None:
        from servoloop.stack.terminal import HeldKey

        self.ended = False
        self._client, self._robot = client, robot
        self._joints = tuple(joint for joint in robot.snapshot.joints if joint in robot.limits)
        """All joints, also those that no active controller moves: a number always means the same joint."""
        self._chosen = 0
        self._key = HeldKey(TAP_S)
        self._way = 0.0
        """Which way the joint turns; 0 if no motion is under way."""
        self._began_s: float | None = None
        """When the joint began to turn, and when it was last sent on."""
        self._sent_s = 0.0
        self._said = ""

    def step(self) -> None:
        """Take the keys, and turn the chosen joint on a little where its key is held."""
        from nodes.handling.robot import HandlingError
        from servoloop.stack.terminal import typed

        for key in typed(TICK_S):
            self._press(key)
        if not self._turns():
            self._way, self._began_s = 0.0, None
            self._client.listen()
            return
        try:
            self._client.jog(self._joints[self._chosen], self._way)
            self._said = ""
            self._sent_s = monotonic()
            self._began_s = self._sent_s if self._began_s is None else self._began_s
        except HandlingError as error:
            self._said = f"{error}. Then press the key again"
            self._stop()

    def _turns(self) -> bool:
        """Whether the key is held, or a tap has not yet turned the joint for ``TAP_S``."""
        if not self._way:
            return False
        return bool(self._key.held(monotonic())) or self._began_s is None or self._sent_s - self._began_s < TAP_S

    def _stop(self) -> None:
        """No motion goes on; a new one needs a new press."""
        self._key.release()
        self._way, self._began_s = 0.0, None

    def _press(self, key: str) -> None:
        if key in WAYS:
            now_s = monotonic()
            new = self._key.press(key, now_s)
            if new or (self._key.held(now_s) and not self._way):  # the tap is over when the first repeat comes
                self._way, self._began_s = WAYS[key], None
            return
        self._stop()
        if key == "q":
            self.ended = True
        elif key == "space":
            self._client.stop()
            self._said = "stopped: all motions, everybody's"
        elif key in ("up", "down"):
            self._chosen = (self._chosen + (1 if key == "down" else -1)) % len(self._joints)
        elif key.isdigit() and 0 < int(key) <= len(self._joints):
            self._chosen = int(key) - 1

    def table(self) -> "Table":
        """The joints, where they are and where they may go."""
        from rich.table import Table

        table = Table("", "joint", "position", "from", "to", caption=f"{HELP}\n{self._said}", min_width=WIDTH)
        now, driven = self._robot.snapshot, self._client.joints
        at = dict(zip(now.joints, now.position.tolist(), strict=True))
        for number, joint in enumerate(self._joints):
            limit = self._robot.limits[joint]
            style = "reverse" if number == self._chosen else "" if joint in driven else "dim"
            position = f"{at.get(joint, float('nan')):+.3f}"
            table.add_row(str(number + 1), joint, position, f"{limit.lower:+.3f}", f"{limit.upper:+.3f}", style=style)
        return table


app = typer.Typer(no_args_is_help=True, help="Poses of an arm, with names: saved, gone to slowly.")
POLL_S: Final = 0.05
Name = Annotated[str, typer.Argument(help="The pose's name.")]
RunningArm = Annotated[
    str | None, typer.Option("--arm", help="Which running arm, of several: name, folder or process.")
]
AnArm = Annotated[str, typer.Option("--arm", help="The arm: a name that `servoloop arms` lists, or its folder.")]


@app.command()
def save(name: Name, arm: RunningArm = None) -> None:
    """Keep where the running arm's joints are now. A pose of the same name is replaced.

    Example: `servoloop pose save over_the_box`
    """
    from servoloop.manual.robot import LiveRobot

    with LiveRobot.find(arm) as robot:
        robot.wait()
        now = robot.snapshot
    if now.faults:
        raise DriverError(f"the arm is not well, and its pose may be an old one: {'; '.join(now.faults.values())}")
    poses = Poses(robot.folder)
    poses.save(name, dict(zip(now.joints, now.position.tolist(), strict=True)))
    typer.echo(f"{name}: {counted(len(now.joints), 'joint')} of {robot.arm}")
    typer.echo(f"kept in {poses.path}", err=True)


@app.command()
def go(name: Name, arm: RunningArm = None, network: NetworkOption = False) -> None:
    """Bring the running arm to a pose, slowly, through its controllers. It stops where this is interrupted.

    Example: `servoloop pose go over_the_box`
    """
    from nodes.client_node import client_node
    from nodes.handling.robot_client import RobotClient
    from servoloop.manual.robot import LiveRobot
    from servoloop.stack.processes import Interrupted
    from servoloop.stack.signals import Signals

    require_ros()
    set_network(network)
    with Signals() as signals, LiveRobot.find(arm) as robot:
        poses = Poses(robot.folder)
        pose = poses.get(name)
        robot.wait()
        poses.check(name, robot.limits)
        with client_node("servoloop_pose") as (node, executor):
            client = RobotClient(node, executor, robot)
            client.connect()
            while not client.approach(pose):
                if signals.count:
                    raise Interrupted("the arm has stopped on its way")
                sleep(POLL_S)
    typer.echo(f"{robot.arm} is at {name}")


@app.command("list")
def list_(arm: AnArm = OWN) -> None:
    """List an arm's poses, in rad or m.

    Example: `servoloop pose list --arm so101`
    """
    for name, pose in _poses(arm).all().items():
        typer.echo(f"{name}: " + ", ".join(f"{joint} {at:+.4f}" for joint, at in pose.items()))


@app.command()
def remove(name: Name, arm: AnArm = OWN) -> None:
    """Forget a pose.

    Example: `servoloop pose remove over_the_box`
    """
    _poses(arm).remove(name)
    typer.echo(f"{name} is forgotten")


def _poses(arm: str) -> Poses:
    """The poses of an arm that is named, or of a folder that has poses, such as a robot description's."""
    folder = Path(arm)
    return Poses(folder if "/" in arm and (folder / FILE).is_file() else find_arm(arm).folder)
