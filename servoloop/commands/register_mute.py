"""``servoloop register write`` with ``--model``, for a servo that answers only pings."""

from typing import Annotated

import typer

from commissioning.errors import CommissioningError
from servoloop.commands.line_options import interruptible

ModelOption = Annotated[
    str | None,
    typer.Option("--model", help="Model of a servo that answers no reads, to write its status level without a reply."),
]


def write_status_level(port: str | None, servo_id: int, baud: int | None, model: str, words: list[str]) -> None:
    """Let a servo answer reads again. Raises CommissioningError if anything but its status level is to be written."""
    from commissioning.ports.adapters import only_port
    from commissioning.registers.mute import answer_reads
    from drivers.clock import MonotonicClock
    from drivers.port.serial_port import SerialPort
    from drivers.servos.catalog import MODELS, series_of

    if model not in MODELS:
        raise CommissioningError(f"--model {model} is unknown: use one of {', '.join(sorted(MODELS))}")
    series = series_of(MODELS[model])
    if words != [series.status_level.name, str(series.answers_all)]:
        raise CommissioningError(
            f"with --model, only '{series.status_level.name} {series.answers_all}' can be written. Omit --model for a "
            "servo that answers reads"
        )
    clock = MonotonicClock()
    line = SerialPort(port or only_port(), baud or 1_000_000, clock)
    try:
        with interruptible():
            level = answer_reads(line, clock, servo_id, MODELS[model], (baud,) if baud else ())
    finally:
        line.close()
    typer.echo(f"servo {servo_id} answers reads; its {series.status_level.name} is {level}")
