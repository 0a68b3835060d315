"""Grade virtual apples in varied light: ``python -m benchmarks.grading [--apples 600] [--seed 0]``.

Each image shows up to five apples. In a third of the images, apples may touch. Illuminance, color temperature and
direction of the lamp, shadows and noise differ from image to image.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from rich.console import Console
from rich.table import Table as Grid

from benchmarks.shared.arguments import in_words, positive
from perception.camera_view import CameraPose, CameraView
from perception.grading.grader import GradedApple, Grader
from perception.grading.settings import GradingSettings
from perception.intrinsics import Intrinsics
from sim_backend.camera.light import draw_light
from sim_backend.camera.pinhole import PinholeCamera
from sim_backend.camera.table import GAP_M, AppleTable, draw_tray, render, table_camera
from sim_backend.camera.truth import AppleTruth
from sim_backend.scene.picture import Picture

SAME_M: Final = 0.02
"""Maximum distance between an apple and its result, in meters."""
GRADED_SHARE: Final = 0.75
"""Fraction of an apple that must be visible so that a grade is required. Less visible apples may have any grade."""
MOST_APPLES: Final = 5


@dataclass(slots=True)
class GradingTally:
    """Results for all images."""

    grades: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Number of apples, keyed by true grade and measured grade."""
    errors: list[tuple[float, float, float, float]] = field(default_factory=list)
    """Errors in the diameter (mm), red ratio, defect score and position (mm) of each apple."""
    missed: int = 0
    invented: int = 0
    times_s: list[float] = field(default_factory=list)


def main() -> None:
    """Run the benchmark and exit with status 1 if a requirement is not met."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--apples", type=positive, default=600, help="number of apples")
    parser.add_argument("--seed", type=int, default=0, help="random seed for the first image")
    options = parser.parse_args()
    camera = table_camera()
    grader = Grader(view_of(camera))
    tally = GradingTally()
    with in_words():
        for picture, truth in trays(camera, options.seed, options.apples):
            start_s = time.thread_time()
            found = grader.grade(picture)
            tally.times_s.append(time.thread_time() - start_s)
            compare(found, truth, tally)
    sys.exit(0 if report(tally, Console()) else 1)


def view_of(camera: PinholeCamera) -> CameraView:
    """Return the calibration of a virtual camera above the table."""
    intrinsics = Intrinsics(camera.matrix, np.zeros(5), camera.width, camera.height, "virtual")
    return CameraView(intrinsics, CameraPose(camera.axes, camera.position_m, 0.0, "virtual"))


def trays(camera: PinholeCamera, seed: int, apples: int) -> Iterator[tuple[Picture, list[AppleTruth]]]:
    """Yield images with their ground truth until the images have shown ``apples`` apples."""
    number = seed
    while apples > 0:
        count = min(apples, 3 + number % (MOST_APPLES - 2))
        lying = draw_tray(number, count, 0.0 if number % 3 == 0 else GAP_M)
        yield render(AppleTable(lying), camera, draw_light(number), number)
        number, apples = number + 1, apples - count


def compare(found: Sequence[GradedApple], truth: Sequence[AppleTruth], tally: GradingTally) -> None:
    """Add the results for one image."""
    left = list(found)
    grade_of = GradingSettings().grade_of
    for real in truth:
        place = np.array(real.position_m)
        nearest = min(left, key=lambda one: float(np.linalg.norm(one.position_m - place)), default=None)
        if nearest is None or np.linalg.norm(nearest.position_m - place) > SAME_M:
            tally.missed += real.visible_share >= GRADED_SHARE
            continue
        left.remove(nearest)
        if real.cut or real.visible_share < GRADED_SHARE:
            continue
        tally.grades[grade_of(real.diameter_mm, real.red_ratio, real.defect_score), nearest.grade or "none"] += 1
        tally.errors.append(
            (
                nearest.diameter_mm - real.diameter_mm,
                nearest.red_ratio - real.red_ratio,
                nearest.defect_score - real.defect_score,
                1000.0 * float(np.linalg.norm(nearest.position_m - place)),
            )
        )
    tally.invented += len(left)


def report(tally: GradingTally, console: Console) -> bool:
    """Print the confusion matrix and the statistics. Return whether all requirements are met."""
    names = sorted({name for pair in tally.grades for name in pair})
    grid = Grid("true grade", *names, title="measured grade")
    for true in sorted({pair[0] for pair in tally.grades}):
        grid.add_row(true, *(str(tally.grades[true, name]) for name in names))
    console.print(grid)
    errors = np.array(tally.errors).reshape(-1, 4)
    right = sum(count for (true, name), count in tally.grades.items() if true == name) / max(len(errors), 1)
    rms = np.sqrt((errors**2).mean(axis=0)) if len(errors) else np.full(4, np.inf)
    within = float((np.abs(errors[:, 0]) <= 3.0).mean()) if len(errors) else 0.0
    rows = (
        ("grade right", f"{100.0 * right:.1f} %", "at least 97 %", right >= 0.97),
        ("diameter within 3 mm", f"{100.0 * within:.1f} %", "at least 95 %", within >= 0.95),
        ("diameter, RMS", f"{rms[0]:.2f} mm", "", True),
        ("red_ratio, RMS", f"{rms[1]:.3f}", "", True),
        ("defect_score, RMS", f"{rms[2]:.4f}", "at most 0.03", rms[2] <= 0.03),
        ("position, RMS", f"{rms[3]:.1f} mm", "", True),
        ("missed apples", str(tally.missed), "0", tally.missed == 0),
        ("invented apples", str(tally.invented), "0", tally.invented == 0),
        ("processor time per image", f"{1000.0 * float(np.median(tally.times_s)):.0f} ms", "", True),
    )
    figures = Grid("quantity", "measured", "required", title=f"{len(errors)} apples in {len(tally.times_s)} images")
    for name, value, required, met in rows:
        figures.add_row(name, value, required, style=None if met else "red")
    console.print(figures)
    return all(met for *_, met in rows)


if __name__ == "__main__":
    main()
