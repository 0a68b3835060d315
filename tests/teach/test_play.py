"""Playback of a motion: slowly to its start, only while the key is held, and within the limits."""

import numpy as np
import pytest

from controller.teach.hand_path import HandPath
from drivers.servos import sts
from servoloop.manual.dead_man import HandsFree
from servoloop.teach.arm import add_trajectory
from servoloop.teach.play import APPROACH, Play, PlayPhase
from servoloop.teach.taught import RecordedMotion, TeachError
from tests.teach.player import FASTEST, PAN, Key, Player, path
from tests.teach.rig import FREE, Rig


def test_motion_to_the_start_is_slow() -> None:
    player = Player(path(), pose={**FREE, "shoulder_pan": -1.2})
    player.go_on(until=PlayPhase.PLAYING)
    speeds = np.abs(player.speeds)
    assert (speeds <= APPROACH * FASTEST + 1e-6).all() and speeds[:, PAN].max() > 0.5
    assert player.rig.measured()[-1, PAN] == pytest.approx(0.0, abs=0.02)


def test_arm_moves_only_while_the_key_is_held_and_stops_within_its_limits() -> None:
    player = Player(path(), key=Key(held=False))
    player.go_on(2.0)
    assert player.play.phase is PlayPhase.WAITING and np.ptp(np.array(player.rig.commands), axis=0).max() == 0.0
    player.key.held = True
    player.go_on(until=PlayPhase.PLAYING)
    player.go_on(1.2)
    cycle = len(player.speeds)
    assert player.speeds[-1][PAN] > 0.3
    player.key.held = False
    player.go_on(1.0)
    assert player.play.phase is PlayPhase.PAUSED
    speeds = np.array(player.speeds[cycle - 5 :])[:, PAN]
    assert speeds[-1] == 0.0 and (np.abs(np.diff(speeds)) * 50.0 <= 12.0).all(), "12 rad/s² are its limit"
    assert np.ptp(player.rig.measured(-25)[:, PAN]) < 0.01
    player.key.held = True
    assert not player.go_on() and player.play.phase is PlayPhase.DONE
    assert player.rig.measured()[-1, PAN] == pytest.approx(0.8, abs=0.01), "it goes on where it stood"


def test_q_ends_the_playback_immediately() -> None:
    player = Player(path())
    player.go_on(until=PlayPhase.PLAYING)
    player.key.quit = True
    assert not player.go_on(0.1)


def test_half_speed_takes_twice_the_time() -> None:
    durations_s = []
    for speed in (1.0, 0.5):
        player = Player(path(), speed)
        player.go_on(until=PlayPhase.PLAYING)
        begun_s = player.rig.clock.now()
        assert not player.go_on()
        durations_s.append(player.rig.clock.now() - begun_s)
    assert durations_s[0] == pytest.approx(3.0, abs=0.2) and durations_s[1] == pytest.approx(6.0, abs=0.2)


def test_motion_faster_than_the_joints_is_played_at_their_limits() -> None:
    player = Player(path(seconds=0.3, turns=1.2))  # the motion reaches 6 rad/s, but the limit of the joint is 4 rad/s
    player.go_on(until=PlayPhase.PLAYING)
    cycle = len(player.rig.commands)
    assert not player.go_on()
    assert (player.rig.speeds(cycle) <= FASTEST).all() and player.rig.speeds(cycle)[:, PAN].max() > 2.0
    assert player.rig.measured()[-1, PAN] == pytest.approx(1.2, abs=0.02)


def test_obstacle_ends_the_playback_and_names_the_joint() -> None:
    player = Player(path(seconds=3.0, turns=1.5))
    player.go_on(until=PlayPhase.PLAYING)
    player.rig.take_to = lambda time_s: {"shoulder_pan": 0.0}
    with pytest.raises(TeachError, match="shoulder_pan is off by"):
        player.go_on()


def test_silent_servo_ends_the_playback_and_is_named() -> None:
    player = Player(path())
    player.go_on(until=PlayPhase.PLAYING)
    (line,) = player.rig.lines.lines.values()
    line.faults.silence(2)
    with pytest.raises(TeachError, match="servo 2"):
        player.go_on()


def test_infeasible_motion_is_refused_before_torque_is_enabled() -> None:
    times_s = np.array([0.0, 1.0, 1.0001, 2.0])
    position = np.tile(path().position[0], (4, 1))
    position[2:, PAN] += 0.5
    jump = RecordedMotion(path().joints, position, HandPath(times_s, position, np.zeros_like(position)))
    rig = Rig()
    with pytest.raises(TeachError, match="the motion cannot be played, and the arm has not moved: shoulder_pan"):
        Play(rig.arm, add_trajectory(rig.arm), jump, 1.0, HandsFree())
    assert not any(rig.register(name, sts.torque_enable) for name in rig.names)


def test_hands_free_needs_no_key() -> None:
    rig = Rig()
    play = Play(rig.arm, add_trajectory(rig.arm), path(seconds=1.0), 1.0, HandsFree())
    rig.configure()
    play.begin()
    assert not rig.run(20.0, lambda: play.update(rig.clock.now())) and play.phase is PlayPhase.DONE
