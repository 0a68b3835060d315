"""A command can use a dataclass whose fields are its options."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from servoloop.commands.shared.option_groups import grouped_options


@dataclass(frozen=True, slots=True)
class Servo:
    servo_id: Annotated[int, typer.Option("--id", min=0, max=253, help="ID of the servo.")]
    port: Annotated[str | None, typer.Option(help="Serial port.")] = None


@dataclass(frozen=True, slots=True)
class Other:
    port: str = ""


def app_with(command: Callable[..., None]) -> typer.Typer:
    app = typer.Typer(add_completion=False)
    app.command("write")(command)
    return app


def write(
    value: Annotated[int, typer.Argument(help="New value.")],
    servo: Servo,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Write a register."""
    typer.echo(f"{value} {servo} {json}")


def same(
    value: Annotated[int, typer.Argument(help="New value.")],
    servo_id: Annotated[int, typer.Option("--id", min=0, max=253, help="ID of the servo.")],
    port: Annotated[str | None, typer.Option(help="Serial port.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Write a register."""


def test_a_command_receives_the_dataclass_with_its_options() -> None:
    done = CliRunner().invoke(app_with(grouped_options(write)), ["7", "--id", "3", "--port", "/dev/ttyACM0", "--json"])
    assert (done.exit_code, done.output) == (0, "7 Servo(servo_id=3, port='/dev/ttyACM0') True\n")


def test_a_field_without_a_value_has_its_default() -> None:
    done = CliRunner().invoke(app_with(grouped_options(write)), ["7", "--id", "3"])
    assert (done.exit_code, done.output) == (0, "7 Servo(servo_id=3, port=None) False\n")


def test_the_help_is_that_of_a_command_with_single_options() -> None:
    texts = [CliRunner().invoke(app_with(command), ["--help"]).output for command in (grouped_options(write), same)]
    assert texts[0] == texts[1]
    assert "--id" in texts[0]


@pytest.mark.parametrize("arguments", [["7"], ["7", "--id", "254"]], ids=["missing", "out of range"])
def test_the_limits_of_a_field_hold(arguments: list[str]) -> None:
    assert CliRunner().invoke(app_with(grouped_options(write)), arguments).exit_code == 2


def test_two_fields_with_the_same_name_are_refused() -> None:
    def twice(servo: Servo, other: Other) -> None:
        """Never runs."""

    with pytest.raises(TypeError, match="twice: two parameters have the name 'port'"):
        grouped_options(twice)
