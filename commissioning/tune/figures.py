"""Figures of a measurement: what its steps and its sine show of the joint. Pure; rad or m, seconds."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from hal.types import FloatArray

SETTLED_S: Final = 0.6
"""The end of a rest, by which a joint has come to stand, or swings."""
BAND_SHARE: Final = 0.02
"""Of the step: a joint has settled once it stays so near to where it comes to rest,"""
BAND_COUNTS: Final = 2.0
"""or this."""
SHAKES_COUNTS: Final = 4.0
"""Between the outermost positions at rest: more than a dead zone of one count and the encoder's steps leave."""
ARRIVED: Final = 1e-9


@dataclass(frozen=True, slots=True)
class Trace:
    """Cycle by cycle, (n,): when the joint was asked, what it was commanded to be then, where it was."""

    time_s: FloatArray
    command: FloatArray
    position: FloatArray

    @classmethod
    def of(cls, rows: Sequence[tuple[float, float, float]]) -> "Trace":
        """Of rows of time, command and position; the time counts from the first."""
        time_s, command, position = (np.array(column) for column in zip(*rows, strict=True))
        return cls(time_s - time_s[0], command, position)


def rest_error(trace: Trace) -> float:
    """Command less position at the end of a motion, the mean over ``SETTLED_S``."""
    settled = trace.time_s >= trace.time_s[-1] - SETTLED_S
    return float((trace.command - trace.position)[settled].mean())


@dataclass(frozen=True, slots=True)
class Response:
    """How one step was answered. All counts from when the command stood, behind the gate."""

    overshoot: float
    """How far it went beyond the place where it came to rest."""
    settling_s: float | None
    """None: it does not settle."""
    rest_error: float
    """Command less position at rest."""
    swing: float
    """Between the outermost positions at rest."""
    swing_hz: float


def response(trace: Trace, count: float) -> Response:
    """The figures of one step; ``count``: one of the encoder's, rad or m."""
    target, way = trace.command[-1], np.sign(trace.command[-1] - trace.command[0])
    stands = int(np.argmax(np.abs(trace.command - target) < ARRIVED))
    time_s, position = trace.time_s[stands:] - trace.time_s[stands], trace.position[stands:]
    settled = time_s >= time_s[-1] - SETTLED_S
    rest = float(position[settled].mean())
    step = float(abs(target - trace.command[0]))
    off = np.flatnonzero(np.abs(position - rest) > max(BAND_COUNTS * count, BAND_SHARE * step))
    first = int(off[-1]) + 1 if len(off) else 0  # of those that stay
    return Response(
        overshoot=max(float((way * (position - rest)).max()), 0.0),
        settling_s=float(time_s[first]) if first < len(time_s) and not settled[max(first - 1, 0)] else None,
        rest_error=float(target) - rest,
        swing=float(np.ptp(position[settled])),
        swing_hz=_crossings_hz(time_s[settled], position[settled] - rest),
    )


def _crossings_hz(time_s: FloatArray, error: FloatArray) -> float:
    """Half the zero crossings, per second."""
    sides = np.sign(error[error != 0.0])
    seconds = float(time_s[-1] - time_s[0])
    return sum(a != b for a, b in pairwise(sides)) / 2.0 / seconds if seconds > 0.0 else 0.0


@dataclass(frozen=True, slots=True)
class Following:
    """How a sine was followed."""

    delay_s: float
    """The measured behind the commanded."""
    gain: float
    """The measured amplitude, as a share of the commanded one."""
    largest: float
    """Of the errors, command less position; what it sags is in it."""
    rms: float


def following(trace: Trace, hz: float) -> Following:
    """The figures of a sine of this frequency: both curves' phase by least squares, over whole periods."""
    error = trace.command - trace.position
    (told, phase), (done, later) = (_wave(trace.time_s, curve, hz) for curve in (trace.command, trace.position))
    turn = 2.0 * np.pi
    behind = (phase - later + np.pi) % turn - np.pi
    return Following(
        delay_s=float(behind / (turn * hz)),
        gain=done / told,
        largest=float(np.abs(error).max()),
        rms=float(np.sqrt((error**2).mean())),
    )


def _wave(time_s: FloatArray, curve: FloatArray, hz: float) -> tuple[float, float]:
    """Amplitude and phase of the sine that is nearest to the curve, which may have a mean."""
    angle = 2.0 * np.pi * hz * time_s
    columns = np.column_stack([np.sin(angle), np.cos(angle), np.ones_like(angle)])
    (sine, cosine, _), *_ = np.linalg.lstsq(columns, curve)
    return float(np.hypot(sine, cosine)), float(np.arctan2(cosine, sine))


@dataclass(frozen=True, slots=True)
class Figures:
    """The figures of one joint with one set of gains. rad or m, seconds."""

    overshoot: float
    """The mean of all steps'."""
    settling_s: float | None
    """Of the slowest step; None where one does not settle."""
    sag: float
    """Command less position at rest half-way, the mean of coming from either side: what load does."""
    stick: float
    """By so much it differs to either side of that: what friction and dead zone leave."""
    rest_error: float
    """The largest at rest."""
    delay_s: float
    following_largest: float
    following_rms: float
    swing: float
    """At rest, the largest."""
    swing_hz: float
    shakes: bool


def figures(steps: Sequence[Trace], sine: Trace, hz: float, count: float, half_way: tuple[float, float]) -> Figures:
    """The figures of steps in both directions and a sine; ``count``: one of the encoder's, rad or m.

    ``half_way``: command less position at rest at one place, to which the joint came from either side.
    """
    answers = [response(step, count) for step in steps]
    wave = following(sine, hz)
    slowest = [one.settling_s for one in answers]
    widest = max(answers, key=lambda one: one.swing)
    return Figures(
        overshoot=float(np.mean([one.overshoot for one in answers])),
        settling_s=None if None in slowest else max(time_s for time_s in slowest if time_s is not None),
        sag=0.5 * sum(half_way),
        stick=0.5 * abs(half_way[0] - half_way[1]),
        rest_error=max(abs(one.rest_error) for one in answers),
        delay_s=wave.delay_s,
        following_largest=wave.largest,
        following_rms=wave.rms,
        swing=widest.swing,
        swing_hz=widest.swing_hz,
        shakes=widest.swing > SHAKES_COUNTS * count,
    )
