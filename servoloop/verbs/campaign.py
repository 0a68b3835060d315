"""``servoloop campaign``: one scenario with many seeds, and which invariants fell."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from servoloop.verbs.output import JsonOption, print_json

if TYPE_CHECKING:
    from rich.console import Console

    from servoloop.campaign.campaign import SeedReport
    from servoloop.simulation.schedule import Schedule


def campaign(
    scenario: Annotated[Path, typer.Option(help="YAML file: arm, job, seconds, how many faults of which kinds.")],
    seeds: Annotated[int, typer.Option(min=1, help="How many runs.")] = 100,
    first: Annotated[int, typer.Option(min=0, help="The first one's seed.")] = 0,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; as many as processors without.")] = None,
    out: Annotated[Path, typer.Option(help="Folder for the schedules that broke an invariant, shrunk.")] = Path(
        "out/campaign"
    ),
    json: JsonOption = False,
) -> None:
    """Look for the seed that breaks an arm: many runs on simulated time, each with faults of its own.

    Of each invariant that fell the first schedule is made as small as it can be and kept, to be seen again by
    `servoloop simulate --schedule FILE`. It ends with 1 where one fell.
    Example: `servoloop campaign --scenario docs/campaign.yaml --seeds 1000`
    """
    from rich.console import Console
    from rich.progress import Progress

    from servoloop.campaign.campaign import campaign as run
    from servoloop.campaign.campaign import read_scenario
    from servoloop.files import make_folder

    said = read_scenario(scenario)
    processes = jobs or os.cpu_count() or 1
    console = Console(stderr=True)
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task("runs", total=seeds)
        reports = run(said, range(first, first + seeds), processes, lambda _: progress.advance(task))
    fallen = _first_of_each(reports)
    if fallen:
        make_folder(out)
    kept = {invariant: _keep(report, invariant, out) for invariant, report in fallen.items()}
    if json:
        print_json(_plain(reports, kept))
    else:
        _print(reports, kept, Console())
    raise typer.Exit(1 if fallen else 0)


def _first_of_each(reports: "list[SeedReport]") -> "dict[str, SeedReport]":
    found: dict[str, SeedReport] = {}
    for report in reports:
        for violation in report.violations:
            found.setdefault(violation.invariant, report)
    return found


def _keep(report: "SeedReport", invariant: str, out: Path) -> Path:
    """Write the smallest schedule that still breaks it."""
    from servoloop.campaign.campaign import run_schedule_of
    from servoloop.campaign.shrink import shrink
    from servoloop.simulation.schedule import schedule_text

    def breaks(schedule: "Schedule") -> bool:
        return any(violation.invariant == invariant for violation in run_schedule_of(schedule).violations)

    path = out / f"{invariant.replace(' ', '-').replace(',', '')}-seed-{report.seed}.yaml"
    text = next(violation.text for violation in report.violations if violation.invariant == invariant)
    path.write_text(f"# {invariant}: {text}\n{schedule_text(shrink(report.schedule, breaks))}")
    return path


def _plain(reports: "list[SeedReport]", kept: dict[str, Path]) -> dict[str, Any]:
    return {
        "runs": len(reports),
        "simulated_s": round(sum(report.simulated_s for report in reports), 1),
        "jobs_succeeded": sum(report.succeeded for report in reports),
        "ended_early": sum(bool(report.ended) for report in reports),
        "violations": [
            {"seed": report.seed, "invariant": one.invariant, "time_s": one.time_s, "text": one.text}
            for report in reports
            for one in report.violations
        ],
        "kept": {invariant: str(path) for invariant, path in kept.items()},
    }


def _print(reports: "list[SeedReport]", kept: dict[str, Path], console: "Console") -> None:
    from rich.table import Table

    simulated_h = sum(report.simulated_s for report in reports) / 3600.0
    ended = sum(bool(report.ended) for report in reports)
    console.print(f"{len(reports)} runs, {simulated_h:.2f} h of simulated time, {ended} ended by a lost line")
    console.print(f"{sum(report.succeeded for report in reports)} cubes in their bins")
    if not kept:
        console.print("no invariant fell", style="green")
        return
    table = Table("seed", "at", "invariant", "what")
    for report in reports:
        for one in report.violations:
            table.add_row(str(report.seed), f"{one.time_s:.3f} s", one.invariant, one.text)
    console.print(table)
    for invariant, path in kept.items():
        console.print(f"{invariant}: servoloop simulate --schedule {path}", soft_wrap=True)
