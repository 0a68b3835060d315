"""``servoloop simulate``: run the whole stack in simulated time, in one thread."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from drivers.driver_errors import DriverError
from drivers.printable import counted
from hal.plausible import RANGES
from servoloop.commands.shared.console import JsonOption, print_json, text_console
from servoloop.commands.shared.option_groups import grouped_options
from servoloop.recording.mcap import RecordOption, check_path
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.arm_options import BACKLASH_DEG, ArmOption, RobotOption
from servoloop.stack.shipped_files import OWN

if TYPE_CHECKING:
    from rich.console import Console

    from servoloop.simulation.schedule import Schedule
    from servoloop.simulation.simulate import SimulationResult


@dataclass(frozen=True, slots=True)
class SimulatedRun:
    """Virtual arm, jobs, duration and faults of a run."""

    arm: ArmOption = OWN
    robot: RobotOption = None
    job: Annotated[str | None, typer.Option(help="Grades of the cubes to pick, such as A,B,C.")] = None
    seconds: Annotated[
        float | None,
        typer.Option(min=0.0, max=RANGES["time"].highest, help="Time to run after the jobs, in seconds."),
    ] = None
    backlash_deg: Annotated[
        float, typer.Option("--backlash", min=0.0, max=10.0, help="Backlash of each servo, in degrees.")
    ] = BACKLASH_DEG
    seed: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=RANGES["seed"].highest,
            help="Seed for random variations of up to 10 % in friction, motors, masses and supply.",
        ),
    ] = None
    faults: Annotated[
        Path | None, typer.Option(help="YAML file with faults to inject (see `servoloop fault --list`).")
    ] = None

    def schedule(self) -> "Schedule":
        """Return the schedule of the run. Raises DriverError."""
        from servoloop.simulation.schedule import Schedule
        from sim_backend.faults.script import read_script

        return Schedule(
            arm=self.arm,
            seed=self.seed,
            backlash_deg=self.backlash_deg,
            job=self._grades(),
            seconds=self.seconds or 0.0,
            faults=read_script(self.faults) if self.faults else (),
        )

    def _grades(self) -> tuple[str, ...]:
        """Return the grades to pick, which are all grades if the run has neither jobs nor a duration."""
        from servoloop.stack.pick_place import load_pick_place

        if self.job is None and self.seconds is not None:
            return ()
        known = load_pick_place(find_arm(self.arm).pick_place).grades
        return known if self.job is None else _grades(self.job, known)


@grouped_options
def simulate(chosen: SimulatedRun, record: RecordOption = None, json: JsonOption = False) -> None:
    """Run pick-and-place jobs on a virtual arm in simulated time, without ROS.

    The command runs the whole stack from the controllers to the simulated physics, faster than real time. The command
    prints following errors, timing and a digest of all bytes on the bus and all joint states. The same arguments
    produce the same digest. If neither --job nor --seconds is given, the command picks all grades of the arm once. The
    exit status is 1 if a job failed.
    Example: `servoloop simulate --arm so101 --seed 1 --job A,B,C`
    """

    from servoloop.simulation.job import job_settings
    from servoloop.simulation.simulate import simulate as run
    from servoloop.simulation.simulate import simulated
    from servoloop.simulation.stack_faults import require_possible_in
    from sim_backend.compiled import compilation_announced

    if record is not None:
        check_path(record)
    schedule, arm = chosen.schedule(), find_arm(chosen.arm)
    files = read_arm_files(arm, robot=chosen.robot)
    if chosen.faults is not None:
        require_possible_in(chosen.faults, schedule.faults, simulated(files), ())
    with compilation_announced(lambda text: typer.echo(text, err=True)):
        result = run(files, job_settings(arm, schedule.job), schedule, record)
    if json:
        print_json(_plain(result))
    else:
        _print(result, text_console())
    raise typer.Exit(0 if result.success else 1)


def _grades(text: str, known: tuple[str, ...]) -> tuple[str, ...]:
    grades = tuple(grade.strip().upper() for grade in text.split(",") if grade.strip())
    if not grades or set(grades) - set(known):
        raise DriverError(f"--job {text!r}: expected grades separated by commas, such as {','.join(known)}")
    return grades


def _plain(result: "SimulationResult") -> dict[str, Any]:
    """Return the result as data for JSON output."""
    return {
        "success": result.success,
        "jobs": [
            {
                **({"arm": job.arm} if job.arm else {}),
                "grade": job.grade,
                "success": job.success,
                "bin": job.bin,
                "message": job.message,
                "duration_s": round(job.duration_s, 3),
                "following_error": job.following.as_dict(job.joints),
            }
            for job in result.jobs
        ],
        "simulated_s": round(result.simulated_s, 3),
        "cycles": result.cycles,
        "missed_cycles": result.missed_cycles,
        "unmeasured_cycles": result.unmeasured_cycles,
        "faulty_cycles": result.faulty_cycles,
        "following_error": _following(result),
        "digest": result.digest,
        "cpu_s": round(result.cpu_s, 3),
    }


def _following(result: "SimulationResult") -> dict[str, Any]:
    """Return the following error of a single arm, or of each arm keyed by controller name."""
    errors = {name: error.as_dict(result.joints[name]) for name, error in result.following.items()}
    return errors if len(errors) > 1 else next(iter(errors.values()))


def _print(result: "SimulationResult", console: "Console") -> None:
    from rich.table import Table
    from rich.text import Text

    arms = any(job.arm for job in result.jobs)
    columns = ("grade", "bin", "time", "largest", "RMS", "at rest", "message")
    table = Table(*(("arm", *columns) if arms else columns), title="following error, rad")
    for job in result.jobs:
        error = job.following
        numbers = [f"{max(values):.4f}" for values in (error.largest_rad, error.rms_moving_rad, error.at_rest_rad)]
        style = "green" if job.success else "red"
        place = Text(job.bin or "none", style)
        row: list[str | Text] = [job.grade, place, f"{job.duration_s:.2f} s", *numbers, job.message]
        table.add_row(*((job.arm, *row) if arms else row))
    if result.jobs:
        console.print(table)
    on_time = "all on time" if not result.missed_cycles else f"{result.missed_cycles} missed"
    times = result.simulated_s / result.cpu_s
    console.print(
        f"simulated {result.simulated_s:.1f} s in {result.cpu_s:.1f} s of CPU time ({times:.0f} times real time)"
    )
    console.print(
        f"{counted(result.cycles, 'cycle')}, {on_time}, {result.unmeasured_cycles} without measured positions"
    )
    for what, cycles in result.faulty_cycles.items():
        console.print(f"{what}: {counted(cycles, 'cycle')}", style="yellow")
    console.print(f"digest {result.digest}", highlight=False, soft_wrap=True)
