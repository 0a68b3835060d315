"""Record faults: keep the last 30 seconds in memory, and write them to a file when a fault occurs."""

import logging
import re
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Final

from commissioning.atomic_write import make_folder
from servoloop.recording.bus_tap import Transfer
from servoloop.recording.mcap import SUFFIX
from servoloop.recording.messages import Messages
from servoloop.recording.recorder import RecordingFile
from servoloop.recording.sampler import CycleSample, GoalEnd

LOG = logging.getLogger("servoloop")

FOLDER: Final = Path("out/faults")
KEPT_S: Final = 30.0
"""Duration for which cycles are kept in memory, in seconds.

If a fault occurs shortly after a file was written, the next file records the fault and continues without a gap.
"""
MIN_INTERVAL_S: Final = KEPT_S - 1.0
"""Minimum time between the ends of two files, in seconds.

This time is 1 s shorter than ``KEPT_S``, because samples arrive every 0.5 s.
"""
FILES: Final = 20
"""Maximum number of files. The oldest files are deleted first."""
LARGEST_FOLDER: Final = 100_000_000
"""Maximum size of all files together, in bytes. The oldest files are deleted first, but never the newest file."""
MIN_DURATION_S: Final = 0.25
"""Minimum duration of a fault, in seconds. Shorter gaps in the measurements are normal on a busy computer or bus."""
LOST: Final = "lost"
IMMEDIATE: Final = ("no_torque", LOST)
"""Types of faults that are recorded without a minimum duration."""
NAME: Final = "????-??-??_??-??-??.???_*" + SUFFIX


class FaultFiles:
    """Sink that keeps the last ``KEPT_S`` seconds and writes them to a new file when a fault starts.

    The following count as faults: a joint that is not measured or whose torque is off, a lost component, a goal whose
    tolerances are violated, and a loop that stops with an error. Deactivation of a component by a client is not a
    fault.
    """

    eager = False
    complete = False

    def __init__(self, folder: Path, messages: Messages, now: Callable[[], datetime] = datetime.now) -> None:
        """``now`` returns the time of day for the file names."""
        self._folder, self._messages, self._now = folder, messages, now
        self._kept: deque[CycleSample] = deque()
        self._since_s: Mapping[str, float] = {}
        """Start times of the faults in the last cycle, keyed by joint or component."""
        self._known: Mapping[str, str] = {}
        """Types of the faults that have lasted long enough, keyed by joint or component."""
        self._new: list[str] = []
        """Faults that have not been written to a file yet."""
        self._written_s: float | None = None
        """Time of the last cycle written to a file."""

    def write(self, sample: CycleSample) -> None:
        """Keep a cycle and detect new faults in it."""
        self._kept.append(sample)
        while sample.state.stamp_s - self._kept[0].state.stamp_s > KEPT_S:
            self._kept.popleft()
        stamp_s, found = sample.state.stamp_s, dict(_faults(sample))
        self._since_s = {name: self._since_s.get(name, stamp_s) for name in found}
        faults = {
            name: kind
            for name, kind in found.items()
            if kind in IMMEDIATE or stamp_s - self._since_s[name] >= MIN_DURATION_S
        }
        self._new += [f"{name}: {kind}" for name, kind in faults.items() if name not in self._known]
        ends = (goal for goal in sample.goals if isinstance(goal, GoalEnd))
        self._new += [f"{end.controller}: {end.text}" for end in ends if end.missed]
        self._known = faults

    def flush(self) -> None:
        """Write a file if there are new faults.

        Raises:
            RecordingError: The file cannot be written.
            DriverError: The folder cannot be created.
        """
        newest_s = self._kept[-1].state.stamp_s
        if self._new and (self._written_s is None or newest_s - self._written_s >= MIN_INTERVAL_S):
            self._write_file(())

    def close(self, transfers: Sequence[Transfer], failed: bool) -> None:
        """Write the remaining faults. A loop that ended with an error counts as a fault. Raises the same errors as
        ``flush``."""
        if failed:
            self._new.append("loop: ended by an error")
        if self._new and self._kept:
            self._write_file(transfers)

    def _write_file(self, transfers: Sequence[Transfer]) -> None:
        new, self._new = self._new, []
        self._written_s = self._kept[-1].state.stamp_s
        make_folder(self._folder)
        at = f"{self._now():%Y-%m-%d_%H-%M-%S.%f}"[:-3]
        words = re.sub(r"[^A-Za-z0-9]+", "_", new[0])[:40].strip("_")
        path = self._folder / f"{at}_{words}{SUFFIX}"
        file = RecordingFile(path, self._messages)
        file.add_metadata("faults", {str(number): text for number, text in enumerate(new, 1)})
        try:
            for sample in self._kept:
                file.write(sample)
        finally:
            file.close(transfers)
        LOG.info("%s: the last %.0f s were saved to %s", new[0], KEPT_S, path)
        tidy(self._folder)


def tidy(folder: Path) -> None:
    """Delete the oldest files until the number and total size of the files are within the limits."""
    total = 0
    for number, path in enumerate(sorted(folder.glob(NAME), reverse=True)):
        with suppress(FileNotFoundError):  # Another stack may have deleted the file.
            total += path.stat().st_size
            if number and (number >= FILES or total > LARGEST_FOLDER):
                path.unlink()


def _faults(sample: CycleSample) -> Iterator[tuple[str, str]]:
    """Yield the joint or component and the type of each fault in a cycle."""
    for joint, fault in sample.state.faults.items():
        if (
            fault.kind != "component"
        ):  # Lost components are handled below, and a component that was switched off does not have a fault.
            yield joint, fault.kind
    for component in sample.lost:
        yield component, LOST
