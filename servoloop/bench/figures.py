"""The figures of a bench, as ``--json`` prints them and the page shows them."""

import os
import platform
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from commissioning.ports.adapters import ports
from servoloop.bench.bus import Figures as BusFigures


@dataclass(frozen=True, slots=True)
class Spread:
    """Times in ms: in the middle, exceeded by one of a hundred, and the largest."""

    p50_ms: float
    p99_ms: float
    largest_ms: float

    @classmethod
    def of(cls, times_s: Iterable[float]) -> Self | None:
        """The spread of these times (s); None where there are none."""
        ordered = sorted(times_s)
        if not ordered:
            return None
        count = len(ordered)
        found = (ordered[count // 2], ordered[min(count - 1, count * 99 // 100)], ordered[-1])
        return cls(*(round(1e3 * time_s, 3) for time_s in found))


@dataclass(frozen=True, slots=True)
class Timing:
    """The control loop over one run."""

    rate_hz: float
    cycles: int
    missed: int
    late: Spread | None
    """How much later than it was due a cycle began."""
    took: Spread | None
    """From there until its goals were out."""


@dataclass(frozen=True, slots=True)
class JointMotion:
    """One joint's reference less its position, rad or m, at the cycles."""

    joint: str
    largest: float
    rms_moving: float
    at_rest: float
    """The largest half a second and more after a motion."""


@dataclass(frozen=True, slots=True)
class RosFigures:
    """The surface as a client on this machine sees it."""

    goals: int
    failed: int
    """Goals that did not end well."""
    goal_to_answer: Spread | None
    goal_to_motion: Spread | None
    """Until a joint is measured elsewhere than before, by more than its noise."""
    joint_states_hz: float
    joint_states_age: Spread | None
    """From the measurement to the client."""
    joint_states_jitter: Spread | None
    """By how much the time between two stamps differs from the usual one."""
    loop: Timing
    """The loop meanwhile."""


@dataclass(frozen=True, slots=True)
class MachineFigures:
    """The machine, as far as it matters."""

    system: str
    processor: str
    processors: int
    python: str
    realtime: bool
    """Whether the system grants real-time priority."""
    adapters: tuple[str, ...]
    """Chip and latency timer of the adapter of each bus."""


@dataclass(frozen=True, slots=True)
class ArmFigures:
    """All of it."""

    arm: str
    devices: dict[str, str]
    """By bus; the only bus of an arm has no name."""
    machine: MachineFigures
    buses: dict[str, BusFigures]
    loop: Timing
    motions: tuple[JointMotion, ...]
    ros: RosFigures | None
    without_ros: str
    """Why there are no figures of ROS; empty where there are."""


def machine_figures(devices: Iterable[str], realtime: bool) -> MachineFigures:
    """Look at this machine."""
    known = {Path(one.device).resolve(): one for one in ports().adapters}
    found = [known.get(Path(device).resolve()) for device in devices]
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
    """The processor's name; of ARM boards the kernel says the board's."""
    try:
        lines: Sequence[str] = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = ()
    named = (line.partition(":")[2].strip() for line in lines if line.startswith(("model name", "Model\t")))
    return next(named, platform.processor() or "unknown")
