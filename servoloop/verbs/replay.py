"""``servoloop replay``: a recording, onto an arm or into the view."""

from pathlib import Path
from typing import Annotated

import typer

from servoloop.arms.folder import OWN
from servoloop.terminal_output import print_styled
from servoloop.verbs.by_hand import RATE_HZ, RateOption, SpeedOption, UnattendedOption, require_keys, side_of
from servoloop.verbs.teach import played
from servoloop.verbs.view import view


def replay(
    recording: Annotated[Path, typer.Argument(help="FILE.mcap, as --record writes it.")],
    port: Annotated[
        str | None, typer.Option(help="Serial device of the arm; NAME=PATH,NAME=PATH of several. Without: the view.")
    ] = None,
    arm: Annotated[str, typer.Option(help="The arm: a name that `servoloop arms` lists, or its folder.")] = OWN,
    speed: SpeedOption = 1.0,
    hands_free: UnattendedOption = False,
    rate_hz: RateOption = RATE_HZ,
) -> None:
    """Have an arm do what is in a recording, as long as a key is held: any but q, which ends.

    The arm goes slowly to where the recording begins, then where its joints were measured to be. Without --port the
    recording is shown, as `servoloop view` does. Example: `servoloop replay run.mcap --port /dev/ttyACM0 --speed 0.5`
    """
    from servoloop.teach.recorded import recorded_motion

    if port is None:
        view(recording, arm=None, port=8080, host="127.0.0.1", browser=True)
        return
    require_keys(hands_free)
    side = side_of(arm, port)
    joints = side.files.robot.joints
    followers = [joint.name for joint in side.files.description.joints.values() if joint.mimic is not None]
    names, limits = [joint.name for joint in joints], [joint.limits for joint in joints]
    taught, warnings = recorded_motion(recording, names, limits, followers)
    taught.check([joint.limits for joint in joints], str(recording))
    for warning in warnings:
        print_styled(f"! {warning}", fg="yellow")
    raise typer.Exit(played(side, taught, speed, hands_free, rate_hz))
