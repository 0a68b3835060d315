"""Define the command line: register all commands and print the errors that users can correct."""

import errno
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Final

import typer

from commissioning.commissioning_errors import CalibrationError
from controller.manager_errors import ClaimError, ControllersFileError, PluginError
from drivers.driver_errors import DriverError
from drivers.printable import printable
from hal.hal_errors import HalError
from nodes.ros_environment import RosError
from planning.planning_errors import PlanningError
from servoloop.commands.shared.lazy_commands import MARKUP, Place, lazy_group
from servoloop.extras import extra_error
from servoloop.stack.processes import Interrupted
from servoloop.stack.terminal import (
    complete_output,
    escape_output,
    open_missing_streams,
    outlive_terminal,
    print_styled,
)

PANELS: Mapping[str, Mapping[str, str]] = {
    "Run an arm": {
        "up": "up:up",
        "plan-server": "planning.plan_server:plan_server",
        "topic-host": "topic_host:topic_host",
        "pick": "up:pick",
        "demo": "up:demo",
    },
    "Watch and record": {
        "view": "view:view",
        "monitor": "view:monitor",
        "record": "record:record",
        "plot": "record:plot",
    },
    "Move an arm manually": {
        "goto": "planning.goto:goto",
        "jog": "jog:jog",
        "stop": "jog:stop",
        "teleop": "teach:teleop",
        "replay": "record:replay",
    },
    "Set up servos": {
        "ports": "ports:ports",
        "scan": "scan:scan",
        "setup": "set_up:setup",
        "calibrate": "calibrate:calibrate",
        "doctor": "doctor:doctor",
        "tune": "tune:tune",
    },
    "Change one servo": {
        "set-id": "servo:set_id",
        "set-baud": "servo:set_baud",
        "factory-reset": "servo:factory_reset",
        "reboot": "servo:reboot",
    },
    "Work without hardware": {
        "emulate": "emulate:emulate",
        "hand": "calibrate:hand",
        "fault": "emulate:fault",
        "simulate": "simulate:simulate",
        "campaign": "campaign:campaign",
    },
}
"""Functions of the commands in each panel of ``servoloop --help``."""
GROUPS: Mapping[str, str] = {
    "arms": "arms:app",
    "bench": "bench:app",
    "calibration": "calibrate:app",
    "camera": "camera:app",
    "passport": "passport:app",
    "pose": "jog:app",
    "register": "servo:app",
    "scene": "planning.scene:app",
}
"""Groups of commands in the panel without a title."""
NEGATIVE_NUMBERS = ("hand", "goto")
"""Commands that accept negative numbers as arguments, although these look like options."""
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
"""Errors that a user can correct. These errors are printed without a traceback."""
UNUSABLE_PATHS = (errno.EACCES, errno.ELOOP, errno.ENAMETOOLONG)
"""System errors of paths that the user has chosen. Even a check whether such a path exists raises them."""
NEAR: Final = 40
"""Number of characters to print before and after characters that cannot be encoded."""
INTERRUPTED = 130
"""Exit status after Ctrl-C."""


def _places() -> dict[str, Place]:
    """Return where each command is defined, in the order of ``servoloop --help``."""
    found = {
        name: Place(path, panel, name in NEGATIVE_NUMBERS)
        for panel, commands in PANELS.items()
        for name, path in commands.items()
    }
    found |= {name: Place(path) for name, path in GROUPS.items()}
    return found | {"teach": Place("teach:app", "Move an arm manually")}


app = typer.Typer(
    cls=lazy_group(_places()),
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=MARKUP,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["--help", "-h"]},
    help="Control a robot arm on serial bus servos, with or without ROS 2. The servos can be real or virtual.",
)

SERVO_MODELS: Final = Path("servo_models.yaml")
"""File with servo models in the current folder. The file's loader is imported only if the file exists, so that commands
start quickly."""


def _has_servo_models() -> bool:
    try:
        return SERVO_MODELS.exists()
    except OSError:  # commands such as `servoloop stop` must also work in a folder without permission
        return False


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
    if _has_servo_models():
        from hal.robot_file.servo_models import load_servo_models

        load_servo_models(SERVO_MODELS.parent)


def main() -> None:
    """Run a command. Errors that a user can correct are printed without a traceback."""
    open_missing_streams()
    escape_output()
    outlive_terminal()
    with complete_output():
        _run()


def _complain(error: Exception, color: str | None = "red") -> None:
    for text in (f"servoloop: {error}", *getattr(error, "__notes__", ())):
        print_styled(printable(text), err=True, fg=color)


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
    except OSError as error:
        if error.errno not in UNUSABLE_PATHS or error.filename is None:
            raise
        _complain(DriverError(f"cannot use {error.filename}: {error.strerror}; choose another path"))
        raise SystemExit(1) from None
    except UnicodeEncodeError as error:
        near = error.object[max(0, error.start - NEAR) : error.end + NEAR]
        _complain(DriverError(f"{near!r} contains characters that cannot be encoded: use UTF-8"))
        raise SystemExit(1) from None
    except Interrupted as error:
        _complain(error, color=None)
        raise SystemExit(INTERRUPTED) from None
