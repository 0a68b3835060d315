"""Options of ``servoloop up``, except for the arm and its hardware."""

from dataclasses import dataclass
from typing import Annotated

import typer

from servoloop.recording.mcap import RecordOption


@dataclass(frozen=True, slots=True)
class UpOptions:
    """Options of ``servoloop up`` other than the arm and its hardware."""

    keep_alive: Annotated[
        bool,
        typer.Option("--stay", help="Keep running if servos are missing or lost, until they are activated again."),
    ] = False
    publish_transforms: Annotated[
        bool,
        typer.Option(
            "--robot-state-publisher/--no-robot-state-publisher",
            help="Publish robot_description and the link transforms. Disable this if your own node publishes them.",
        ),
    ] = True
    spawn: Annotated[
        bool,
        typer.Option(
            "--spawn/--no-spawn",
            help="Load and activate all controllers in the controllers file. Disable this if a spawner loads them.",
        ),
    ] = True
    rtf: Annotated[
        str | None,
        typer.Option(metavar="FACTOR", help="Run in simulated time, FACTOR times as fast as real time, or `max`."),
    ] = None
    step: Annotated[
        bool, typer.Option("--step", help="Run in simulated time that only the service step_simulation advances.")
    ] = False
    plan: Annotated[
        bool, typer.Option("--plan", help="Also plan motions for MoveIt's clients, as `servoloop plan-server` does.")
    ] = False
    record: RecordOption = None
    ros: Annotated[bool, typer.Option("--ros/--no-ros", help="Serve ROS 2 clients, if ROS 2 is installed.")] = True


NO_OPTIONS = UpOptions()
