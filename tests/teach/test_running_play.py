"""Playback on an arm whose control loop already runs: the arm moves only while the key is held."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from controller.teach.hand_path import HandPath
from hal.types import FloatArray
from servoloop import Arm
from servoloop.teach.play import PlayPhase
from servoloop.teach.running_play import RunningPlay
from servoloop.teach.taught import MotionStore, RecordedMotion, TeachError
from tests.command_socket.rig import SocketRig, served
from tests.command_socket.test_bad_clients import at_rest
from tests.handling.test_robot_client import files, without_ros
from tests.pages import commands
from tests.teach.player import Key
from tests.teach.rig import FREE

PAN = "shoulder_pan"
TICK_S = 0.05


def raised(arm: Arm) -> FloatArray:
    """Raise the arm from the table, and return its commanded pose (n,)."""
    arm.move_to({**FREE, PAN: 0.0}, speed=0.5)
    return np.array([*arm.state.command.values()])


def path(arm: Arm, seconds: float = 3.0) -> RecordedMotion:
    """Motion of the first joint from 0 to 0.8 rad. The other joints stay at their positions."""
    times_s = np.linspace(0.0, seconds, 61)
    share = times_s / seconds
    here = raised(arm)
    position, velocity = np.tile(here, (61, 1)), np.zeros((61, len(here)))
    position[:, 0] = 0.8 * (3 * share**2 - 2 * share**3)
    velocity[:, 0] = 0.8 * 6 * (share - share**2) / seconds
    return RecordedMotion(arm.joints, position, HandPath(times_s, position, velocity))


def go_on(arm: Arm, play: RunningPlay, seconds: float) -> bool:
    """Update the playback for some time. Return False at its end."""
    end_s = arm.state.time_s + seconds
    while arm.state.time_s < end_s:
        if not play.update():
            return False
        arm.sleep(TICK_S)
    return True


def test_arm_moves_only_while_the_key_is_held_and_continues_at_its_position() -> None:
    with Arm.simulated("so101") as arm:
        key = Key(held=False)
        play = RunningPlay(arm, path(arm), 1.0, key)
        before = arm.state.command
        assert go_on(arm, play, 0.5) and play.phase is PlayPhase.WAITING and arm.state.command == before
        key.held = True
        while arm.state.command[PAN] < 0.3:
            assert go_on(arm, play, TICK_S)
        key.held = False
        assert go_on(arm, play, 1.0) and play.phase is PlayPhase.PAUSED
        paused = arm.state.command[PAN]
        assert go_on(arm, play, 0.5) and arm.state.command[PAN] == pytest.approx(paused, abs=1e-6)
        key.held, lowest = True, paused
        while go_on(arm, play, TICK_S):
            lowest = min(lowest, arm.state.command[PAN])
        assert play.phase is PlayPhase.DONE and lowest > paused - 0.15, "it does not begin again"
        assert arm.state.position[PAN] == pytest.approx(0.8, abs=0.03)


def test_poses_are_reached_one_after_the_other() -> None:
    with Arm.simulated("so101") as arm:
        poses = np.tile(raised(arm), (2, 1))
        poses[:, 0] = 0.3, -0.1
        play, highest = RunningPlay(arm, RecordedMotion(arm.joints, poses), 1.0, Key(held=True)), 0.0
        while go_on(arm, play, TICK_S):
            highest = max(highest, arm.state.position[PAN])
        assert highest == pytest.approx(0.3, abs=0.03) and arm.state.position[PAN] == pytest.approx(-0.1, abs=0.03)


def test_the_end_of_a_motion_by_another_program_is_reported() -> None:
    with Arm.simulated("so101") as arm:
        play = RunningPlay(arm, path(arm), 1.0, Key(held=True))
        assert go_on(arm, play, 0.5)
        arm.stop()
        with pytest.raises(TeachError, match="the arm has stopped: the motion was canceled"):
            go_on(arm, play, 2.0)


def test_q_ends_the_playback() -> None:
    with Arm.simulated("so101") as arm:
        key = Key(held=True)
        play = RunningPlay(arm, path(arm), 1.0, key)
        assert go_on(arm, play, 0.5)
        key.quit = True
        assert not play.update()
        arm.sleep(1.0)
        held = arm.state.command
        assert arm.step(3).command == pytest.approx(held, abs=1e-6)


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[SocketRig]:
    with served(monkeypatch, files(tmp_path)) as rig:
        yield rig


PLAY, REPLAY = "servoloop teach play wave", "servoloop replay run.mcap --running"


@pytest.mark.runs(PLAY, REPLAY)
def test_commands_play_on_the_arm_of_a_running_stack_without_ros(rig: SocketRig) -> None:
    assert {PLAY, REPLAY} <= set(commands("teach.md"))
    folder, path = rig.stack.files.folder, rig.running.socket.parent / "run.mcap"
    assert folder is not None
    with Arm.connect() as arm, arm.record(path):
        here = np.array([*arm.state.command.values()])
        arm.move_to({"joint1": 0.2}, duration=1.0)
        arm.sleep(0.5)
    poses = np.array([here, here])
    poses[1, 0] += 0.1
    motion = RecordedMotion(arm.joints, poses)
    MotionStore(folder).require_writable()
    MotionStore(folder).save("wave", motion, {joint.name: joint for joint in rig.stack.files.robot.joints})
    done = without_ros("teach", "play", "wave", "--hands-free")
    assert (done.returncode, done.stdout) == (0, "mine holds its position: done\n"), done.stderr
    assert at_rest(rig)[0] == pytest.approx(poses[1, 0], abs=0.01)
    done = without_ros("replay", str(path), "--running", "--hands-free")
    assert (done.returncode, done.stdout) == (0, "mine holds its position: done\n"), done.stderr
    assert at_rest(rig)[0] == pytest.approx(0.2, abs=0.02)
    done = without_ros("replay", str(path), "--running", "--port", "x", "--hands-free")
    assert done.returncode == 1 and "leave out --port" in done.stderr
