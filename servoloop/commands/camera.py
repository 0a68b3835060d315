"""``servoloop camera``: list, show and calibrate cameras, and print the calibration board."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from commissioning.atomic_write import cannot_write, require_output, write_whole
from servoloop.commands.shared.console import JsonOption, print_json, text_console
from servoloop.commands.shared.option_groups import grouped_options
from servoloop.extras import require_extras
from servoloop.stack.tables import print_table

if TYPE_CHECKING:
    from perception.calibration.board import Board, BoardView
    from perception.calibration.plane import BoardPlace
    from perception.frames import CameraSource, Frame, Picture

READ_S: Final = 2.0
"""Maximum time to wait for a frame, in seconds."""
PICTURES: Final = (".png", ".jpg", ".jpeg")
"""Suffixes of the files that `camera show` can write."""
YAML: Final = (".yaml", ".yml")
app = typer.Typer(no_args_is_help=True, help="List, show and calibrate cameras.")
Source = Annotated[
    str, typer.Argument(help="Path in /dev/v4l/by-id, camera index, video, image, or image folder.", metavar="SOURCE")
]


@dataclass(frozen=True, slots=True)
class CameraFormat:
    """Image size and frame rate to request from a camera."""

    width: Annotated[int, typer.Option(min=16, max=16384, help="Width of the images, in pixels.")] = 640
    height: Annotated[int, typer.Option(min=16, max=16384, help="Height of the images, in pixels.")] = 480
    rate: Annotated[float, typer.Option(min=0.1, max=240.0, help="Rate to request, in Hz.")] = 30.0

    @contextmanager
    def opened(self, source: str) -> "Iterator[CameraSource]":
        """Open a source, and close it when the block ends. Raises CameraError."""
        require_extras("the camera", "vision")
        from drivers.clock import MonotonicClock
        from perception.sources.choice import source_of
        from perception.sources.native_log import silence_native_log

        silence_native_log()
        camera = source_of(source, MonotonicClock(), (self.width, self.height), self.rate)
        try:
            camera.open()
            yield camera
        finally:
            camera.close()


@dataclass(frozen=True, slots=True)
class BoardSize:
    """Size of the board."""

    columns: Annotated[int, typer.Option(min=4, max=14, help="Number of squares along the upper edge.")] = 9
    rows: Annotated[int, typer.Option(min=4, max=10, help="Number of squares along the left edge.")] = 6
    square: Annotated[
        float, typer.Option(min=5.0, max=200.0, help="Side length of a square in mm, as measured on the print.")
    ] = 30.0

    def board(self) -> "Board":
        """Return the board."""
        from perception.calibration.board import Board

        return Board(self.columns, self.rows, self.square / 1000.0)


@dataclass(frozen=True, slots=True)
class BoardOnTable:
    """Pose of the board on the table."""

    x: Annotated[float, typer.Option(help="x coordinate of the board's top left corner in base_link, in m.")]
    y: Annotated[float, typer.Option(help="y coordinate of the board's top left corner in base_link, in m.")]
    yaw: Annotated[float, typer.Option(help="Direction of the upper edge in degrees: 0 along x, 90 along y.")] = -90.0
    z: Annotated[float, typer.Option(help="z coordinate of the board in base_link, in m.")] = 0.0

    def place(self) -> "BoardPlace":
        """Return the pose of the board."""
        from perception.calibration.plane import BoardPlace

        return BoardPlace(self.x, self.y, radians(self.yaw), self.z)


@dataclass(frozen=True, slots=True)
class Effort:
    """Number of views to capture, and the maximum time for capturing them."""

    views: Annotated[int, typer.Option(min=8, max=100, help="Number of views to take.")] = 15
    timeout: Annotated[float, typer.Option(min=1.0, max=3600.0, help="Maximum time, in seconds.")] = 180.0


@app.command("list")
def list_cameras(json: JsonOption = False) -> None:
    """List the cameras on this machine and the programs that use them.

    The command does not open any camera. Example: `servoloop camera list`
    """
    from rich.table import Table

    from perception.sources.devices import cameras

    found = cameras()
    if json:
        print_json(found)
        return
    if not found:
        typer.echo("No camera is plugged in.")
        return
    table = Table("camera", "name", "access", "in use by")
    for camera in found:
        table.add_row(
            camera.by_id or camera.device,
            camera.name,
            "yours" if camera.may_open else "not yours",
            ", ".join(camera.owners),
        )
    print_table(text_console(), table, "name")


@app.command()
@grouped_options
def show(
    source: Source,
    form: CameraFormat,
    out: Annotated[Path, typer.Option(help="Image file to write, PNG or JPEG.")] = Path("camera.png"),
    seconds: Annotated[float, typer.Option(min=0.1, max=60.0, help="Duration of the measurement, in s.")] = 3.0,
) -> None:
    """Save an image from a camera, and measure the camera's actual frame rate.

    Example: `servoloop camera show 0 --out camera.png`
    """
    from perception.perception_errors import SourceEnded

    require_output(out, Path(source), *PICTURES)
    with form.opened(source) as camera:
        first = last = camera.read(READ_S)
        count = 1
        while last.stamp_s - first.stamp_s < seconds:
            try:
                last = camera.read(READ_S)
            except SourceEnded:
                break
            count += 1
        _save_picture(out, last.rgb)
        lost = last.number - first.number + 1 - count
        width, height = last.size
        typer.echo(
            f"{camera.name}: {width} × {height} pixels, {camera.rate_hz:.1f} Hz, {lost} frames lost; saved {out}"
        )


@app.command()
@grouped_options
def board(
    out: Annotated[Path, typer.Argument(help="File to write, PDF or PNG.")],
    size: BoardSize,
) -> None:
    """Write the printable calibration board.

    Print the board at 100 %, glue it to a flat plate, and measure one of its squares. Example: `servoloop camera board
    board.pdf`
    """
    require_extras("the board", "vision")
    from perception.calibration.board import board_pdf, board_picture
    from perception.perception_errors import CalibrationRefused

    ending = out.suffix.lower()
    if ending == ".pdf":
        _save(out, board_pdf(size.board()))
    elif ending == ".png":
        _save(out, _encoded(board_picture(size.board()), ".png"))
    else:
        raise CalibrationRefused(f"{out} ends neither with .pdf nor with .png: choose one of these formats")
    typer.echo(f"saved {out}: {size.columns} × {size.rows} squares of {size.square:g} mm")


@app.command()
@grouped_options
def calibrate(
    source: Source,
    form: CameraFormat,
    size: BoardSize,
    effort: Effort,
    out: Annotated[Path, typer.Option(help="Intrinsics file to write.")] = Path("camera.yaml"),
    name: Annotated[str, typer.Option(help="Name of the camera in the file.")] = "camera",
) -> None:
    """Calibrate a camera lens with views of the board.

    Show the board in all parts of the image and tilted in all directions. Hold the board still for a moment in each
    pose. Example: `servoloop camera calibrate 0 --square 30`
    """
    from perception.calibration.lens import calibrate_lens
    from perception.intrinsics import intrinsics_text

    require_output(out, Path(source), *YAML)
    with form.opened(source) as camera:
        collected = _collect(camera, size.board(), effort)
    report = calibrate_lens(collected, name)
    focal = report.intrinsics.matrix[0, 0], report.intrinsics.matrix[1, 1]
    _save(out, intrinsics_text(report.intrinsics).encode(), keep=True)
    typer.echo(
        f"{len(collected)} views: focal lengths {focal[0]:.1f} and {focal[1]:.1f} pixels, reprojection error "
        f"{report.error_px:.2f} pixels (worst view {max(report.view_errors_px):.2f}), "
        f"{100 * report.covered:.0f} % of the image covered; saved {out}"
    )


@app.command()
@grouped_options
def plane(
    source: Source,
    size: BoardSize,
    place: BoardOnTable,
    camera_file: Annotated[Path, typer.Option("--camera", help="Intrinsics file to read.")] = Path("camera.yaml"),
    out: Annotated[Path, typer.Option(help="Pose file to write.")] = Path("camera_pose.yaml"),
) -> None:
    """Find the pose of a camera above the table, from one view of the board on the table.

    Example: `servoloop camera plane 0 --x 0.15 --y 0.13`
    """
    from perception.calibration.board import BoardDetector
    from perception.calibration.plane import calibrate_plane
    from perception.camera_view import pose_text
    from perception.intrinsics import read_intrinsics
    from perception.perception_errors import PerceptionError

    require_extras("the camera", "vision")
    if not camera_file.exists():
        raise PerceptionError(
            f"{camera_file} does not exist: measure the intrinsics with 'servoloop camera calibrate', or pass the file "
            "with --camera"
        )
    intrinsics = read_intrinsics(camera_file)
    require_output(out, camera_file, *YAML)
    with CameraFormat(*intrinsics.size).opened(source) as camera:
        view = BoardDetector(size.board()).view(camera.read(READ_S).rgb)
    report = calibrate_plane(view, intrinsics, place.place())
    _save(out, pose_text(report.pose).encode(), keep=True)
    position = ", ".join(f"{value:.3f}" for value in report.pose.position_m)
    typer.echo(
        f"the camera is at ({position}) m in base_link, reprojection error {report.error_px:.2f} pixels; saved {out}"
    )


def _collect(camera: "CameraSource", board: "Board", effort: Effort) -> "list[BoardView]":
    """Return views of the board, either from a camera or from all images of a recording."""
    from perception.calibration.board import BoardDetector
    from perception.calibration.collect import ViewCollector
    from perception.perception_errors import SourceEnded
    from perception.sources.recorded import RecordedSource

    collector = ViewCollector(BoardDetector(board))
    moving = not isinstance(camera, RecordedSource)
    frame: Frame = camera.read(READ_S)
    end_s = frame.stamp_s + effort.timeout
    while len(collector.views) < effort.views:
        if collector.offer(frame.rgb, still=moving):
            typer.echo(f"view {len(collector.views)} of {effort.views}", err=True)
        if frame.stamp_s > end_s:
            break
        try:
            frame = camera.read(READ_S)
        except SourceEnded:
            break
    return collector.views


def _save_picture(path: Path, picture: "Picture") -> None:
    _save(path, _encoded(picture[..., ::-1], path.suffix.lower()))


def _encoded(picture: "Picture", ending: str) -> bytes:
    """Encode a gray or BGR image in the file format selected by the suffix ``ending``."""
    import cv2

    return cv2.imencode(ending, picture)[1].tobytes()


def _save(path: Path, content: bytes, keep: bool = False) -> None:
    from perception.perception_errors import CameraFileError

    try:
        write_whole(path, content, keep)
    except OSError as error:
        raise CameraFileError(f"{cannot_write(path, error)}: choose another file") from error
