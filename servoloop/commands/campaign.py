"""``servoloop campaign``: one scenario with many seeds, and which invariants fell."""

import os
from collections.abc import Sequence
from contextlib import nullcontext
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drivers.errors import DriverError
from drivers.printable import counted
from servoloop.commands.console import JsonOption, print_json
from servoloop.stack.processes import Interrupted
from servoloop.stack.robot_files import make_folder
from servoloop.stack.signals import Signals

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from servoloop.campaign.campaign import Scenario
    from servoloop.campaign.invariants.invariant import Violation
    from servoloop.campaign.kept_violation import KeptViolation
    from servoloop.campaign.tally import Tally
    from servoloop.campaign.workers import Stop

REPORT = "report.html"
NOTHING_FELL = "no invariant was violated"
NOT_LOOKED_AT = "Run more seeds, or name under `promises` in the scenario what it is to look at."


def campaign(
    scenario: Annotated[
        Path | None, typer.Option(help="YAML file: arm, job, seconds, how many faults of which kinds.")
    ] = None,
    schedule: Annotated[
        Path | None, typer.Option(help="Instead of a scenario: one run, as a campaign has kept it, to see it again.")
    ] = None,
    arm: Annotated[
        str | None, typer.Option(help="Instead of the scenario's arm: a name that `servoloop arms` lists, or a folder.")
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="How many runs.")] = 100,
    first: Annotated[int, typer.Option(min=0, help="The first one's seed.")] = 0,
    jobs: Annotated[
        int | None,
        typer.Option(min=0, help="Processes; as many as processors without. 0: this process, as for a debugger."),
    ] = None,
    ray: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Run on a Ray cluster instead; `local` starts one on this machine."),
    ] = None,
    out: Annotated[
        Path,
        typer.Option(help="Folder for the report, and for schedules that broke an invariant, with traces."),
    ] = Path("out/campaign"),
    json: JsonOption = False,
) -> None:
    """Look for the seed that breaks an arm: many runs on simulated time, each with faults of its own.

    Of each invariant that fell the first schedule is made as small as it can be and kept, with the last two seconds
    before as a trace; the report is one page with plots. It ends with 1 where an invariant fell. Ctrl-C ends it with
    what was done so far.
    Example: `servoloop campaign --scenario docs/campaign.yaml --seeds 1000`
    """
    if (scenario is None) == (schedule is None):
        raise DriverError("name one file: --scenario for many runs, or --schedule to see one run again")
    if schedule is not None and arm is not None:
        raise DriverError(f"--arm goes with --scenario: {schedule} names its arm itself")
    if schedule is not None:
        raise typer.Exit(_see_again(schedule, out, json))
    assert scenario is not None
    from servoloop.campaign.campaign import read_scenario

    said = read_scenario(scenario, arm)
    make_folder(out)
    asked, processes = range(first, first + seeds), jobs if jobs is not None else os.cpu_count() or 1
    with Signals() as signals:
        tally, ended_by = _run(said, asked, processes, ray, lambda: signals.count > 0)
        fallen, page, unwritten = _keep(tally, out, lambda: signals.count > 0, apart=processes > 0)
        interrupted = signals.count > 0
    if json:
        print_json({**tally.plain(), **_files(fallen, page)})
    else:
        _print(tally, fallen, page)
    if error := ended_by or unwritten:
        raise error
    if interrupted:
        raise Interrupted(f"interrupted: {len(tally.rows)} of {tally.planned} runs were done, and are reported")
    raise typer.Exit(1 if fallen or tally.broken_promises else 0)


def _run(
    scenario: "Scenario", seeds: range, processes: int, ray: str | None, stop: "Stop"
) -> "tuple[Tally, DriverError | None]":
    """Run the scenario with each seed; an error that ends the campaign is returned: the runs are to be told first."""
    from rich.console import Console
    from rich.progress import Progress

    from servoloop.campaign.campaign import campaign as run
    from servoloop.campaign.supervised import WorkerError
    from servoloop.campaign.tally import Tally

    tally = Tally(scenario, len(seeds))
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("runs", total=len(seeds))
        try:
            for report in run(scenario, seeds, processes, stop, ray):
                tally.add(report)
                progress.advance(task)
        except WorkerError as error:
            return tally, error
    return tally, None


def _keep(
    tally: "Tally", out: Path, stop: "Stop", apart: bool
) -> "tuple[list[KeptViolation], Path | None, DriverError | None]":
    """Write schedules, traces and the page into ``out``; an error is returned: the runs are to be told first.

    ``apart``: whether runs that look for smaller schedules take place in another process.
    """
    from rich.console import Console
    from rich.progress import track

    from servoloop.campaign.kept_violation import keep
    from servoloop.campaign.shrinking import violated, violated_apart

    fallen: list[KeptViolation] = []
    console = Console(stderr=True)
    try:
        with violated_apart() if apart and tally.first else nullcontext(violated) as names:
            first = track(tally.first.items(), "what fell, made small", console=console, transient=True)
            for invariant, report in first:
                fallen.append(keep(report, invariant, out, stop, names))
        return fallen, _write_page(out / REPORT, tally, fallen), None
    except DriverError as error:
        return fallen, None, error


def _see_again(path: Path, out: Path, json: bool) -> int:
    """One schedule: what falls in it is printed and traced. Returns the exit status."""
    from rich.console import Console

    from servoloop.campaign.campaign import require_possible_schedule
    from servoloop.campaign.kept_violation import KeptViolation, recorded, stem_of, traced
    from servoloop.simulation.schedule import read_schedule

    schedule = read_schedule(path)
    require_possible_schedule(path, schedule)
    make_folder(out)
    report, recording = recorded(schedule)
    fallen: list[KeptViolation] = []
    page, unwritten = None, None
    try:
        for one in report.violations:
            fallen.append(traced(one, schedule, recording, path, out / f"{path.stem}-{stem_of(one.invariant)}.csv"))
        page = _write_page(out / f"{path.stem}.html", None, fallen)
    except DriverError as error:  # what fell is told first
        unwritten = error
    violations = [{"invariant": one.invariant, "time_s": one.time_s, "text": one.text} for one in report.violations]
    if json:
        print_json({"violations": violations, **_files(fallen, page)})
    else:
        console = Console()
        _print_fallen(report.violations, fallen, console)
        if not report.violations:
            console.print(NOTHING_FELL, style="green")
        _print_page(page, console)
    if unwritten:
        raise unwritten
    return 1 if report.violations else 0


def _write_page(path: Path, tally: "Tally | None", fallen: "list[KeptViolation]") -> Path | None:
    from servoloop.campaign import report

    if not report.possible():
        typer.echo(f"servoloop: {report.MISSING}", err=True)
        return None
    report.write(path, tally, fallen)
    return path


def _files(fallen: "list[KeptViolation]", page: Path | None) -> dict[str, Any]:
    """The files that were written, for programs."""
    return {
        "kept": {one.violation.invariant: str(one.schedule_path) for one in fallen},
        "traces": {one.violation.invariant: str(one.trace_path) for one in fallen if one.trace_path},
        "not_minimized": {one.violation.invariant: one.note for one in fallen if one.note},
        "report": None if page is None else str(page),
    }


def _print(tally: "Tally", fallen: "list[KeptViolation]", page: Path | None) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console()
    simulated_h = tally.simulated_s / 3600.0
    console.print(
        f"{counted(len(tally.rows), 'run')}, {simulated_h:.2f} h of simulated time, {tally.ended} ended by a lost line"
    )
    console.print(f"{tally.succeeded} of {tally.jobs} cubes in their bins")
    console.print(_marks(tally))
    if tally.violations:
        table = Table("seed", "at", "invariant", "what")
        for seed, one in tally.violations:
            table.add_row(str(seed), f"{one.time_s:.3f} s", one.invariant, one.text)
        console.print(table)
    _print_fallen([one.violation for one in fallen], fallen, console)
    for promise in tally.broken_promises:
        console.print(f"not looked at: {promise}", style="red", soft_wrap=True, markup=False, highlight=False)
    if tally.broken_promises:
        console.print(NOT_LOOKED_AT, soft_wrap=True, markup=False, highlight=False)
    if not tally.violations:
        console.print(NOTHING_FELL, style="green")
    _print_page(page, console)


def _marks(tally: "Tally") -> "Table":
    """The table of what each invariant examined."""
    from rich.table import Table

    table = Table("invariant", "examined", "runs that violate it")
    for name, examined, runs in tally.marks:
        table.add_row(name, str(examined), str(runs))
    return table


def _print_fallen(violations: "Sequence[Violation]", fallen: "list[KeptViolation]", console: "Console") -> None:
    """Print each violation, and where its trace is; of the last ones none may have been written."""
    for violation, one in zip_longest(violations, fallen):
        text = f"{violation.invariant}: at {violation.time_s:.3f} s: {violation.text}"
        console.print(text, style="red", soft_wrap=True, markup=False, highlight=False)
        if one is not None:
            for line in (one.note or f"trace: {one.trace_path}", f"again: {one.command}"):
                console.print(f"  {line}", soft_wrap=True, markup=False, highlight=False)


def _print_page(page: Path | None, console: "Console") -> None:
    if page is not None:
        console.print(f"report: {page}", soft_wrap=True, markup=False, highlight=False)
