"""``servoloop demo``: pick and place on virtual servos, measured."""

from pathlib import Path
from typing import Annotated

import typer

from drivers.errors import DriverError
from nodes.ros_environment import require_ros
from servoloop.arms.folder import OWN, find_arm
from servoloop.files import make_folder
from servoloop.recorder.record_option import RecordOption, check_path
from servoloop.verbs.arm_options import BACKLASH_DEG, ArmOption, BacklashOption, RobotOption, SeedOption
from servoloop.view.installed import require_view


def demo(
    grades: Annotated[str, typer.Option(help="Grades to pick, separated by commas.")] = "A,B,C",
    repeat: Annotated[int, typer.Option(min=1, help="How often to go through them.")] = 1,
    out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("out/demo"),
    arm: ArmOption = OWN,
    robot: RobotOption = None,
    backlash_deg: BacklashOption = BACKLASH_DEG,
    seed: SeedOption = None,
    record: RecordOption = None,
    view: Annotated[bool, typer.Option("--view", help="Show the arm in a browser meanwhile.")] = False,
) -> None:
    """Pick and place on virtual servos: show it live, measure it, exit with 0 if all cubes are right.

    With all grades two more cubes are sorted for comparison, one without gravity compensation and one without lead.
    Example: `servoloop demo --grades A,C --repeat 3`
    """
    from rich.console import Console

    from servoloop.demo import report as reports
    from servoloop.demo.cell import check_grades
    from servoloop.demo.demo import demo as run
    from servoloop.demo.live import Live
    from sim_backend.mechanics.build import Build

    jobs = [grade for grade in grades.split(",") if grade.strip()]
    if not jobs:
        raise DriverError(f"--grades takes grades such as A,B,C, not {grades!r}")
    if record is not None:
        check_path(record)
    chosen = find_arm(arm)
    check_grades(jobs, chosen)
    require_ros()
    if view:
        require_view()
    make_folder(out)
    console = Console()
    with Live(console) as live:
        report = run(jobs, repeat, out, chosen, robot, Build(backlash_deg, seed), live, record, view)
    reports.print_table(report, console)
    reports.write_json(report, out / "result.json")
    raise typer.Exit(0 if reports.succeeded(report) else 1)
