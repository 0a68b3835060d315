"""Results of ``servoloop bench arm``, for ``--json`` and the report page."""

import os
import platform
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from commissioning.ports.adapters import ports
from drivers.paths import resolved
from servoloop.bench.bus import BusSpeed


@dataclass(frozen=True, slots=True)
class Distribution:
    """Distribution of times, in ms: median, 99th percentile and largest value."""

    p50_ms: float
    p99_ms: float
    largest_ms: float

    @classmethod
    def of(cls, times_s: Iterable[float]) -> Self | None:
        """Return the distribution of times (in seconds), or None if there are no times."""
        ordered = sorted(times_s)
        if not ordered:
            return None
        count = len(ordered)
        found = (ordered[count // 2], ordered[min(count - 1, count * 99 // 100)], ordered[-1])
        return cls(*(round(1e3 * time_s, 3) for time_s in found))


@dataclass(frozen=True, slots=True)
class Timing:
    """Timing of the control loop in one measurement."""

    rate_hz: float
    cycles: int
    missed: int
    late: Distribution | None
    """Delay of a cycle's start."""
    took: Distribution | None
    """Time from the start of a cycle until its goals are sent."""


@dataclass(frozen=True, slots=True)
class JointMotion:
    """Following error of one joint (reference minus position) over all cycles, in rad or m."""

    joint: str
    largest: float
    rms_moving: float
    at_rest: float
    """Largest error at rest, starting half a second after a motion."""


@dataclass(frozen=True, slots=True)
class RosFigures:
    """Results of the ROS interface, measured by a client on this machine."""

    goals: int
    failed: int
    """Number of goals that did not succeed."""
    goal_to_answer: Distribution | None
    """Time from sending a goal until it is accepted."""
    goal_to_motion: Distribution | None
    """Time from sending a goal until measurable motion of a joint."""
    joint_states_hz: float
    joint_states_age: Distribution | None
    """Time from a measurement until it arrives at the client."""
    joint_states_jitter: Distribution | None
    """Deviation of the interval between two stamps from its median."""
    loop: Timing
    """Timing of the control loop during this measurement."""


@dataclass(frozen=True, slots=True)
class MachineFigures:
    """Properties of the machine that affect the results."""

    system: str
    processor: str
    processors: int
    python: str
    realtime: bool
    """Whether the system grants real-time priority."""
    adapters: tuple[str, ...]
    """Chip and latency timer of each bus's adapter."""


@dataclass(frozen=True, slots=True)
class ArmFigures:
    """All results of an arm."""

    arm: str
    devices: dict[str, str]
    """Serial device of each bus. If an arm has only one bus, the name of the bus is empty."""
    machine: MachineFigures
    buses: dict[str, BusSpeed]
    loop: Timing
    motions: tuple[JointMotion, ...]
    ros: RosFigures | None
    without_ros: str
    """Reason why ROS was not measured, or an empty string if it was measured."""


def machine_figures(devices: Iterable[str], realtime: bool) -> MachineFigures:
    """Return the properties of this machine."""
    known = {resolved(one.device): one for one in ports().adapters}
    found = [known.get(resolved(device)) for device in devices]
    return MachineFigures(
        system=f"{platform.system()} {platform.release()}, {platform.machine()}",
        processor=_processor(),
        processors=len(os.sched_getaffinity(0)),
        python=platform.python_version(),
        realtime=realtime,
        adapters=tuple(_adapter_text(one.chip, one.latency_ms) if one else "no serial adapter" for one in found),
    )


def _adapter_text(chip: str, latency_ms: int | None) -> str:
    return chip if latency_ms is None else f"{chip}, latency timer {latency_ms} ms"


def _processor() -> str:
    """Return the name of the processor, or of the board on ARM machines."""
    try:
        lines: Sequence[str] = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = ()
    named = (line.partition(":")[2].strip() for line in lines if line.startswith(("model name", "Model\t")))
    return next(named, platform.processor() or "unknown")
