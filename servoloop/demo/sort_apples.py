"""Run the demo that sorts apples in a new cell, and draw what the camera saw."""

from servoloop.demo.cell import cell
from servoloop.demo.cell_options import CellOptions
from servoloop.demo.demo import FIGURES_S, loop_figures
from servoloop.demo.jobs import Live
from servoloop.demo.sorting import Sorter
from servoloop.demo.sorting_report import SortingReport, save_pictures


def sort_apples(options: CellOptions, live: Live, count: int) -> SortingReport:
    """Sort ``count`` apples by what the virtual camera sees, in a new cell, and draw pictures of it.

    Raises:
        DriverError: A process failed; the message has its last output.
        Interrupted: The user ended the demo.
    """
    scene = options.found().scene
    with cell(options, live) as ready:
        assert ready.sorting is not None
        sorter = Sorter(ready, ready.sorting, scene, live)
        apples = tuple(sorter.run(count))
        ready.runner.idle(FIGURES_S)
        report = SortingReport(apples, count, loop_figures(ready))
    save_pictures(options.out, scene, apples, sorter.film)
    return report
