"""Compute the timing of a path, within the velocity, acceleration and jerk limits.

The joints follow the path exactly. Along a blend, the speed is constant and low enough to satisfy the limits of all
joints. Along a line, ruckig changes the speed from the speed of one blend to that of the next. The arm stops at corners
without a blend.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from ruckig import ControlInterface, InputParameter, Result, Ruckig, Trajectory

from hal.types import FloatArray, JointLimits
from planning.collision import MARGINS, Collisions, Contact, Margins
from planning.paths.blends import TURN, Corner, blended, distinct
from planning.paths.margins import PathMargins
from planning.planning_errors import PlanningError

PERIOD_S: Final = 0.02
"""Time between two points of a trajectory, in seconds."""
LONGEST_S: Final = 3600.0
"""Maximum duration of a trajectory, in seconds. It limits the memory and the time that the timing needs."""
BISECTIONS: Final = 40
"""Number of steps in the search for the highest speed at the end of a line."""
TURN_CHANGE: Final = 6.0
"""Maximum rate of change of the slope of the curve 3x² - 2x³."""
SAFE: Final = 1.0 - 1e-9
"""Factor that keeps values within the limits despite rounding errors."""


@dataclass(frozen=True, slots=True)
class TimedPath:
    """A trajectory that starts and ends at rest. m is the number of points."""

    times_s: FloatArray
    """Time of each point since the start (m,), in seconds."""
    positions: FloatArray
    """Positions (m, n), in rad or m."""
    velocities: FloatArray
    """Velocities (m, n), in rad/s or m/s."""
    accelerations: FloatArray
    """Accelerations (m, n), in rad/s² or m/s²."""

    @property
    def duration_s(self) -> float:
        """Duration, in seconds."""
        return float(self.times_s[-1])

    def since(self, from_s: float) -> tuple[FloatArray, FloatArray]:
        """Return the times (k,), in seconds, and the positions (k, n) of the part after ``from_s``. k is at least 2."""
        at_s = min(max(from_s, 0.0), self.duration_s)
        first = np.array([np.interp(at_s, self.times_s, column) for column in self.positions.T])
        later = self.times_s > at_s
        if not later.any():
            return np.full(2, at_s), np.array([first, first])
        return np.concatenate(([at_s], self.times_s[later])), np.concatenate([first[None], self.positions[later]])


@dataclass(frozen=True, slots=True)
class Caps:
    """Maximum speed, acceleration and jerk along a line or blend, in rad/s, rad/s² and rad/s³."""

    speed: float
    acceleration: float
    jerk: float


class _Piece(NamedTuple):
    """A line or a blend of a trajectory."""

    start_s: float
    lasts_s: float
    number: int
    """Index of the line or of the corner."""
    ramp: Trajectory | None
    """Motion along the line, or None for a blend."""


def scaled(limits: Sequence[JointLimits], velocity: float = 1.0, acceleration: float = 1.0) -> tuple[JointLimits, ...]:
    """Return limits to which MoveIt's scaling factors are applied. The acceleration factor also applies to the jerk.

    Raises:
        PlanningError: A factor is not above 0 and at most 1.
    """
    for name, factor in (("velocity", velocity), ("acceleration", acceleration)):
        if not 0.0 < factor <= 1.0:
            raise PlanningError(
                "PLANNING_FAILED", f"the {name} scaling factor is {factor}: it must be above 0 and at most 1"
            )
    return tuple(
        replace(
            limit,
            velocity=limit.velocity * velocity,
            acceleration=limit.acceleration * acceleration,
            jerk=limit.jerk * acceleration,
        )
        for limit in limits
    )


def timed(
    path: FloatArray,
    limits: Sequence[JointLimits],
    collisions: Collisions,
    margins: PathMargins | Margins = MARGINS,
) -> TimedPath:
    """Return a trajectory along a path whose edges are free.

    Corners are rounded where a blend is free. The trajectory is checked again, with straight edges between its points
    and the margins that segments of the path satisfy. On a blend, the padding of an edge is increased by the maximum
    distance of the curve, or of a cubic spline through the points, from the edge. Between its points, the trajectory
    therefore also keeps a clearance of the padding minus 1.5 times the tolerance. If this check fails, the arm stops at
    every corner instead.

    Args:
        path: Points (m, n), in rad or m.
        limits: Limits of velocity, acceleration and jerk of the joints (n).
        collisions: Checks of the arm in the scene.
        margins: Padding and tolerance of the path.

    Raises:
        PlanningError: The path itself is in contact, or the motion would take longer than LONGEST_S.
    """
    margins = PathMargins(margins) if isinstance(margins, Margins) else margins
    path = distinct(np.asarray(path, dtype=float))
    if len(path) < 2:
        return TimedPath(np.zeros(1), path, np.zeros_like(path), np.zeros_like(path))
    corners = blended(path, collisions, margins)
    contact: Contact | None = None
    for choice in (corners, tuple(replace(corner, half=0.0) for corner in corners)):
        trajectory, sags = _along(path, choice, limits)
        sags_m = np.array([0.0 if sag is None else collisions.deviation_m(sag) for sag in sags])
        if (contact := margins.for_parts().contact(collisions, list(trajectory.positions), sags_m)) is None:
            return trajectory
    assert contact is not None
    one, other = contact.pair
    raise PlanningError("PLANNING_FAILED", f"the path brings {one} too close to {other}: plan again with more padding")


def _along(
    path: FloatArray, corners: Sequence[Corner], limits: Sequence[JointLimits]
) -> tuple[TimedPath, list[FloatArray | None]]:
    """Return a trajectory along a path whose inner corners are ``corners``. Also return, for each chord between two
    points of the trajectory, the maximum distance of each joint (n,) from the chord, or None for a line."""
    lines, lengths, caps = _lines(path, corners, limits)
    speeds = _speeds(corners, lengths, caps, limits)
    pieces = _pieces(corners, speeds, lengths, caps)
    end_s = pieces[-1].start_s + pieces[-1].lasts_s
    if end_s > LONGEST_S:
        raise PlanningError(
            "PLANNING_FAILED",
            f"the motion would take {end_s:.0f} s, which is longer than {LONGEST_S:.0f} s: increase its speed",
        )
    times_s = np.append(np.arange(0.0, end_s - PERIOD_S / 2.0, PERIOD_S), end_s)
    stops_s = [piece.start_s for piece in pieces if piece.ramp is not None and speeds[piece.number] == 0.0]
    times_s = np.unique(
        np.concatenate((times_s, stops_s))
    )  # every stop is a trajectory point, so that no chord cuts the corner
    indices = np.searchsorted(np.array([piece.start_s for piece in pieces]), times_s, "right") - 1
    rows = []
    for at_s, index in zip(times_s, indices, strict=True):
        ramp, i = pieces[index].ramp, pieces[index].number
        since_s = min(at_s - pieces[index].start_s, pieces[index].lasts_s)
        rows.append(_on_line(ramp, since_s, *lines[i]) if ramp else _on_blend(corners[i], speeds[i + 1], since_s))
    positions, velocities, accelerations = (np.array(column) for column in zip(*rows, strict=True))
    positions[-1], velocities[-1], accelerations[-1] = path[-1], 0.0, 0.0
    sags = [
        _sag(corners, speeds, pieces[first : last + 1], after_s - before_s)
        for (first, last), (before_s, after_s) in zip(
            itertools.pairwise(indices), itertools.pairwise(times_s), strict=True
        )
    ]
    return TimedPath(times_s, positions, velocities, accelerations), sags


def _pieces(
    corners: Sequence[Corner], speeds: Sequence[float], lengths: Sequence[float], caps: Sequence[Caps]
) -> list[_Piece]:
    """Return the lines and blends with their start times and durations."""
    now_s, pieces = 0.0, list[_Piece]()
    for i, (length, cap) in enumerate(zip(lengths, caps, strict=True)):
        ramp = ramp_of(speeds[i], speeds[i + 1], length, cap)
        pieces.append(_Piece(now_s, ramp.duration, i, ramp))
        now_s += ramp.duration
        if i < len(corners) and corners[i].half > 0.0:
            lasts_s = 2.0 * corners[i].half / speeds[i + 1]
            pieces.append(_Piece(now_s, lasts_s, i, None))
            now_s += lasts_s
    return pieces


def _sag(
    corners: Sequence[Corner], speeds: Sequence[float], pieces: Sequence[_Piece], lasts_s: float
) -> FloatArray | None:
    """Return the maximum distance of each joint (n,) from a chord over these segments, or None for a line."""
    blends = [piece.number for piece in pieces if piece.ramp is None]
    if not blends:
        return None
    return np.asarray(np.max([corners[i].sag(speeds[i + 1] * lasts_s) for i in blends], axis=0))


def _on_line(
    ramp: Trajectory, since_s: float, begin: FloatArray, direction: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    along, speed, acceleration = (float(np.ravel(value)[0]) for value in ramp.at_time(since_s))
    return begin + direction * along, direction * speed, direction * acceleration


def _on_blend(corner: Corner, speed: float, since_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    position, direction, curvature = corner.at(speed * since_s)
    return position, direction * speed, curvature * speed**2


def _lines(
    path: FloatArray, corners: Sequence[Corner], limits: Sequence[JointLimits]
) -> tuple[list[tuple[FloatArray, FloatArray]], list[float], list[Caps]]:
    """Return the start, direction, length and speed limits of each line between blends."""
    halves = [0.0, *(corner.half for corner in corners), 0.0]
    lines, lengths, caps = [], [], []
    for i, (start, end) in enumerate(itertools.pairwise(path)):
        length = float(np.linalg.norm(end - start))
        direction = (end - start) / length
        lines.append((start + direction * halves[i], direction))
        lengths.append(length - halves[i] - halves[i + 1])
        caps.append(_caps(direction, limits))
    return lines, lengths, caps


def _caps(direction: FloatArray, limits: Sequence[JointLimits]) -> Caps:
    share = np.maximum(np.abs(direction), 1e-12)
    kinds = np.array([[limit.velocity, limit.acceleration, limit.jerk] for limit in limits])
    speed, acceleration, jerk = (kinds / share[:, None]).min(axis=0) * SAFE
    return Caps(float(speed), float(acceleration), float(jerk))


def _speeds(
    corners: Sequence[Corner], lengths: Sequence[float], caps: Sequence[Caps], limits: Sequence[JointLimits]
) -> list[float]:
    """Return the speed at the start, at each corner and at the end.

    Each line is long enough for the required change of speed.
    """
    speeds = [0.0, *(_blend_speed(corner, caps[i : i + 2], limits) for i, corner in enumerate(corners)), 0.0]
    for i, (length, cap) in enumerate(zip(lengths, caps, strict=True)):
        speeds[i + 1] = _reachable(speeds[i], speeds[i + 1], length, cap)
    for i in range(len(lengths) - 1, -1, -1):
        speeds[i] = _reachable(speeds[i + 1], speeds[i], lengths[i], caps[i])
    return speeds


def _blend_speed(corner: Corner, caps: Sequence[Caps], limits: Sequence[JointLimits]) -> float:
    """Return the constant speed of a blend."""
    if corner.half == 0.0:
        return 0.0
    turn, length = np.maximum(np.abs(corner.after - corner.before), 1e-12), 2.0 * corner.half
    accelerations, jerks = np.array([[limit.acceleration, limit.jerk] for limit in limits]).T
    by_acceleration = np.sqrt((accelerations * length / (TURN * turn)).min())
    by_jerk = np.cbrt((jerks * length**2 / (TURN_CHANGE * turn)).min())
    return float(min(by_acceleration, by_jerk, *(cap.speed for cap in caps))) * SAFE


def _reachable(start: float, end: float, length: float, cap: Caps) -> float:
    """Return the highest speed up to ``end`` that can be reached from ``start`` within a given length."""
    if end <= start or _change_length(start, end, cap) <= length:
        return end
    low, high = start, end
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _change_length(start, middle, cap) <= length else (low, middle)
    return low


def _change_length(start: float, end: float, cap: Caps) -> float:
    """Return the length needed to change the speed with limited acceleration and jerk, and zero acceleration at both
    ends."""
    change = abs(end - start)
    if change >= cap.acceleration**2 / cap.jerk:
        lasts_s = change / cap.acceleration + cap.acceleration / cap.jerk
    else:
        lasts_s = 2.0 * float(np.sqrt(change / cap.jerk))
    return 0.5 * (start + end) * lasts_s


def ramp_of(start: float, end: float, length: float, cap: Caps) -> Trajectory:
    """Return ruckig's fastest motion along a line, from one speed to another."""
    task = InputParameter(1)
    task.control_interface = ControlInterface.Position
    task.current_position, task.current_velocity, task.current_acceleration = [0.0], [start], [0.0]
    task.target_position, task.target_velocity, task.target_acceleration = [length], [end], [0.0]
    task.max_velocity, task.max_acceleration, task.max_jerk = [cap.speed], [cap.acceleration], [cap.jerk]
    task.min_velocity = [-1e-9]  # the motion never goes backward along the line
    trajectory = Trajectory(1)
    if Ruckig(1).calculate(task, trajectory) not in (Result.Working, Result.Finished):
        text = f"ruckig cannot find a motion along {length:.4f} rad: reduce the scaling"
        raise PlanningError("PLANNING_FAILED", text)
    return trajectory
