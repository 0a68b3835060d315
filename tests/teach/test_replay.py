"""Replay of recordings on an arm and in the view."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from drivers.driver_errors import DriverError
from servoloop.cli import app
from servoloop.commands import record as verb
from servoloop.manual.dead_man import HandsFree
from servoloop.recording.mcap import RecordingError
from servoloop.recording.reader import read_recording
from servoloop.recording.recorder import RecordingFile
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.teach.motion_files import TeachError
from servoloop.teach.play import Play, PlayPhase
from servoloop.teach.recorded import recorded_motion
from tests.recorder.rig import Rig as RecordedRig
from tests.stack.rig import READY
from tests.teach.rig import Rig

FILES = read_arm_files(find_arm("robot_arm"))
NAMES = [joint.name for joint in FILES.robot.joints]
LIMITS = [joint.limits for joint in FILES.robot.joints]
HERE = (0.0, 0.0, *READY[2:])
THERE = (0.5, 0.2, -0.4, *READY[3:])


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Record a motion there and back, and return it with an incomplete recording of a program that was killed
    halfway."""
    folder, rig = tmp_path_factory.mktemp("recordings"), RecordedRig(HERE)
    whole, killed = folder / "whole.mcap", folder / "killed.mcap"
    file = RecordingFile(whole, rig.messages)
    for pose in (THERE, HERE):
        rig.stack.go(pose)
        for sample in rig.run(2.4):
            file.write(sample)
        if pose is THERE:
            file.flush()
            killed.write_bytes(whole.read_bytes()[:-7])
    file.close((), failed=False)
    return whole, killed


def test_arm_replays_the_recording(recordings: tuple[Path, Path]) -> None:
    recorded = read_recording(recordings[0]).position
    motion, warnings = recorded_motion(recordings[0], NAMES, LIMITS)
    assert not warnings and np.ptp(recorded[:, 0]) > 0.45
    rig = Rig(pose=dict(zip(NAMES, (*HERE, 0.0), strict=True)), files=FILES)
    play = Play(rig.arm, motion, 1.0, HandsFree())
    cycles: list[int] = []

    def poll() -> bool:
        if play.phase is PlayPhase.PLAYING:
            cycles.append(len(rig.states))
        return play.update()

    assert not rig.run(60.0, poll) and play.phase is PlayPhase.DONE
    done = rig.measured(cycles[0])
    for mine, other in ((done, recorded), (recorded, done)):
        assert max(np.abs(other - place).max(axis=1).min() for place in mine) < 0.02
    assert len(done) * rig.loop.period_s == pytest.approx(4.0, abs=1.0)


def test_incomplete_recording_is_played_up_to_its_end(recordings: tuple[Path, Path]) -> None:
    motion, _ = recorded_motion(recordings[1], NAMES, LIMITS)
    assert motion.position[-1, 0] == pytest.approx(THERE[0], abs=0.02) and motion.position[0, 0] < 0.02


def test_a_recording_of_another_arm_is_refused_by_its_joints(recordings: tuple[Path, Path]) -> None:
    so101 = read_arm_files(find_arm("so101")).robot.joints
    with pytest.raises(
        TeachError, match=r"whole.mcap was recorded on a different arm: it has no shoulder_pan, .* has no joint1, "
    ):
        recorded_motion(recordings[0], [joint.name for joint in so101], [joint.limits for joint in so101])


def test_joints_come_in_the_order_of_the_arm(recordings: tuple[Path, Path]) -> None:
    motion, _ = recorded_motion(recordings[0], NAMES[::-1], LIMITS[::-1])
    assert motion.joints == tuple(NAMES[::-1]) and np.ptp(motion.position[:, -1]) > 0.45


def test_positions_beyond_this_arms_limits_are_limited_with_a_warning(recordings: tuple[Path, Path]) -> None:
    motion, warnings = recorded_motion(recordings[0], NAMES, [replace(LIMITS[0], upper=0.3), *LIMITS[1:]])
    assert len(warnings) == 1 and warnings[0].startswith("joint1 went 0.")
    assert motion.position[:, 0].max() <= 0.3


def test_recording_without_motion_or_joint_states_is_refused(tmp_path: Path) -> None:
    rig, path = RecordedRig(HERE), tmp_path / "still.mcap"
    rig.run(2.0)
    file = RecordingFile(path, rig.messages)
    for sample in rig.run(0.5):
        file.write(sample)
    file.close((), failed=False)
    with pytest.raises(TeachError, match="no joint of the arm moves"):
        recorded_motion(path, NAMES, LIMITS)
    with pytest.raises(RecordingError, match="cannot read"):
        recorded_motion(tmp_path / "none.mcap", NAMES, LIMITS)


@pytest.mark.runs("servoloop replay run.mcap")
def test_without_a_port_the_recording_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[Any] = []
    monkeypatch.setattr(verb, "view", lambda recording, **options: shown.append((recording, options["arm"])))
    assert CliRunner().invoke(app, ["replay", "run.mcap"]).exit_code == 0
    assert shown == [(Path("run.mcap"), None)]


@pytest.mark.parametrize(
    "options", [("--arm", "so101"), ("--namespace", "left"), ("--speed", "0.5"), ("--hands-free",)]
)
def test_without_an_arm_the_options_of_a_motion_are_refused(options: tuple[str, ...]) -> None:
    done = CliRunner().invoke(app, ["replay", "run.mcap", *options])
    refusal = f"{options[0]} applies only if the arm moves: add --port or --running, or omit {options[0]}"
    assert isinstance(done.exception, DriverError) and str(done.exception) == refusal


def test_command_reports_errors_before_it_opens_a_port(recordings: tuple[Path, Path]) -> None:
    def refused(*words: str) -> str:
        with pytest.raises(DriverError) as error:
            CliRunner().invoke(app, ["replay", *words, "--port", "./no_such_port"], catch_exceptions=False)
        return str(error.value)

    assert "no key can be held because stdin is not a terminal" in refused(str(recordings[0]))
    assert "was recorded on a different arm" in refused(str(recordings[0]), "--arm", "so101", "--hands-free")
    assert "no_such_port" in refused(str(recordings[0]), "--hands-free")
