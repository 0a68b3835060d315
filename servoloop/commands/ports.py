"""``servoloop ports``: serial adapters, and what stands between them and a program."""

from typing import TYPE_CHECKING, Annotated

import typer

from servoloop.commands.console import JsonOption, print_json
from servoloop.stack.processes import Interrupted

if TYPE_CHECKING:
    from rich.console import Console

    from commissioning.ports.adapters import Adapter, PortsReport


def ports(
    wait: Annotated[
        bool, typer.Option("--wait", help="Wait until one is plugged in or pulled, and say which.")
    ] = False,
    timeout: Annotated[float, typer.Option(min=0.1, help="How long to wait for that, s.")] = 60.0,
    json: JsonOption = False,
) -> None:
    """List the serial adapters: chip, serial number, who may open them, who has them open, what to mend.

    Nothing is opened.
    Example: `servoloop ports`, and `servoloop ports --wait` while plugging one in.
    """
    from rich.console import Console

    from commissioning.ports.adapters import ports as look

    if wait:
        _wait(timeout, json)
        return
    report = look()
    if json:
        print_json(report)
    else:
        print_report(report, Console())


def _wait(timeout_s: float, json: bool) -> None:
    from rich.console import Console

    from commissioning.ports.plugging import wait_for_plugging

    typer.echo("plug the adapter in, or pull it out", err=True)
    try:
        plugged = wait_for_plugging(timeout_s)
    except KeyboardInterrupt:
        raise Interrupted("interrupted") from None
    if json:
        print_json(plugged)
        return
    words = {"plugged": "was plugged in", "pulled": "was pulled", "vanished": "was plugged in and vanished at once"}
    why = f": {plugged.why}" if plugged.why else ""
    console = Console()
    console.print(f"{plugged.adapter.device} {words[plugged.happened]}{why}", highlight=False)
    if plugged.happened == "plugged":
        _print_adapter(plugged.adapter, console)


def print_report(report: "PortsReport", console: "Console") -> None:
    """For people."""
    from commissioning.ports.adapters import RELOAD, RULE_FILE

    for adapter in report.adapters:
        _print_adapter(adapter, console)
    if not report.adapters:
        console.print("no serial adapter is plugged in")
    for complaint in report.complaints:
        console.print(f"! {complaint}", style="yellow", highlight=False, markup=False)
    if report.udev_rule:
        console.print(f"\nudev rule for {RULE_FILE}, then {RELOAD}:", highlight=False)
        console.print(report.udev_rule, highlight=False, markup=False, soft_wrap=True)


def _print_adapter(adapter: "Adapter", console: "Console") -> None:
    from rich.table import Table

    table = Table(title=adapter.device, show_header=False, title_justify="left")
    allowed = adapter.permission
    numbers = "" if adapter.vid is None else f" {adapter.vid:04x}:{adapter.pid:04x}"
    rows = {
        "chip": adapter.chip + numbers,
        "product": adapter.product,
        "serial number": adapter.serial_number,
        "lasting name": adapter.by_id,
        "access": allowed and f"{allowed.mode}, group {allowed.group}: {'yours' if allowed.may_open else 'not yours'}",
        "latency timer": None if adapter.latency_ms is None else f"{adapter.latency_ms} ms",
        "in use by": ", ".join(f"{holder.program} ({holder.pid})" for holder in adapter.holders) or None,
    }
    for name, value in rows.items():
        if value:
            table.add_row(name, value)
    console.print(table)
    for complaint in adapter.complaints:
        console.print(f"! {complaint}", style="yellow", highlight=False, markup=False)
