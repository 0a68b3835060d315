"""``servoloop pose``: poses of a running arm, with names."""

from pathlib import Path
from time import sleep
from typing import Annotated, Final

import typer

from drivers.errors import DriverError
from drivers.printable import counted
from nodes.ros_environment import require_ros
from servoloop.arms.folder import OWN, find_arm
from servoloop.handling.poses import FILE, Poses
from servoloop.verbs.ros_options import NetworkOption, set_network

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
    from servoloop.handling.live_robot import LiveRobot

    with LiveRobot(arm) as robot:
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
    from servoloop.handling.live_robot import LiveRobot
    from servoloop.processes import Interrupted
    from servoloop.signals import Signals

    require_ros()
    set_network(network)
    with Signals() as signals, LiveRobot(arm) as robot:
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
