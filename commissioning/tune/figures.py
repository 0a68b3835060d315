"""Compute a joint's performance figures, such as overshoot and delay, from its measured step responses and sine motion.

All functions are pure. Positions are in rad or m, times in seconds.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from hal.types import FloatArray

SETTLED_S: Final = 0.6
"""Duration of the last part of a rest, in which the joint is either still or oscillating, in seconds."""
BAND_SHARE: Final = 0.02
"""Maximum distance of a settled joint from its position at rest, as a fraction of the step."""
BAND_COUNTS: Final = 2.0
"""Maximum distance of a settled joint from its position at rest, in counts. The larger of the two limits applies."""
SHAKES_COUNTS: Final = 4.0
"""Maximum oscillation at rest, in counts. Encoder steps and a dead zone of one count alone cause less oscillation than
this."""
ARRIVED: Final = 1e-9


@dataclass(frozen=True, slots=True)
class TuneTrace:
    """Time, command and measured position in each cycle, each of shape (n,)."""

    time_s: FloatArray
    command: FloatArray
    position: FloatArray

    @classmethod
    def of(cls, rows: Sequence[tuple[float, float, float]]) -> "TuneTrace":
        """Return a trace from rows of time, command and position. The time of the first row is 0."""
        time_s, command, position = (np.array(column) for column in zip(*rows, strict=True))
        return cls(time_s - time_s[0], command, position)


def rest_error(trace: TuneTrace) -> float:
    """Return the command minus the position at the end of a motion, averaged over ``SETTLED_S``."""
    settled = trace.time_s >= trace.time_s[-1] - SETTLED_S
    return float((trace.command - trace.position)[settled].mean())


@dataclass(frozen=True, slots=True)
class Response:
    """Response to one step, starting when the command reaches its target."""

    overshoot: float
    """Largest overshoot beyond the position at rest."""
    settling_s: float | None
    """Settling time; None if the joint does not settle."""
    rest_error: float
    """The command minus the position at rest."""
    swing: float
    """Difference between the highest and the lowest position at rest."""
    swing_hz: float


def response(trace: TuneTrace, count: float) -> Response:
    """Return the response to one step. ``count`` is the size of an encoder count, in rad or m."""
    target, way = trace.command[-1], np.sign(trace.command[-1] - trace.command[0])
    stands = int(np.argmax(np.abs(trace.command - target) < ARRIVED))
    time_s, position = trace.time_s[stands:] - trace.time_s[stands], trace.position[stands:]
    settled = time_s >= time_s[-1] - SETTLED_S
    rest = float(position[settled].mean())
    step = float(abs(target - trace.command[0]))
    off = np.flatnonzero(np.abs(position - rest) > max(BAND_COUNTS * count, BAND_SHARE * step))
    first = int(off[-1]) + 1 if len(off) else 0  # First sample after which the joint stays within the band.
    return Response(
        overshoot=max(float((way * (position - rest)).max()), 0.0),
        settling_s=float(time_s[first]) if first < len(time_s) and not settled[max(first - 1, 0)] else None,
        rest_error=float(target) - rest,
        swing=float(np.ptp(position[settled])),
        swing_hz=_crossings_hz(time_s[settled], position[settled] - rest),
    )


def _crossings_hz(time_s: FloatArray, error: FloatArray) -> float:
    """Return the frequency of the error from its zero crossings."""
    sides = np.sign(error[error != 0.0])
    seconds = float(time_s[-1] - time_s[0])
    return sum(a != b for a, b in pairwise(sides)) / 2.0 / seconds if seconds > 0.0 else 0.0


@dataclass(frozen=True, slots=True)
class Following:
    """Accuracy with which a joint has followed a sine."""

    delay_s: float
    """Delay between the command and the measured position."""
    gain: float
    """Measured amplitude, as a fraction of the commanded amplitude."""
    largest: float
    """Largest following error (command minus position), including sag."""
    rms: float
    """Root mean square of the following error."""


def following(trace: TuneTrace, hz: float) -> Following:
    """Return the accuracy for a sine of this frequency, from a least-squares fit over whole periods."""
    error = trace.command - trace.position
    (wanted, phase), (done, later) = (_wave(trace.time_s, curve, hz) for curve in (trace.command, trace.position))
    turn = 2.0 * np.pi
    behind = (phase - later + np.pi) % turn - np.pi
    return Following(
        delay_s=float(behind / (turn * hz)),
        gain=done / wanted,
        largest=float(np.abs(error).max()),
        rms=float(np.sqrt((error**2).mean())),
    )


def _wave(time_s: FloatArray, curve: FloatArray, hz: float) -> tuple[float, float]:
    """Return the amplitude and phase of the sine that best fits the curve. The curve may have an offset."""
    angle = 2.0 * np.pi * hz * time_s
    columns = np.column_stack([np.sin(angle), np.cos(angle), np.ones_like(angle)])
    (sine, cosine, _), *_ = np.linalg.lstsq(columns, curve)
    return float(np.hypot(sine, cosine)), float(np.arctan2(cosine, sine))


@dataclass(frozen=True, slots=True)
class JointFigures:
    """Performance figures of one joint with one set of gains. Positions are in rad or m, times in seconds."""

    overshoot: float
    """Mean overshoot of all steps."""
    settling_s: float | None
    """Settling time of the slowest step; None if a step does not settle."""
    sag: float
    """Error at rest caused by load: the mean of the errors at one position, approached from both sides."""
    stick: float
    """Error at rest caused by friction and dead zone: half the difference of the errors from the two sides."""
    rest_error: float
    """Largest error at rest."""
    delay_s: float
    following_largest: float
    following_rms: float
    swing: float
    """Largest oscillation at rest."""
    swing_hz: float
    shakes: bool


def figures(
    steps: Sequence[TuneTrace], sine: TuneTrace, hz: float, count: float, half_way: tuple[float, float]
) -> JointFigures:
    """Return the performance figures of a joint.

    Args:
        steps: Step responses in both directions.
        sine: The sine.
        hz: Frequency of the sine, in Hz.
        count: Size of an encoder count, in rad or m.
        half_way: Command minus position at rest, at one position approached from each side.
    """
    answers = [response(step, count) for step in steps]
    wave = following(sine, hz)
    slowest = [one.settling_s for one in answers]
    widest = max(answers, key=lambda one: one.swing)
    return JointFigures(
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
