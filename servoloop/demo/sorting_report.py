"""Report of a demo that sorts apples: tables, JSON, an image and a film of what the camera saw."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any, Final

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from rich.console import Console
from rich.table import Table
from rich.text import Text

from commissioning.atomic_write import write_file
from servoloop.demo.sorting import SortedApple, SortingFilm
from servoloop.stack.tables import print_table
from sim_backend.camera.scene_camera import SceneCamera
from sim_backend.camera.sensor import Sensor
from sim_backend.scene.picture import Picture, save_gif, save_png

MARK_RGB: Final = (20, 90, 220)
TEXT_PX: Final = 28
FILM_FPS: Final = 6.0
FILM_STEP: Final = 2
"""Factor by which the width and the height of the camera images are reduced for the film."""


@dataclass(frozen=True, slots=True)
class SortingReport:
    """Results of a demo that sorts apples."""

    apples: tuple[SortedApple, ...]
    wanted: int
    """Number of apples to sort."""
    loop: Mapping[str, float]

    @property
    def success(self) -> bool:
        """Whether every apple has the correct grade and is in the bin for that grade."""
        return len(self.apples) == self.wanted and all(apple.success for apple in self.apples)

    @property
    def median_picture_to_goal_s(self) -> float | None:
        """Median time between the camera image and the start of the job, in seconds."""
        times = [apple.job.picture_to_goal_s for apple in self.apples if apple.job is not None]
        known = [time_s for time_s in times if time_s is not None]
        return median(known) if known else None


def print_sorting(report: SortingReport, console: Console) -> None:
    """Print the report as a table."""
    columns = ("", "true", "seen", "bin", "mm", "error", "red", "error", "spots", "error", "ms")
    table = Table(*columns, title="apples")
    for column in (table.columns[0], *table.columns[4:]):
        column.justify = "right"
    for apple in report.apples:
        table.add_row(*_cells(apple))
    print_table(console, table)
    console.print(
        "The table shows the true grade and the grade that the camera saw. The camera measures the diameter, the "
        "red fraction and the spot fraction, each shown with its error. The last column is the time from the camera "
        "image to the start of the job."
    )
    delay_s, missed = report.median_picture_to_goal_s, report.loop["missed_cycles"]
    console.print(
        f"apples in the right bins: {sum(apple.success for apple in report.apples)} of {report.wanted}; "
        f"image to goal: {'unknown' if delay_s is None else f'{1e3 * delay_s:.0f} ms'} (median); "
        f"missed cycles: {missed:.0f}"
    )


def _cells(apple: SortedApple) -> tuple[str | Text, ...]:
    truth, job = apple.truth, apple.job
    place = Text(apple.bin or "none", "green" if apple.success else "red")
    head = (str(apple.number), apple.true_grade, job.grade if job else "none", place)
    seen = job.apple if job else None
    if job is None or seen is None:
        return (*head, *("?" for _ in range(7)))
    delay_s = job.picture_to_goal_s
    return (
        *head,
        f"{seen.diameter_mm:.1f}",
        f"{seen.diameter_mm - truth.diameter_mm:+.1f}",
        f"{seen.red_ratio:.2f}",
        f"{seen.red_ratio - truth.red_ratio:+.2f}",
        f"{seen.defect_score:.3f}",
        f"{seen.defect_score - truth.defect_score:+.3f}",
        "?" if delay_s is None else f"{1e3 * delay_s:.0f}",
    )


def write_sorting(report: SortingReport, path: Path) -> None:
    """Write the report as JSON. Raises DriverError if the file cannot be written."""
    delay_s = report.median_picture_to_goal_s
    content = {
        "success": report.success,
        "apples": {"in_the_right_bins": sum(apple.success for apple in report.apples), "of": report.wanted},
        "median_picture_to_goal_s": None if delay_s is None else round(delay_s, 4),
        "loop": dict(report.loop),
        "sorted": [_content(apple) for apple in report.apples],
    }
    write_file(path, json.dumps(content, indent=2, allow_nan=False) + "\n", keep=False)


def _content(apple: SortedApple) -> dict[str, Any]:
    job, truth = apple.job, apple.truth
    seen = job.apple if job else None
    return {
        "number": apple.number,
        "success": apple.success,
        "bin": apple.bin,
        "true": {"grade": apple.true_grade, **_values(truth)},
        "seen": None if seen is None else {"grade": seen.grade, **_values(seen)},
        "picture_to_goal_s": None if job is None else job.picture_to_goal_s,
        "message": job.message if job else "",
    }


def _values(apple: Any) -> dict[str, float]:
    return {name: round(getattr(apple, name), 4) for name in ("diameter_mm", "red_ratio", "defect_score")}


def save_pictures(folder: Path, scene: Path, apples: Sequence[SortedApple], film: SortingFilm) -> None:
    """Draw ``apple.png`` with the first apple and its values, and ``sorting.gif`` with the camera's view of the arm."""
    if film.first is None or not apples:
        return
    camera = SceneCamera(scene, sensor=Sensor(noisy=False))  # Noise would make the film much larger.
    camera.see(film.first)
    seen = apples[0].job.apple if apples[0].job else None
    text = "no grade"
    if seen is not None:
        text = f"{seen.grade}  {seen.diameter_mm:.1f} mm  red {seen.red_ratio:.2f}  defects {seen.defect_score:.3f}"
    save_png(folder / "apple.png", _marked(camera.picture(), apples[0].truth.box_px, text))
    frames = []
    for publication, grade in film.frames:
        camera.see(publication)
        picture = camera.picture()
        truth = camera.truth()
        box = truth.box_px if truth is not None and grade else None
        frames.append(_marked(picture, box, f"grade {grade}" if grade else "")[::FILM_STEP, ::FILM_STEP])
    save_gif(folder / "sorting.gif", frames, FILM_FPS)


def _marked(picture: Picture, box: tuple[int, int, int, int] | None, text: str) -> Picture:
    """Draw a frame around an apple and text in the corner of the image."""
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    if box is not None:
        left, top, right, bottom = box
        draw.rectangle((left - 3, top - 3, right + 3, bottom + 3), outline=MARK_RGB, width=3)
    draw.text((10, 8), text, fill=MARK_RGB, font=ImageFont.load_default(TEXT_PX))
    return np.asarray(image)
