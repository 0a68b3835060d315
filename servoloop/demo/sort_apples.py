"""Run the demo that sorts apples in a new cell, and draw what the camera saw."""

from servoloop.demo.camera_recording import CameraRecording
from servoloop.demo.cell import cell
from servoloop.demo.cell_options import CellOptions
from servoloop.demo.demo import FIGURES_S, loop_figures
from servoloop.demo.jobs import Live
from servoloop.demo.sorting import Sorter
from servoloop.demo.sorting_report import SortingReport, save_pictures
from sim_backend.camera.scene_camera import SceneCamera


def sort_apples(options: CellOptions, live: Live, count: int) -> SortingReport:
    """Sort ``count`` apples in a new cell, graded from the virtual camera's images, and draw the results.

    Raises:
        ArmFileError: The scene does not contain a camera or apples.
        DriverError: A process failed. The message contains the last output of the process.
        Interrupted: The user interrupted the demo.
    """
    from nodes.clients.camera_pictures import PICTURES

    camera = SceneCamera(options.found().scene)
    if options.record is None:
        return _sorted(options, live, count, camera, None)
    with CameraRecording(options.record, f"/{PICTURES}") as pictures:
        return _sorted(options, live, count, camera, pictures)


def _sorted(
    options: CellOptions, live: Live, count: int, camera: SceneCamera, pictures: CameraRecording | None
) -> SortingReport:
    with cell(options, live) as ready:
        assert ready.sorting is not None
        if pictures is not None:
            ready.sorting.receive_pictures(pictures.add)
        sorter = Sorter(ready, ready.sorting, camera, live)
        apples = tuple(sorter.run(count))
        ready.runner.idle(FIGURES_S)
        report = SortingReport(apples, count, loop_figures(ready.monitor))
    save_pictures(options.out, options.found().scene, apples, sorter.film)
    return report
