"""Playback of a motion: slowly to its start, only while the key is held, and within the limits."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from subprocess import PIPE

import numpy as np
import pytest

from controller.teach.hand_path import HandPath
from servoloop import Arm
from servoloop.teach.motion_files import MotionStore, RecordedMotion, TeachError
from servoloop.teach.play import APPROACH, PlayPhase
from servoloop.teach.run import play
from tests.command_socket.rig import SocketRig, served
from tests.command_socket.test_bad_clients import at_rest
from tests.handling.test_robot_client import files, without_ros
from tests.pages import commands
from tests.servoloop.served import eventually
from tests.teach.player import FASTEST, PAN, Key, Player, path
from tests.teach.rig import FREE


def test_motion_to_the_start_is_slow() -> None:
    player = Player(path(), pose={**FREE, "shoulder_pan": -1.2})
    speeds = []
    while player.play.phase is not PlayPhase.PLAYING:
        assert player.go_on(0.02)
        speeds.append(player.reference_speeds)
    assert (np.array(speeds) <= APPROACH * FASTEST[:-1] + 1e-6).all() and np.max(speeds) > 0.5
    assert player.rig.measured()[-1, PAN] == pytest.approx(0.0, abs=0.02)


def test_arm_moves_only_while_the_key_is_held_and_stops_within_its_limits() -> None:
    player = Player(path(), key=Key(held=False))
    cycle = len(player.rig.commands)
    player.go_on(2.0)
    assert player.play.phase is PlayPhase.WAITING and np.abs(player.speeds(cycle)).max() == 0.0
    player.key.held = True
    while player.rig.places[PAN] < 0.3:
        player.go_on(0.02)
    cycle = len(player.rig.commands)
    player.key.held = False
    player.go_on(1.0)
    assert player.play.phase is PlayPhase.PAUSED
    speeds = player.speeds(cycle - 5)[:, PAN]
    assert speeds[0] > 0.3 and speeds[-1] == 0.0 and (np.abs(np.diff(speeds)) * 50.0 <= 12.01).all(), "its limit"
    assert np.ptp(player.rig.measured(-25)[:, PAN]) < 0.01
    paused, cycle = player.rig.places[PAN], len(player.rig.states)
    player.key.held = True
    assert not player.go_on() and player.play.phase is PlayPhase.DONE
    assert player.rig.measured(cycle)[:, PAN].min() > paused - 0.15, "it does not begin again"
    player.rig.run(0.5)
    assert player.rig.places[PAN] == pytest.approx(0.8, abs=0.02)


def test_q_ends_the_playback_immediately() -> None:
    player = Player(path())
    assert player.go_on(0.5)
    player.key.quit = True
    assert not player.go_on(0.1)
    player.rig.run(1.0)
    assert np.abs(player.speeds(-10)).max() == 0.0


def test_half_speed_takes_twice_the_time() -> None:
    durations_s = []
    for speed in (1.0, 0.5):
        player = Player(path(), speed, pose={**FREE, "shoulder_pan": 0.0})
        begun_s = player.rig.clock.now()
        assert not player.go_on()
        durations_s.append(player.rig.clock.now() - begun_s)
    assert durations_s[0] == pytest.approx(3.2, abs=0.4) and durations_s[1] == pytest.approx(6.2, abs=0.4)


def test_motion_faster_than_the_joints_is_played_at_their_limits() -> None:
    player = Player(path(seconds=0.3, turns=1.2))  # the motion reaches 6 rad/s, but the limit of the joint is 4 rad/s
    cycle = len(player.rig.commands)
    assert not player.go_on()
    speeds = np.abs(player.speeds(cycle))
    assert (speeds <= FASTEST + 1e-6).all() and speeds[:, PAN].max() > 2.0
    player.rig.run(0.5)
    assert player.rig.places[PAN] == pytest.approx(1.2, abs=0.02)


class Screen:
    """Display that ends the playback with q after some updates."""

    def __init__(self, key: Key, updates: int) -> None:
        self._key, self._updates = key, updates

    def __enter__(self) -> "Screen":
        return self

    def __exit__(self, *_: object) -> None: ...

    def show(self, phase: str, arm: Arm) -> None:
        self._updates -= 1
        self._key.quit = self._updates <= 0


@pytest.mark.parametrize(("updates", "complete"), [(5, False), (100_000, True)])
def test_a_playback_that_is_ended_with_q_is_not_complete(updates: int, complete: bool) -> None:
    player = Player(path(seconds=1.0))
    assert play(player.rig.arm, path(seconds=1.0), 1.0, player.key, Screen(player.key, updates)) is complete


def test_poses_are_reached_one_after_the_other() -> None:
    poses = np.tile(path().position[0], (2, 1))
    poses[:, PAN] = 0.3, -0.1
    player = Player(RecordedMotion(path().joints, poses))
    assert not player.go_on()
    assert player.rig.measured()[:, PAN].max() == pytest.approx(0.3, abs=0.02)
    player.rig.run(0.5)
    assert player.rig.places[PAN] == pytest.approx(-0.1, abs=0.02)


def test_the_end_of_a_motion_by_another_program_is_reported() -> None:
    player = Player(path())
    assert player.go_on(0.5)
    player.rig.arm.stop()
    with pytest.raises(TeachError, match="the arm has stopped: the motion was canceled"):
        player.go_on(2.0)


def test_obstacle_ends_the_playback_and_names_the_joint() -> None:
    player = Player(path(seconds=3.0, turns=1.5))
    player.go_on(0.7)
    player.rig.take_to = lambda time_s: {"shoulder_pan": 0.0}
    with pytest.raises(TeachError, match="shoulder_pan is off by"):
        player.go_on()


def test_silent_servo_ends_the_playback_and_is_named() -> None:
    player = Player(path())
    player.go_on(0.5)
    (line,) = player.rig.lines.lines.values()
    line.faults.silence(2)
    with pytest.raises(TeachError, match="servo 2"):
        player.go_on()


def test_infeasible_motion_is_refused_and_the_arm_does_not_move() -> None:
    times_s = np.array([0.0, 1.0, 1.0001, 2.0])
    position = np.tile(path().position[0], (4, 1))
    position[2:, PAN] += 0.5
    jump = RecordedMotion(path().joints, position, HandPath(times_s, position, np.zeros_like(position)))
    with pytest.raises(TeachError, match="the motion cannot be played; the arm has not moved: shoulder_pan"):
        Player(jump)


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[SocketRig]:
    with served(monkeypatch, files(tmp_path)) as rig:
        yield rig


RECORD = "servoloop teach record wave"


@pytest.mark.runs(RECORD)
@pytest.mark.parametrize("options", [(), ("--limp",)], ids=["soft", "limp"])
def test_a_motion_is_recorded_on_a_running_stack_without_ros(rig: SocketRig, options: tuple[str, ...]) -> None:
    assert RECORD in commands("teach.md")
    folder, registry = rig.stack.files.folder, rig.stack.loop.manager.registry
    assert folder is not None
    rig.pause_s = 0.02
    words = [sys.executable, "-u", "-m", "tests.servoloop.without", "ros", *RECORD.split()[1:], *options, "--yes"]
    with subprocess.Popen(words, stdin=PIPE, stdout=PIPE, stderr=PIPE, text=True, cwd=Path(__file__).parents[2]) as one:
        assert one.stdin is not None and one.stdout is not None
        while "recording: move the arm" not in one.stdout.readline():
            assert one.poll() is None
        assert not registry.loaded["arm_controller"].active
        rig.stack.world.load("joint1", 3.0)
        eventually(lambda: rig.stack.world.data.joint("joint1").qpos[0] > 0.05)
        rig.stack.world.load("joint1", -3.0)
        time.sleep(0.5)
        one.stdin.write("\n")
        one.stdin.flush()
        said, errors = one.communicate(timeout=60.0)
    assert one.returncode == 0 and "wave: a path of" in said, errors
    assert registry.loaded["arm_controller"].active
    path, held = MotionStore(folder).get("wave"), at_rest(rig)
    assert path.position[-1, path.joints.index("joint1")] == pytest.approx(held[0], abs=0.05) and held[0] > 0.03


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
    assert done.returncode == 1 and "omit --port" in done.stderr
