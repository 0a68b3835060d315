"""Render a recording as an HTML page with SVG plots. The page needs neither scripts nor network access."""

from math import ceil
from pathlib import Path
from typing import Final

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from commissioning.atomic_write import write_file
from drivers.printable import printable_line
from hal.types import FloatArray
from servoloop.plots import Curve, Panel, Stretch, time_series
from servoloop.recording.reader import RecordedRun

MOST: Final = 3000
"""Maximum number of cycles in a plot. Plots of longer runs show every n-th cycle."""


def page(run: RecordedRun, name: str) -> str:
    """Return the HTML page of a run."""
    environment = Environment(
        loader=PackageLoader("servoloop.recording", "."), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    step = ceil(len(run.time_s) / MOST)
    return environment.get_template("page.html.j2").render(
        name=printable_line(name), run=run, step=step, error_rad=_largest_errors(run), plots=_plots(run, step)
    )


def write_page(path: Path, run: RecordedRun, name: str) -> None:
    """Write the HTML page of a run to the file ``path``. Raises DriverError."""
    write_file(path, page(run, name), keep=False)


def _largest_errors(run: RecordedRun) -> list[tuple[str, float]]:
    """Return the largest difference between command and position for each joint."""
    error = np.abs(run.command - run.position)
    largest = [float(column[~np.isnan(column)].max(initial=0.0)) for column in error.T]
    return list(zip(run.joints, largest, strict=True))


def _plots(run: RecordedRun, step: int) -> list[tuple[str, str]]:
    """Return the heading and the SVG of each plot."""
    stretches = [Stretch(*fault) for fault in run.faults]

    def curves(values: FloatArray, dashed: bool = False) -> tuple[Curve, ...]:
        return tuple(
            Curve(joint, values[::step, place].tolist(), dashed)
            for place, joint in enumerate(run.joints)
            if not np.isnan(values[:, place]).all()
        )

    motion = [
        Panel("position (rad, m)\ndashed: command", (*curves(run.position), *curves(run.command, dashed=True))),
        Panel("command − position", curves(run.command - run.position)),
        Panel("velocity (1/s)", curves(run.velocity)),
        Panel("effort (N m, N)", curves(run.effort)),
    ]
    found = [("Joints", time_series(run.time_s[::step].tolist(), motion, stretches))]
    if len(run.cycle_s):
        timing = [
            Panel("ms", (Curve("late", (1e3 * run.late_s[::step]).tolist()),)),
            Panel("ms", (Curve("busy", (1e3 * run.busy_s[::step]).tolist()),)),
        ]
        found.append(("Control loop", time_series(run.cycle_s[::step].tolist(), timing, stretches)))
    return found
