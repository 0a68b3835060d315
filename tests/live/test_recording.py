"""Playback of a recording: forward, backward, and with jumps in time."""

from pathlib import Path

import numpy as np
import pytest

from servoloop.recording.mcap import RecordingError
from servoloop.recording.sources import PlayedRecording
from tests.recorder.rig import Rig
from tests.stack.rig import READY


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Rig, Path]:
    """Record more than a minute, with one goal at the start and another soon after."""
    path, rig = tmp_path_factory.mktemp("run") / "run.mcap", Rig()
    for seconds, joint1 in ((1.0, 0.2), (80.0, 0.0)):
        rig.stack.go([joint1, *READY[1:]], 1.0)
        rig.run(seconds)
    rig.record(path)
    return rig, path


@pytest.mark.slow
def test_every_position_shows_its_measurement_after_any_seek(run: tuple[Rig, Path]) -> None:
    rig, path = run
    recording = PlayedRecording(path)
    stamps = np.array([sample.state.stamp_s for sample in rig.samples]) - rig.samples[0].state.stamp_s
    assert recording.length_s == pytest.approx(stamps[-1])
    for at_s in (0.0, 0.5, 0.7, 75.0, 3.0, 2.0, 79.0, 0.0):
        place = int(np.searchsorted(stamps, at_s + 1e-6, side="right")) - 1
        snapshot = recording.play_to(at_s).state.snapshot
        np.testing.assert_array_equal(snapshot.position, rig.samples[place].state.position, err_msg=str(at_s))
        time_s = recording.robot.state.curves().time_s
        assert time_s[-1] - time_s[0] == pytest.approx(min(60.0, stamps[place]), abs=0.11)


@pytest.mark.slow
def test_seek_keeps_earlier_messages_that_are_still_valid(run: tuple[Rig, Path]) -> None:
    recording = PlayedRecording(run[1])
    snapshot = recording.play_to(75.0).state.snapshot
    assert snapshot.description_xml.startswith("<?xml") and snapshot.statuses
    goal = snapshot.goals["arm_controller"]
    assert goal.ended.startswith("succeeded") and goal.positions[0, 0] == 0.0
    back = recording.play_to(0.5)
    assert back.state.snapshot.goals["arm_controller"].positions[0, 0] == 0.2
    start = back.start(back.state.snapshot.goals["arm_controller"])
    assert start is not None and abs(start[0]) < 0.01


def test_recording_without_joint_states_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.mcap").write_bytes(b"nothing")
    with pytest.raises(RecordingError, match="is a text file, not an MCAP recording"):
        PlayedRecording(tmp_path / "x.mcap")
    with pytest.raises(RecordingError, match="cannot read"):
        PlayedRecording(tmp_path / "none.mcap")
