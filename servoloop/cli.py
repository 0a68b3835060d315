"""Define the command line: register all commands and print the errors that users can correct."""

from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Final

import typer

from commissioning.calibrate.result import CalibrationError
from controller.manager.controllers_file import ControllersFileError
from controller.manager.plugins import PluginError
from controller.manager.registry import ClaimError
from drivers.errors import DriverError
from drivers.printable import printable
from hal.errors import HalError
from nodes.ros_environment import RosError
from planning.errors import PlanningError
from servoloop.commands import arms, bench, camera, passport, servo, teach
from servoloop.commands import calibrate as calibration
from servoloop.commands import jog as pose
from servoloop.commands import servo as register
from servoloop.commands.calibrate import calibrate, hand
from servoloop.commands.campaign import campaign
from servoloop.commands.doctor import doctor
from servoloop.commands.emulate import emulate, fault
from servoloop.commands.jog import jog, stop
from servoloop.commands.planning import scene
from servoloop.commands.planning.goto import goto
from servoloop.commands.planning.plan_server import plan_server
from servoloop.commands.ports import ports
from servoloop.commands.record import plot, record, replay
from servoloop.commands.scan import scan
from servoloop.commands.set_up import setup
from servoloop.commands.simulate import simulate
from servoloop.commands.teach import teleop
from servoloop.commands.topic_host import topic_host
from servoloop.commands.tune import tune
from servoloop.commands.up import demo, pick, up
from servoloop.commands.view import monitor, view
from servoloop.extras import extra_error
from servoloop.stack.processes import Interrupted
from servoloop.stack.terminal import complete_output, outlive_terminal, print_styled

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    help="Control a robot arm on serial bus servos, with or without ROS 2. The servos can be real or virtual.",
)

VERBS: Mapping[str, Sequence[Callable[..., None]]] = {
    "Run an arm": (up, plan_server, topic_host, pick, demo),
    "Watch and record": (view, monitor, record, plot),
    "Move an arm manually": (goto, jog, stop, teleop, replay),
    "Set up servos": (ports, scan, setup, calibrate, doctor, tune),
    "Change one servo": (servo.set_id, servo.set_baud, servo.factory_reset, servo.reboot),
    "Work without hardware": (emulate, hand, fault, simulate, campaign),
}
"""Commands in each panel of ``servoloop --help``."""
NEGATIVE_NUMBERS = (hand, goto)
"""Commands that accept negative numbers as arguments, although negative numbers look like options."""
ERRORS = (
    DriverError,
    HalError,
    ControllersFileError,
    ClaimError,
    PluginError,
    RosError,
    CalibrationError,
    PlanningError,
)
"""Errors that a user can correct. They are printed without a traceback."""
INTERRUPTED = 130
"""Exit status after Ctrl-C."""

for panel, verbs in VERBS.items():
    for verb in verbs:
        settings = {"ignore_unknown_options": verb in NEGATIVE_NUMBERS}
        app.command(rich_help_panel=panel, context_settings=settings)(verb)
for group, name in (
    (arms, "arms"),
    (bench, "bench"),
    (calibration, "calibration"),
    (camera, "camera"),
    (passport, "passport"),
    (pose, "pose"),
    (register, "register"),
    (scene, "scene"),
):
    app.add_typer(group.app, name=name)
app.add_typer(teach.app, name="teach", rich_help_panel="Move an arm manually")


SERVO_MODELS: Final = Path("servo_models.yaml")
"""File of servo models in the current folder. Its loader is imported only if the file exists, so that commands start
quickly."""


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"servoloop {version('servoloop')}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Handle the program's own options, and load the servo models in the current folder."""
    if SERVO_MODELS.exists():
        from hal.robot_file.servo_models import load_servo_models

        load_servo_models(SERVO_MODELS.parent)


def main() -> None:
    """Run a command. Errors that a user can correct are printed without a traceback."""
    outlive_terminal()
    with complete_output():
        _run()


def _complain(error: Exception) -> None:
    for text in (f"servoloop: {error}", *getattr(error, "__notes__", ())):
        print_styled(printable(text), err=True, fg="red")


def _run() -> None:
    try:
        app()
    except ERRORS as error:
        _complain(error)
        raise SystemExit(1) from None
    except ModuleNotFoundError as error:
        if (missing := extra_error(error)) is None:
            raise
        _complain(missing)
        raise SystemExit(1) from None
    except Interrupted as error:
        typer.echo(printable(f"servoloop: {error}"), err=True)
        raise SystemExit(INTERRUPTED) from None
