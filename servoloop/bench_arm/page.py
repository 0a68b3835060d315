"""The bench of an arm as one page with pictures: SVG without scripts, which opens without a network."""

from collections.abc import Iterator, Sequence
from dataclasses import fields

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from servoloop.bench_arm.figures import Spread
from servoloop.bench_arm.run import Measured
from servoloop.bench_arm.trial import Trial
from servoloop.plots.bars import histogram
from servoloop.plots.series import Curve, Panel, time_series
from servoloop.plots.svg import PALETTE

BINS = 60


def page(measured: Measured) -> str:
    """The page in HTML."""
    environment = Environment(
        loader=PackageLoader("servoloop.bench_arm", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    pictures = {heading: list(drawn) for heading, drawn in _pictures(measured)}
    return environment.get_template("page.html.j2").render(
        figures=measured.figures, spread=_spread_text, names=[one.name for one in fields(Spread)], pictures=pictures
    )


def _spread_text(spread: Spread | None) -> list[str]:
    """The cells of a spread."""
    return ["", "", ""] if spread is None else [f"{getattr(spread, one.name):.3f}" for one in fields(Spread)]


def _pictures(measured: Measured) -> Iterator[tuple[str, list[str]]]:
    yield (
        "buses",
        [
            _histogram(
                {f"bus {name}".rstrip(): run.took_s for name, run in measured.buses.items()}, "ms a cycle", "cycles"
            )
        ],
    )
    runs: dict[str, tuple[Sequence[float], Sequence[float]]] = {}
    runs["without ROS"] = measured.trial.late_s, measured.trial.took_s
    if measured.ros is not None:
        runs["under ROS"] = measured.ros.late_s, measured.ros.took_s
        yield (
            "ros",
            [
                _histogram({"": measured.ros.motions_s}, "ms from the goal to the first motion", "goals"),
                _histogram({"": measured.ros.ages_s}, "ms of age of /joint_states when they come", "messages"),
            ],
        )
    yield (
        "loop",
        [
            _histogram({name: run[0] for name, run in runs.items()}, "ms late", "cycles"),
            _histogram({name: run[1] for name, run in runs.items()}, "ms busy", "cycles"),
        ],
    )
    yield "motions", [_motions(measured.trial)]


def _histogram(series: dict[str, Sequence[float]], axis: str, unit: str) -> str:
    """How often which time (s) came, in ms; empty where there is none."""
    in_ms = {name: 1e3 * np.asarray(values) for name, values in series.items() if len(values)}
    if not in_ms:
        return ""
    everything = np.concatenate(list(in_ms.values()))
    edges = np.histogram_bin_edges(everything, BINS)
    counts = {name: np.histogram(values, edges)[0].tolist() for name, values in in_ms.items()}
    return histogram(edges.tolist(), counts, PALETTE[: len(counts)], axis, unit)


def _motions(trial: Trial) -> str:
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
