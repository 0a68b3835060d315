"""Report page of ``servoloop bench arm``: HTML with SVG plots that works offline and without scripts."""

from collections.abc import Iterator, Sequence
from dataclasses import fields

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from servoloop.bench.arm import Measured
from servoloop.bench.figures import Distribution
from servoloop.bench.motion import BenchTrial
from servoloop.plots import PALETTE, Curve, Panel, histogram, time_series

BINS = 60
NAMES = ("p50 (ms)", "p99 (ms)", "largest (ms)")


def page(measured: Measured) -> str:
    """Return the report page as HTML."""
    environment = Environment(
        loader=PackageLoader("servoloop.bench", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    pictures = {heading: list(drawn) for heading, drawn in _pictures(measured)}
    return environment.get_template("page.html.j2").render(
        figures=measured.figures, spread=_spread_text, names=NAMES, pictures=pictures
    )


def _spread_text(spread: Distribution | None) -> list[str]:
    """Return the table cells for a distribution."""
    return ["", "", ""] if spread is None else [f"{getattr(spread, one.name):.3f}" for one in fields(Distribution)]


def _pictures(measured: Measured) -> Iterator[tuple[str, list[str]]]:
    """Yield the plots of each section, with the section's name in the template."""
    buses = {f"cycle time of bus {name} (ms)".replace(" of bus  (", " ("): run for name, run in measured.buses.items()}
    yield "buses", [_histogram(run.took_s, axis, "cycles") for axis, run in buses.items()]
    yield "without ROS", _loop("without ROS", measured.trial.late_s, measured.trial.took_s)
    if (ros := measured.ros) is not None:
        yield "under ROS", _loop("under ROS", ros.late_s, ros.took_s)
        motions = _histogram(ros.motions_s, "time from the goal to the first motion (ms)", "goals")
        yield "ros", [motions, _histogram(ros.ages_s, "age of /joint_states on arrival (ms)", "messages")]
    yield "motions", [_motions(measured.trial)]


def _loop(where: str, late_s: Sequence[float], took_s: Sequence[float]) -> list[str]:
    return [
        _histogram(late_s, f"delay of the cycle, {where} (ms)", "cycles"),
        _histogram(took_s, f"duration of the cycle, {where} (ms)", "cycles"),
    ]


def _histogram(times_s: Sequence[float], axis: str, unit: str) -> str:
    """Return a histogram of times in ms as SVG, or an empty string if there are no times."""
    if not len(times_s):
        return ""
    counts, edges = np.histogram(1e3 * np.asarray(times_s), BINS)
    return histogram(edges.tolist(), {"": counts.tolist()}, PALETTE[:1], axis, unit)


def _motions(trial: BenchTrial) -> str:
    times = np.array(trial.time_s)
    reference, position = np.array(trial.reference), np.array(trial.position)
    panels = [
        Panel(
            "position (rad, m)\ndashed: reference",
            (*_curves(trial.joints, position), *_curves(trial.joints, reference, dashed=True)),
        ),
        Panel("reference − position", tuple(_curves(trial.joints, reference - position))),
    ]
    return time_series((times - times[0]).tolist(), panels)


def _curves(joints: Sequence[str], values: np.ndarray, dashed: bool = False) -> Iterator[Curve]:
    return (Curve(joint, values[:, place].tolist(), dashed) for place, joint in enumerate(joints))
