"""``servoloop ports``: list serial adapters and what prevents programs from using them."""

from typing import TYPE_CHECKING, Annotated

import typer

from servoloop.commands.shared.console import JsonOption, print_json, text_console
from servoloop.stack.processes import Interrupted

if TYPE_CHECKING:
    from rich.console import Console

    from commissioning.ports.adapters import Adapter, PortsReport


def ports(
    wait: Annotated[
        bool, typer.Option("--wait", help="Wait until an adapter is plugged in or unplugged, and print its path.")
    ] = False,
    timeout: Annotated[float, typer.Option(min=0.1, help="Maximum time that --wait waits, in seconds.")] = 60.0,
    json: JsonOption = False,
) -> None:
    """List the serial adapters with their chips, serial numbers, permissions, users and problems.

    The command does not open any port.
    Example: `servoloop ports`, or `servoloop ports --wait` while you plug in an adapter
    """

    from commissioning.ports.adapters import ports as inspect

    if wait:
        _wait(timeout, json)
        return
    report = inspect()
    if json:
        print_json(report)
    else:
        print_report(report, text_console())


def _wait(timeout_s: float, json: bool) -> None:

    from commissioning.ports.plugging import wait_for_plugging

    typer.echo("Plug in or unplug the adapter.", err=True)
    try:
        plugged = wait_for_plugging(timeout_s)
    except KeyboardInterrupt:
        raise Interrupted("interrupted") from None
    if json:
        print_json(plugged)
        return
    words = {"plugged": "was plugged in", "pulled": "was unplugged", "vanished": "was plugged in and vanished at once"}
    why = f": {plugged.why}" if plugged.why else ""
    console = text_console()
    console.print(f"{plugged.adapter.device} {words[plugged.happened]}{why}", highlight=False)
    if plugged.happened == "plugged":
        _print_adapter(plugged.adapter, console)


def print_report(report: "PortsReport", console: "Console") -> None:
    """Print the adapters, their problems and the udev rule to add."""
    from commissioning.ports.adapters import RELOAD, RULE_FILE

    for adapter in report.adapters:
        _print_adapter(adapter, console)
    if not report.adapters:
        console.print("No serial adapter is plugged in.")
    for complaint in report.complaints:
        console.print(f"! {complaint}", style="yellow", highlight=False)
    if report.udev_rule:
        console.print(f"\nAdd this udev rule to {RULE_FILE}, then run {RELOAD}:", highlight=False)
        console.print(report.udev_rule, highlight=False, soft_wrap=True)


def _print_adapter(adapter: "Adapter", console: "Console") -> None:
    from rich.table import Table

    table = Table(title=adapter.device, show_header=False, title_justify="left")
    allowed = adapter.permission
    numbers = "" if adapter.vid is None else f" {adapter.vid:04x}:{adapter.pid:04x}"
    rows = {
        "chip": adapter.chip + numbers,
        "product": adapter.product,
        "serial number": adapter.serial_number,
        "permanent name": adapter.by_id,
        "access": allowed and f"{allowed.mode}, group {allowed.group}: {'yours' if allowed.may_open else 'not yours'}",
        "latency timer": None if adapter.latency_ms is None else f"{adapter.latency_ms} ms",
        "in use by": ", ".join(f"{holder.program} ({holder.pid})" for holder in adapter.holders) or None,
    }
    for name, value in rows.items():
        if value:
            table.add_row(name, value)
    console.print(table)
    for complaint in adapter.complaints:
        console.print(f"! {complaint}", style="yellow", highlight=False)
