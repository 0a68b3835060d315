"""``servoloop jog``, ``stop`` and ``pose``: move a running arm with keys, stop it, save poses and move to them."""

import sys
from pathlib import Path
from time import monotonic, sleep
from typing import TYPE_CHECKING, Annotated, Final

import typer

from drivers.driver_errors import DriverError
from drivers.printable import counted
from servoloop.commands.shared.console import text_console
from servoloop.stack.arm_options import RunningArm, RunningNamespace, SavedArm
from servoloop.stack.terminal import print_styled

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from servoloop.manual.poses import Poses
    from servoloop.manual.robot import LiveRobot
    from servoloop.manual.robot_client import RobotClient


TICK_S: Final = 0.04
TAP_S: Final = 0.1
"""Duration of the motion after a short key press, in seconds."""
WAYS: Final = {"right": 1.0, "+": 1.0, "left": -1.0, "-": -1.0}
HELP: Final = "up, down or 1 to 9: choose a joint · hold left or right: move it\nspace: stop everything · q: quit"
WIDTH: Final = 66
"""Width of the table and its help text, in columns."""


def jog(arm: RunningArm = None, namespace: RunningNamespace = None) -> None:
    """Move the joints of a running arm slowly with the arrow keys, through its controllers.

    A joint stops when its key is released. Example: `servoloop jog`
    """
    from servoloop.manual.joints_now import HandlingError

    if not sys.stdin.isatty():
        raise HandlingError("jogging needs a keyboard, but stdin is not a terminal; run this command in a terminal")
    from rich.live import Live

    from servoloop.command_socket.client import CommandClient
    from servoloop.manual.robot import LiveRobot
    from servoloop.manual.robot_client import RobotClient
    from servoloop.stack.signals import Signals
    from servoloop.stack.terminal import raw_keys

    with Signals() as signals, LiveRobot.find(arm, namespace) as robot, CommandClient(robot.stack, "jog") as commands:
        robot.wait()
        client = RobotClient(commands, robot)
        client.connect()
        jogging, console = Jogging(client, robot), text_console()

        def shown() -> "Table":
            return jogging.table(console)

        with raw_keys(), Live(console=console, get_renderable=shown, refresh_per_second=8, transient=True):
            while not (jogging.ended or signals.count):
                jogging.step()


def stop(arm: RunningArm = None, namespace: RunningNamespace = None) -> None:
    """Stop all motions of a running arm, including those started by ROS clients. The arm holds its position.

    Example: `servoloop stop`
    """
    from servoloop.command_socket.client import CommandClient

    with CommandClient.find(arm, "stop", namespace) as commands:
        commands.request("stop")
        typer.echo(f"all motions of {commands.stack.name} were stopped")


class Jogging:
    """Jog session that handles keys, sends motions and shows the joints."""

    def __init__(self, client: "RobotClient", robot: "LiveRobot") -> None:
        from servoloop.stack.terminal import HeldKey

        self.ended = False
        self._client, self._robot = client, robot
        self._joints = tuple(joint for joint in robot.snapshot.joints if joint in robot.limits)
        """All joints, including joints without an active controller, so that each number always selects one joint."""
        self._chosen = 0
        self._key = HeldKey(TAP_S)
        self._way = 0.0
        """Direction of the motion, or 0 at rest."""
        self._began_s: float | None = None
        """Start time of the motion on the monotonic clock, in seconds."""
        self._sent_s = 0.0
        """Time of the last command."""
        self._message = ""

    def step(self) -> None:
        """Process the pressed keys, and move the selected joint by one step if its key is held."""
        from servoloop.manual.joints_now import HandlingError
        from servoloop.stack.terminal import typed

        for key in typed(TICK_S):
            self._press(key)
        if not self._turns():
            self._way, self._began_s = 0.0, None
            self._client.listen()
            return
        try:
            self._client.jog(self._joints[self._chosen], self._way)
            self._message = ""
            self._sent_s = monotonic()
            self._began_s = self._sent_s if self._began_s is None else self._began_s
        except HandlingError as error:
            self._message = f"{error}. Then press the key again."
            self._stop()

    def _turns(self) -> bool:
        """Return whether the key is held, or a short press has not yet moved the joint for ``TAP_S``."""
        if not self._way:
            return False
        return bool(self._key.held(monotonic())) or self._began_s is None or self._sent_s - self._began_s < TAP_S

    def _stop(self) -> None:
        """Stop the motion until a key is pressed again."""
        self._key.release()
        self._way, self._began_s = 0.0, None

    def _press(self, key: str) -> None:
        if key in WAYS:
            now_s = monotonic()
            new = self._key.press(key, now_s)
            if new or (self._key.held(now_s) and not self._way):  # key repeats after a short press resume the motion
                self._way, self._began_s = WAYS[key], None
            return
        self._stop()
        if key == "q":
            self.ended = True
        elif key == "space":
            self._client.stop()
            self._message = "All motions of all clients were stopped."
        elif key in ("up", "down"):
            self._chosen = (self._chosen + (1 if key == "down" else -1)) % len(self._joints)
        elif key.isdigit() and 0 < int(key) <= len(self._joints):
            self._chosen = int(key) - 1

    def table(self, console: "Console") -> "Table":
        """Return a table of the joints with their positions and limits, the help text and the message.

        If the terminal is too low for all joints, the table contains the joints around the selected joint.
        """
        rows = len(self._joints)
        while True:
            table = self._table(rows)
            excess = len(console.render_lines(table)) - console.height
            if excess <= 0 or rows == 1:
                return table
            rows = max(1, rows - excess)

    def _table(self, rows: int) -> "Table":
        """Return a table with this number of joints."""
        from rich.table import Table

        table = Table(
            "", "joint", "position", "minimum", "maximum", caption=f"{HELP}\n{self._message}", min_width=WIDTH
        )
        count, chosen = len(self._joints), self._chosen  # another thread may choose a joint in the meantime
        first = min(max(chosen - rows // 2, 0), count - rows)
        if rows < count:
            table.title = f"joints {first + 1} to {first + rows} of {count}"
        now, driven = self._robot.snapshot, self._client.joints
        at = dict(zip(now.joints, now.position.tolist(), strict=True))
        for number, joint in list(enumerate(self._joints))[first : first + rows]:
            limit = self._robot.limits[joint]
            style = "reverse" if number == chosen else "" if joint in driven else "dim"
            position = f"{at.get(joint, float('nan')):+.3f}"
            table.add_row(str(number + 1), joint, position, f"{limit.lower:+.3f}", f"{limit.upper:+.3f}", style=style)
        return table


app = typer.Typer(no_args_is_help=True, help="Save, list and remove named poses of an arm, and move to them.")
POLL_S: Final = 0.05
Name = Annotated[str, typer.Argument(help="Name of the pose.")]


@app.command()
def save(name: Name, arm: RunningArm = None, namespace: RunningNamespace = None) -> None:
    """Save the measured pose of a running arm under a name, replacing any pose with this name.

    Example: `servoloop pose save over_the_box`
    """
    from servoloop.manual.poses import Poses, inside
    from servoloop.manual.robot import LiveRobot

    with LiveRobot.find(arm, namespace) as robot:
        robot.wait()
        now, limits = robot.snapshot, robot.limits
    if now.faults:
        faults = "; ".join(now.faults.values())
        raise DriverError(f"the pose was not saved, because the arm has faults and positions may be outdated: {faults}")
    poses = Poses(robot.folder)
    measured = {joint: round(at, 4) for joint, at in zip(now.joints, now.position.tolist(), strict=True)}
    pose, warnings = inside(measured, limits)
    poses.save(name, pose)
    for warning in warnings:
        print_styled(f"! {warning}", err=True, fg="yellow")
    typer.echo(f"{name}: {counted(len(now.joints), 'joint')} of {robot.arm}")
    typer.echo(f"saved in {poses.path}", err=True)


@app.command()
def go(name: Name, arm: RunningArm = None, namespace: RunningNamespace = None) -> None:
    """Move a running arm slowly to a saved pose, through its controllers.

    The arm stops if the command is interrupted. Example: `servoloop pose go over_the_box`
    """
    from servoloop.command_socket.client import CommandClient
    from servoloop.manual.poses import Poses
    from servoloop.manual.robot import LiveRobot
    from servoloop.manual.robot_client import RobotClient
    from servoloop.stack.processes import Interrupted
    from servoloop.stack.signals import Signals

    with Signals() as signals, LiveRobot.find(arm, namespace) as robot:
        poses = Poses(robot.folder)
        pose = poses.get(name)
        robot.wait()
        poses.check(name, robot.limits)
        with CommandClient(robot.stack, "pose go") as commands:
            client = RobotClient(commands, robot)
            client.connect()
            while not client.approach(pose):
                if signals.count:
                    raise Interrupted("interrupted; the arm stopped before it reached the pose")
                sleep(POLL_S)
    typer.echo(f"{robot.arm} is at {name}")


@app.command("list")
def list_(arm: SavedArm = None, namespace: RunningNamespace = None) -> None:
    """List the saved poses of an arm, with joint positions in rad or m.

    Example: `servoloop pose list --arm so101`
    """
    poses = _poses(arm, namespace)
    found = poses.all()
    if not found:
        typer.echo(f"no poses are saved in {poses.path}")
    for name, pose in found.items():
        typer.echo(f"{name}: " + ", ".join(f"{joint} {at:+.4f}" for joint, at in pose.items()))


@app.command()
def remove(name: Name, arm: SavedArm = None, namespace: RunningNamespace = None) -> None:
    """Remove a saved pose.

    Example: `servoloop pose remove over_the_box`
    """
    _poses(arm, namespace).remove(name)
    typer.echo(f"{name} was removed")


def _poses(arm: str | None, namespace: str | None) -> "Poses":
    """Return the poses of an arm, or of any folder that contains a pose file, such as a URDF's folder."""
    from servoloop.commands.shared.options import saved_folder
    from servoloop.manual.poses import FILE, Poses

    if arm is not None and "/" in arm and (Path(arm) / FILE).is_file():
        return Poses(Path(arm))
    return Poses(saved_folder(arm, namespace))
