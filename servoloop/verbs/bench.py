"""``servoloop bench``: measure what is connected."""

from typing import Annotated

import typer

app = typer.Typer(no_args_is_help=True, help="Measure what is connected.")

LARGEST_BAUD = 12_000_000
"""Of the fastest USB adapters."""


@app.command()
def bus(
    port: Annotated[str, typer.Option(help="Serial device of the servos.")],
    ids: Annotated[str, typer.Option(help="Servo IDs, such as 1-7 or 1,2,5.")] = "1-7",
    model: Annotated[str, typer.Option(help="Servo model.")] = "sts3215",
    baud: Annotated[int, typer.Option(min=1, max=LARGEST_BAUD, help="Bits per second.")] = 1_000_000,
    cycles: Annotated[int, typer.Option(min=1, help="How many cycles to measure.")] = 1000,
    hold: Annotated[
        bool, typer.Option("--hold", help="Servos without torque get it for as long as this runs.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="One line of JSON instead of a table.")] = False,
) -> None:
    """Read the full state of every servo and write a goal to each, as fast as the line allows.

    Nothing moves: the goals are those that the servos hold. A goal switches a limp servo on: such are only read,
    unless --hold holds them where they stand; in the end they are limp again. Of those that get goals, goal speed
    and acceleration become 0, which is as fast as they can. Faults are counted, not fatal; it ends
    with 1 where nobody answers, where all servos have another table than the model, and where the port is lost.
    Example: `servoloop bench bus --port /dev/ttyACM0 --ids 1-7`
    """
    from rich.console import Console

    from servoloop import bench_bus

    figures = bench_bus.bench_bus(port, bench_bus.parse_ids(ids), model, baud, cycles, hold=hold)
    if json:
        typer.echo(bench_bus.as_json(figures))
    else:
        bench_bus.print_table(figures, Console())
