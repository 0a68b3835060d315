"""The motion that is in a recording of a run."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from controller.teach.hand_path import path_of
from hal.types import JointLimits
from servoloop.recorder.reader import read_recording
from servoloop.teach.errors import TeachError
from servoloop.teach.taught import Taught, beyond


def recorded_motion(file: Path, joints: Sequence[str], limits: Sequence[JointLimits]) -> tuple[Taught, list[str]]:
    """Where the joints of a recording were measured, as a motion of an arm with these ``joints`` and ``limits``, and
    what is wrong with it; also of a program that was killed.

    Raises RecordingError, and TeachError where the joints are others or did not move.
    """
    run = read_recording(file)
    whole = Taught(run.joints, run.position).of(joints, file.name)
    measured = np.isfinite(whole.position).all(axis=1)
    later = np.append(True, np.diff(run.time_s) > 0.0)
    times_s, position = run.time_s[measured & later], whole.position[measured & later]
    path = path_of(times_s, position, limits) if len(times_s) > 1 else None
    if path is None:
        raise TeachError(f"nothing moves in {file}")
    return Taught(tuple(joints), path.position, path), beyond(position, joints, limits)
