"""The command ``servoloop campaign``: run a scenario with many seeds and report violated invariants."""

import os
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from commissioning.atomic_write import make_folder
from drivers.driver_errors import DriverError
from drivers.printable import counted
from hal.plausible import RANGES
from servoloop.commands.shared.console import JsonOption, print_json, text_console
from servoloop.commands.shared.option_groups import grouped_options
from servoloop.stack.processes import Interrupted
from servoloop.stack.signals import Signals

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from servoloop.campaign.invariants import Violation
    from servoloop.campaign.kept_violation import KeptViolation
    from servoloop.campaign.scenario import Scenario
    from servoloop.campaign.tally import Tally
    from servoloop.campaign.workers import Stop

REPORT = "report.html"
NO_VIOLATION = "no invariant was violated"
NOT_EXAMINED = "Run more seeds, or set `promises` in the scenario to the conditions that the campaign must examine."
LARGEST_SEED: Final = int(RANGES["seed"].highest)


@dataclass(frozen=True, slots=True)
class CampaignRuns:
    """Runs of a campaign, and the processes or the cluster that executes them."""

    seeds: Annotated[int, typer.Option(min=1, help="Number of runs.")] = 100
    first: Annotated[int, typer.Option(min=0, max=LARGEST_SEED, help="Random seed of the first run.")] = 0
    jobs: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Number of processes (default: the number of processors). 0 uses only this process, for debugging.",
        ),
    ] = None
    ray: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Run on a Ray cluster at this address. `local` starts Ray on this machine."
        ),
    ] = None

    def requested(self) -> range:
        """Return the seeds of all runs. Raises DriverError."""
        if self.first + self.seeds - 1 > LARGEST_SEED:
            raise DriverError(
                f"{counted(self.seeds, 'run')} from seed {self.first} would exceed the largest seed {LARGEST_SEED}: "
                "choose a smaller --first or --seeds"
            )
        return range(self.first, self.first + self.seeds)

    def processes(self) -> int:
        """Return the number of processes, or 0 for this process."""
        return self.jobs if self.jobs is not None else os.cpu_count() or 1


@grouped_options
def campaign(
    *,
    scenario: Annotated[Path | None, typer.Option(help="YAML file with the properties that all runs share.")] = None,
    schedule: Annotated[
        Path | None, typer.Option(help="Run one schedule that a campaign has saved, instead of a scenario.")
    ] = None,
    arm: Annotated[
        str | None,
        typer.Option(help="Arm that replaces the arms of the scenario: a name from `servoloop arms`, or a folder."),
    ] = None,
    runs: CampaignRuns,
    out: Annotated[
        Path,
        typer.Option(help="Folder for the report, and for the schedules and traces of violations."),
    ] = Path("out/campaign"),
    json: JsonOption = False,
) -> None:
    """Run many simulations with random faults, and find the seeds for which an arm violates an invariant.

    For each violated invariant, the first failing schedule is minimized and saved with a trace of the two seconds
    before the violation. The report is one page with plots. The exit status is 1 if an invariant was violated or a
    promise was not kept. After Ctrl-C, the campaign stops and reports the completed runs.
    Example: `servoloop campaign --scenario docs/campaign.yaml --seeds 1000`
    """
    if (scenario is None) == (schedule is None):
        raise DriverError("specify one file: --scenario for many runs, or --schedule to repeat one run")
    if schedule is not None and arm is not None:
        raise DriverError(f"--arm needs --scenario: the schedule {schedule} already names an arm")
    if schedule is not None:
        raise typer.Exit(_repeat(schedule, out, json))
    assert scenario is not None
    from servoloop.campaign.campaign import read_scenario

    checked = read_scenario(scenario, arm)
    make_folder(out)
    with Signals() as signals:
        tally, ended_by = _run(checked, runs, lambda: signals.count > 0)
        kept, page, unwritten = _keep(tally, out, lambda: signals.count > 0, apart=runs.processes() > 0)
        interrupted = signals.count > 0
    if json:
        print_json({**tally.plain(), **_files(kept, page)})
    else:
        _print(tally, kept, page)
    if error := ended_by or unwritten:
        raise error
    if interrupted:
        raise Interrupted(f"interrupted: {len(tally.rows)} of {tally.planned} runs were completed and are reported")
    raise typer.Exit(1 if kept or tally.broken_promises else 0)


def _run(scenario: "Scenario", runs: CampaignRuns, stop: "Stop") -> "tuple[Tally, DriverError | None]":
    """Run the scenario with each seed. Return the tally, and the error that ended the campaign early, if any."""
    from rich.progress import Progress

    from servoloop.campaign.campaign import campaign as run
    from servoloop.campaign.supervised import WorkerError
    from servoloop.campaign.tally import Tally

    tally = Tally(scenario, runs.seeds)
    with Progress(console=text_console(stderr=True), transient=True) as progress:
        task = progress.add_task("runs", total=runs.seeds)
        try:
            for report in run(scenario, runs.requested(), runs.processes(), stop, runs.ray):
                tally.add(report)
                progress.advance(task)
        except WorkerError as error:
            return tally, error
    return tally, None


def _keep(
    tally: "Tally", out: Path, stop: "Stop", apart: bool
) -> "tuple[list[KeptViolation], Path | None, DriverError | None]":
    """Write schedules, traces and the report. The error is returned instead of raised, so that the results are printed
    first.

    Args:
        tally: Results of the campaign.
        out: Folder for the files.
        stop: Function that returns whether to stop minimizing.
        apart: Whether to minimize in a separate process.

    Returns:
        The saved violations, the report file if it was written, and the error.
    """
    from rich.progress import track

    from servoloop.campaign.kept_violation import keep
    from servoloop.campaign.shrink import violated, violated_apart

    kept: list[KeptViolation] = []
    console = text_console(stderr=True)
    try:
        with violated_apart() if apart and tally.first else nullcontext(violated) as names:
            first = track(tally.first.items(), "minimizing", console=console, transient=True)
            for invariant, report in first:
                kept.append(keep(report, invariant, out, stop, names))
        return kept, _write_page(out / REPORT, tally, kept), None
    except DriverError as error:
        return kept, None, error


def _repeat(path: Path, out: Path, json: bool) -> int:
    """Run one schedule, print its violations and write their traces. Return the exit status."""

    from servoloop.campaign.campaign import require_possible_schedule
    from servoloop.campaign.kept_violation import KeptViolation, recorded, stem_of, traced
    from servoloop.simulation.schedule import read_schedule

    schedule = read_schedule(path)
    require_possible_schedule(path, schedule)
    make_folder(out)
    report, recording = recorded(schedule)
    kept: list[KeptViolation] = []
    page, unwritten = None, None
    try:
        for one in report.violations:
            kept.append(traced(one, schedule, recording, path, out / f"{path.stem}-{stem_of(one.invariant)}.csv"))
        page = _write_page(out / f"{path.stem}.html", None, kept)
    except DriverError as error:  # The violations are printed before this error is raised.
        unwritten = error
    violations = [{"invariant": one.invariant, "time_s": one.time_s, "text": one.text} for one in report.violations]
    if json:
        print_json({"violations": violations, **_files(kept, page)})
    else:
        console = text_console()
        _print_kept(report.violations, kept, console)
        if not report.violations:
            console.print(NO_VIOLATION, style="green")
        _print_page(page, console)
    if unwritten:
        raise unwritten
    return 1 if report.violations else 0


def _write_page(path: Path, tally: "Tally | None", kept: "list[KeptViolation]") -> Path | None:
    from servoloop.campaign import report
    from servoloop.extras import missing_extras

    if sentence := missing_extras("the report", "report"):
        typer.echo(f"servoloop: {sentence}", err=True)
        return None
    report.write(path, tally, kept)
    return path


def _files(kept: "list[KeptViolation]", page: Path | None) -> dict[str, Any]:
    """Return the files that were written, as printed with ``--json``."""
    return {
        "kept": {one.violation.invariant: str(one.schedule_path) for one in kept},
        "traces": {one.violation.invariant: str(one.trace_path) for one in kept if one.trace_path},
        "not_minimized": {one.violation.invariant: one.note for one in kept if one.note},
        "report": None if page is None else str(page),
    }


def _print(tally: "Tally", kept: "list[KeptViolation]", page: Path | None) -> None:
    from rich.table import Table

    console = text_console()
    simulated_h = tally.simulated_s / 3600.0
    console.print(
        f"{counted(len(tally.rows), 'run')}, {simulated_h:.2f} h of simulated time, {tally.ended} ended early"
    )
    console.print(f"{tally.succeeded} of {tally.jobs} cubes in their bins")
    console.print(_marks(tally))
    if tally.violations:
        table = Table("seed", "time", "invariant", "violation")
        for seed, one in tally.violations:
            table.add_row(str(seed), f"{one.time_s:.3f} s", one.invariant, one.text)
        console.print(table)
    _print_kept([one.violation for one in kept], kept, console)
    for promise in tally.broken_promises:
        console.print(f"not examined: {promise}", style="red", soft_wrap=True, highlight=False)
    if tally.broken_promises:
        console.print(NOT_EXAMINED, soft_wrap=True, highlight=False)
    if not tally.violations:
        console.print(NO_VIOLATION, style="green")
    _print_page(page, console)


def _marks(tally: "Tally") -> "Table":
    """Return a table that shows how often the condition of each invariant was checked."""
    from rich.table import Table

    table = Table("invariant", "examined", "runs that violate it")
    for name, examined, runs in tally.marks:
        table.add_row(name, str(examined), str(runs))
    return table


def _print_kept(violations: "Sequence[Violation]", kept: "list[KeptViolation]", console: "Console") -> None:
    """Print each violation with its trace. The last violations may have no trace if a file could not be written."""
    for violation, one in zip_longest(violations, kept):
        text = f"{violation.invariant}: at {violation.time_s:.3f} s: {violation.text}"
        console.print(text, style="red", soft_wrap=True, highlight=False)
        if one is not None:
            for line in (one.note or f"trace: {one.trace_path}", f"repeat: {one.command}"):
                console.print(f"  {line}", soft_wrap=True, highlight=False)


def _print_page(page: Path | None, console: "Console") -> None:
    if page is not None:
        console.print(f"report: {page}", soft_wrap=True, highlight=False)
