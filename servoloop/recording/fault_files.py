"""Recordings of faults: the last half minute is kept in memory, and written when something goes wrong."""

import logging
import re
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Final

from servoloop.recording.bus_tap import Transfer
from servoloop.recording.mcap import SUFFIX
from servoloop.recording.messages import Messages
from servoloop.recording.recorder import RecordingFile
from servoloop.recording.sampler import CycleSample, GoalEnd
from servoloop.stack.robot_files import make_folder

LOG = logging.getLogger("servoloop")

FOLDER: Final = Path("out/faults")
KEPT_S: Final = 30.0
"""So much is kept. What goes wrong soon after a file is in the next one, which has no gap to it."""
APART_S: Final = KEPT_S - 1.0
"""The least time between the ends of two files; a second less, because samples come half a second at a time."""
FILES: Final = 20
"""The oldest file goes when there is one more."""
LARGEST_FOLDER: Final = 100_000_000
"""Bytes of all files together; the oldest files go when there are more. The newest file stays, however large."""
LASTS_S: Final = 0.25
"""A joint that is measured again sooner has had no fault: a machine or a line that is late for a moment is normal."""
LOST: Final = "lost"
AT_ONCE: Final = ("no_torque", LOST)
"""The kinds of faults that are recorded without waiting."""
NAME: Final = "????-??-??_??-??-??.???_*" + SUFFIX


class FaultFiles:
    """A sink that keeps the last ``KEPT_S`` and writes them into a new file when a fault begins.

    Faults are a joint that is not measured or not driven, a component that is lost, a goal whose joints leave their
    tolerances, and a loop that ends by an error. A component that a client switches off is none.
    """

    eager = False

    def __init__(self, folder: Path, messages: Messages, now: Callable[[], datetime] = datetime.now) -> None:
        """``now`` is the time of day, for the files' names."""
        self._folder, self._messages, self._now = folder, messages, now
        self._kept: deque[CycleSample] = deque()
        self._since_s: Mapping[str, float] = {}
        """When the faults of the last cycle began, by the joint or component that has them."""
        self._known: Mapping[str, str] = {}
        """Those of them that are faults to be recorded."""
        self._new: list[str] = []
        """Faults that are in no file yet."""
        self._written_s: float | None = None
        """The last cycle that is in a file."""

    def write(self, sample: CycleSample) -> None:
        """Keep a cycle, and note what is wrong in it that was not before."""
        self._kept.append(sample)
        while sample.state.stamp_s - self._kept[0].state.stamp_s > KEPT_S:
            self._kept.popleft()
        stamp_s, found = sample.state.stamp_s, dict(_faults(sample))
        self._since_s = {name: self._since_s.get(name, stamp_s) for name in found}
        faults = {
            name: kind for name, kind in found.items() if kind in AT_ONCE or stamp_s - self._since_s[name] >= LASTS_S
        }
        self._new += [f"{name}: {kind}" for name, kind in faults.items() if name not in self._known]
        ends = (goal for goal in sample.goals if isinstance(goal, GoalEnd))
        self._new += [f"{end.controller}: {end.text}" for end in ends if end.missed]
        self._known = faults

    def flush(self) -> None:
        """Write what there is to write. Raises RecordingError, DriverError where there can be no folder."""
        newest_s = self._kept[-1].state.stamp_s
        if self._new and (self._written_s is None or newest_s - self._written_s >= APART_S):
            self._write_file(())

    def close(self, transfers: Sequence[Transfer], failed: bool) -> None:
        """Write the faults that are in no file yet; a loop that ``failed`` is one. Raises as ``flush``."""
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
        LOG.info("%s: the last %.0f s are recorded in %s", new[0], KEPT_S, path)
        tidy(self._folder)


def tidy(folder: Path) -> None:
    """Delete the oldest files until their number and their size are within the limits."""
    total = 0
    for number, path in enumerate(sorted(folder.glob(NAME), reverse=True)):
        with suppress(FileNotFoundError):  # another stack may have taken it away
            total += path.stat().st_size
            if number and (number >= FILES or total > LARGEST_FOLDER):
                path.unlink()


def _faults(sample: CycleSample) -> Iterator[tuple[str, str]]:
    """The faults of a cycle: the joint or the component, and the kind."""
    for joint, fault in sample.state.faults.items():
        if fault.kind != "component":  # lost, which is below, or switched
            yield joint, fault.kind
    for component in sample.lost:
        yield component, LOST
