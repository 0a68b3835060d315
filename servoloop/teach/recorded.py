"""Extract a motion from the recording of a run."""

from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from controller.teach.hand_path import STIRS, movement, path_of, tolerances
from hal.types import JointLimits
from servoloop.recording.reader import read_recording
from servoloop.teach.motion_files import RecordedMotion, TeachError, beyond, check_duration


def recorded_motion(
    file: Path, joints: Sequence[str], limits: Sequence[JointLimits], followers: Collection[str] = ()
) -> tuple[RecordedMotion, list[str]]:
    """Read the measured motion of a recording, which may be incomplete.

    Args:
        file: Path of the recording.
        joints: Joints of the arm. Other joints of the recording are ignored with a warning.
        limits: Limits of ``joints``.
        followers: Mimic joints of the arm, which are ignored without a warning.

    Returns:
        Motion of ``joints`` within ``limits``, and the warnings about this motion.

    Raises:
        RecordingError: The file is not a recording.
        TeachError: The recording lacks joints of the arm, or no joint moves in the recording.
    """
    run = read_recording(file)
    own = [name for name in run.joints if name in joints]
    if len(own) < len(joints):
        RecordedMotion(run.joints, run.position).of(joints, file.name)  # raises TeachError
    position = run.position[:, [run.joints.index(name) for name in joints]]
    measured = np.isfinite(position).all(axis=1)
    times_s, position = run.time_s[measured], position[measured]
    strange = [name for name in run.joints if name not in joints and name not in followers]
    warnings = [f"{file.name}: {name} is ignored because the arm has no such joint" for name in strange]
    moved = movement(times_s, position, tolerances(limits, STIRS)) if len(times_s) > 1 else None
    if moved is not None:
        check_duration(float(np.ptp(times_s[moved])), str(file))
    path = path_of(times_s, position, limits) if moved is not None else None
    if path is None:
        raise TeachError(f"no joint of the arm moves in {file}")
    return RecordedMotion(tuple(joints), path.position, path), [*warnings, *beyond(position, joints, limits)]
