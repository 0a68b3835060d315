"""What a hand has shown is what the arm does then: on virtual servos and simulated time."""

import re

import numpy as np
import pytest

from controller.shutdown import shut_down
from controller.teach.hand_path import HandPath
from drivers.errors import PortLost
from drivers.servos import sts
from hal.lifecycle import LifecycleState
from hal.types import FloatArray
from servoloop.teach.arm import add_trajectory
from servoloop.teach.errors import TeachError
from servoloop.teach.play import APPROACH, Phase, Play
from servoloop.teach.record import HANDS_S, LIMP, SOFT
from servoloop.teach.record import Phase as Teaching
from servoloop.teach.taught import Taught
from servoloop.teleop.dead_man import HandsFree
from tests.teach.rig import FREE, SO101, Lesson, Pose, Rig

FASTEST = np.array([joint.limits.velocity for joint in SO101.robot.joints])
PAN = 0


class Key:
    """A key that a test holds."""

    def __init__(self, held: bool = True) -> None:
        self.held, self.quit = held, False

    def allowed(self, now_s: float) -> bool:
        return self.held

    def ended(self) -> bool:
        return self.quit


class Player:
    """An arm that plays a motion."""

    def __init__(self, taught: Taught, speed: float = 1.0, key: Key | None = None, pose: Pose = FREE) -> None:
        self.rig = Rig(pose=pose)
        self.key = key or Key()
        self.follow = add_trajectory(self.rig.arm)
        self.play = Play(self.rig.arm, self.follow, taught, speed, self.key)
        self.speeds: list[FloatArray] = []
        """Of the references, each (n,)."""
        self.rig.configure()
        self.play.begin()

    def go_on(self, seconds: float = 60.0, until: Phase | None = None) -> bool:
        """So long, or until the end or a phase; whether the end has not come."""
        going = True

        def look() -> bool:
            nonlocal going
            if self.follow.tracking is not None:
                self.speeds.append(self.follow.tracking.reference.velocity)
            going = self.play.look(self.rig.clock.now())
            return going and self.play.phase is not until

        self.rig.run(seconds, look)
        return going


def recorded(soft: bool) -> tuple[Lesson, FloatArray]:
    """A lesson that is over, and where the joints were while the hand showed the way (k, n)."""
    lesson = Lesson(soft).begin()
    cycle = len(lesson.rig.states)
    lesson.show(4.0)
    shown = lesson.rig.measured(cycle)
    lesson.recording.press("\n")
    return lesson, shown


def nearest(places: FloatArray, among: FloatArray) -> FloatArray:
    """How far each of some poses is from the nearest of others, by its worst joint (k,)."""
    return np.array([np.abs(among - place).max(axis=1).min() for place in places])


def delayed(shown: FloatArray, done: FloatArray) -> float:
    """By how much one way in time is beside the other at the most, at the delay at which that is least."""
    times = np.arange(len(done))

    def beside(delay: float) -> float:
        columns = [np.interp(times + delay, np.arange(len(shown)), column) for column in shown.T]
        return float(np.abs(np.stack(columns, axis=1) - done).max())

    return min(map(beside, np.arange(-50.0, 50.0, 0.25)))


@pytest.mark.parametrize("soft", [True, False])
def test_what_the_hand_did_is_what_the_arm_does(soft: bool) -> None:
    lesson, shown = recorded(soft)
    taught, warnings = lesson.kept[0]
    assert taught.path is not None and not warnings and np.ptp(shown[:, PAN]) > 0.6
    player = Player(taught)
    player.go_on(until=Phase.PLAYING)
    cycle = len(player.rig.states)
    assert not player.go_on() and player.play.phase is Phase.DONE
    done = player.rig.measured(cycle)
    assert nearest(done, shown).max() < 0.02 and nearest(shown, done).max() < 0.02
    assert len(done) * 0.02 == pytest.approx(taught.path.duration_s, abs=0.3)
    assert delayed(shown, done) < 0.03, "also in time, but for a delay that is the same for all of it"


@pytest.mark.parametrize("soft", [True, False])
def test_the_arm_stays_where_it_was_left_when_torque_comes_back(soft: bool) -> None:
    lesson, _ = recorded(soft)
    rig, left = lesson.rig, lesson.rig.places
    assert lesson.recording.phase is Teaching.HOLDING
    lesson.go_on(0.5)
    assert lesson.recording.phase is Teaching.HELD
    rig.take_to = lambda time_s: {}
    assert not lesson.go_on(HANDS_S + 1.0), "hands have had their time"
    assert np.abs(rig.places - left).max() < 0.02
    for joint in SO101.robot.joints:
        assert rig.register(joint.name, sts.torque_enable) == 1
        full = min(round(1000 * joint.torque_limit), 999)
        assert rig.register(joint.name, sts.torque_limit) == full, "and with all of its torque"


@pytest.mark.parametrize("soft", [True, False])
def test_an_arm_that_holds_itself_is_parked_from_where_it_was_left(soft: bool) -> None:
    lesson, _ = recorded(soft)
    assert not lesson.go_on(HANDS_S + 1.0)
    rig, cycle = lesson.rig, len(lesson.rig.commands) - 1
    rig.take_to = lambda time_s: {}
    park = SO101.robot.file.park
    assert park is not None
    sent: list[FloatArray] = []
    write = rig.arm.hardware.write
    rig.arm.hardware.write = lambda command: (sent.append(command.values), write(command))  # type: ignore[method-assign]
    assert shut_down(rig.loop, True, park.pose, park.velocity_scale) == []
    steps = np.abs(np.diff(np.array([rig.commands[cycle], *sent]), axis=0)) * 50.0
    assert (steps <= park.velocity_scale * FASTEST + 1e-6).all(), "slowly, without a leap"
    wanted = [park.pose.get(name, place) for name, place in zip(rig.names, rig.places.tolist(), strict=True)]
    assert rig.places == pytest.approx(wanted, abs=0.12), "and falls by no more than it sagged"
    assert not any(rig.register(name, sts.torque_enable) for name in rig.names)


def test_a_limp_arm_whose_recording_breaks_off_stays_limp() -> None:
    lesson = Lesson(soft=False).begin()
    assert shut_down(lesson.rig.loop, True, FREE, 0.25) == []
    assert not any(lesson.rig.register(name, sts.torque_enable) for name in lesson.rig.names)


def test_torque_goes_off_only_where_somebody_holds_the_arm() -> None:
    lesson = Lesson(soft=False)
    lesson.rig.configure()
    lesson.recording.begin(lesson.asked.append)
    assert not lesson.asked, "it is limp already"
    lesson.recording.look(0.0)
    lesson.recording.stop()
    lesson.rig.run(0.2)
    assert lesson.rig.arm.hardware.state is LifecycleState.ACTIVE
    lesson.rig.arm.hardware.deactivate(relax=False)

    def no(question: str) -> None:
        assert question == LIMP
        raise TeachError("no")

    with pytest.raises(TeachError, match="no"):
        lesson.recording.begin(no)
    assert all(lesson.rig.register(name, sts.torque_enable) == 1 for name in lesson.rig.names)
    lesson.recording.begin(lesson.asked.append)
    assert lesson.asked == [LIMP]
    assert not any(lesson.rig.register(name, sts.torque_enable) for name in lesson.rig.names)


def test_soft_torque_is_announced_and_recording_begins_when_the_arm_gives_way() -> None:
    lesson = Lesson(soft=True)
    lesson.rig.configure(lesson.recording.take)
    lesson.recording.begin(lesson.asked.append)
    assert lesson.asked == [SOFT]
    lesson.go_on(0.5)
    assert lesson.recording.phase is Teaching.READYING
    lesson.go_on(0.7)
    assert lesson.recording.phase is Teaching.BY_HAND


def test_an_arm_that_was_not_moved_leaves_nothing_and_holds_itself_all_the_same() -> None:
    lesson = Lesson(soft=False).begin()
    lesson.recording.press("q")
    assert isinstance(lesson.recording.error, TeachError) and "was not moved" in str(lesson.recording.error)
    assert not lesson.go_on(HANDS_S + 1.0) and not lesson.kept
    assert all(lesson.rig.register(name, sts.torque_enable) == 1 for name in lesson.rig.names)


def test_a_lost_port_ends_the_loop_and_what_was_shown_until_then_is_kept() -> None:
    lesson = Lesson(soft=True).begin()
    lesson.show(2.0)
    lesson.rig.lines.unplug()
    with pytest.raises(PortLost):
        lesson.rig.run(1.0)
    lesson.recording.stop()
    (found,) = lesson.kept
    assert found[0].path is not None and found[0].path.duration_s > 1.5


def test_a_servo_that_is_silent_for_a_while_is_named_and_the_path_goes_on() -> None:
    lesson = Lesson(soft=False).begin()
    (line,) = lesson.rig.lines.lines.values()
    begun_s = lesson.rig.clock.now()
    lesson.rig.take_to = lambda time_s: {**FREE, "shoulder_pan": 0.3 * min(time_s - begun_s, 2.0)}
    lesson.go_on(0.8)
    line.faults.silence(3)
    lesson.go_on(0.4)
    line.faults.restore(3)
    lesson.go_on(1.2)
    lesson.recording.stop()
    taught, warnings = lesson.kept[0]
    (warning,) = warnings
    assert re.fullmatch(r"elbow_flex not measured for 0\.\d s: the path is straight there", warning)
    assert taught.path is not None and taught.position[-1, PAN] == pytest.approx(0.6, abs=0.01)


def test_torque_that_cannot_come_back_is_told_and_the_arm_is_as_it_was() -> None:
    lesson = Lesson(soft=False).begin()
    lesson.show(1.0)
    (line,) = lesson.rig.lines.lines.values()
    line.faults.silence(3)
    lesson.recording.press("\n")
    assert len(lesson.kept) == 1, "what was shown is kept first"
    with pytest.raises(TeachError, match=r"the arm is limp: put it down.*elbow_flex"):
        lesson.go_on(1.0)
    assert not any(lesson.rig.register(name, sts.torque_enable) for name in lesson.rig.names)


def test_poses_are_kept_where_they_are_marked_and_played_one_after_the_other() -> None:
    lesson = Lesson(soft=True, poses=True).begin()
    for key in ("p", "\n"):
        lesson.show(1.5)
        lesson.recording.press(key)
    marked = lesson.rig.measured()[-1]
    lesson.recording.press("q")
    taught, _ = lesson.kept[0]
    assert taught.path is None and taught.position.shape == (2, 6)
    assert taught.position[1] == pytest.approx(marked, abs=0.01)
    assert taught.position[1, PAN] - taught.position[0, PAN] == pytest.approx(0.2, abs=0.03)
    player = Player(taught, pose={**FREE, "shoulder_pan": -0.5})
    assert not player.go_on() and player.rig.measured()[-1] == pytest.approx(taught.position[1], abs=0.02)
    stood = nearest(taught.position, player.rig.measured())
    assert stood.max() < 0.02, "it was at each"
    assert (np.abs(player.speeds) <= APPROACH * FASTEST + 1e-6).all()


def test_poses_that_were_never_marked_are_an_error_that_says_how() -> None:
    lesson = Lesson(soft=False, poses=True).begin()
    lesson.show(1.0)
    lesson.recording.press("q")
    assert "press p or Enter" in str(lesson.recording.error)


def path(seconds: float = 3.0, turns: float = 0.8) -> Taught:
    """A path of the first joint from rest to rest; the others stand as they do when the arm is free."""
    times_s = np.linspace(0.0, seconds, 60)
    position = np.tile([FREE.get(joint.name, 0.0) for joint in SO101.robot.joints], (60, 1))
    position[:, PAN] += turns * (1.0 - np.cos(np.pi * times_s / seconds)) / 2.0
    velocity = np.gradient(position, times_s, axis=0)
    velocity[[0, -1]] = 0.0
    return Taught(tuple(joint.name for joint in SO101.robot.joints), position, HandPath(times_s, position, velocity))


def test_the_way_to_the_beginning_is_slow() -> None:
    player = Player(path(), pose={**FREE, "shoulder_pan": -1.2})
    player.go_on(until=Phase.PLAYING)
    speeds = np.abs(player.speeds)
    assert (speeds <= APPROACH * FASTEST + 1e-6).all() and speeds[:, PAN].max() > 0.5
    assert player.rig.measured()[-1, PAN] == pytest.approx(0.0, abs=0.02)


def test_nothing_moves_without_the_key_and_the_arm_stops_within_its_limits_when_it_is_let_go() -> None:
    player = Player(path(), key=Key(held=False))
    player.go_on(1.0)
    assert player.play.phase is Phase.WAITING and np.ptp(np.array(player.rig.commands), axis=0).max() == 0.0
    player.key.held = True
    player.go_on(until=Phase.PLAYING)
    player.go_on(1.2)
    cycle = len(player.speeds)
    assert player.speeds[-1][PAN] > 0.3
    player.key.held = False
    player.go_on(1.0)
    assert player.play.phase is Phase.PAUSED
    speeds = np.array(player.speeds[cycle - 5 :])[:, PAN]
    assert speeds[-1] == 0.0 and (np.abs(np.diff(speeds)) * 50.0 <= 12.0).all(), "12 rad/s² are its limit"
    assert np.ptp(player.rig.measured(-25)[:, PAN]) < 0.01
    player.key.held = True
    assert not player.go_on() and player.play.phase is Phase.DONE
    assert player.rig.measured()[-1, PAN] == pytest.approx(0.8, abs=0.01), "it goes on where it stood"


def test_q_ends_at_once() -> None:
    player = Player(path())
    player.go_on(until=Phase.PLAYING)
    player.key.quit = True
    assert not player.go_on(0.1)


def test_half_the_speed_takes_twice_as_long() -> None:
    durations_s = []
    for speed in (1.0, 0.5):
        player = Player(path(), speed)
        player.go_on(until=Phase.PLAYING)
        begun_s = player.rig.clock.now()
        assert not player.go_on()
        durations_s.append(player.rig.clock.now() - begun_s)
    assert durations_s[0] == pytest.approx(3.0, abs=0.2) and durations_s[1] == pytest.approx(6.0, abs=0.2)


def test_a_hand_that_was_faster_than_the_joints_is_followed_as_fast_as_they_can() -> None:
    player = Player(path(seconds=0.3, turns=1.2))  # 6 rad/s, where the joint has 4
    player.go_on(until=Phase.PLAYING)
    cycle = len(player.rig.commands)
    assert not player.go_on()
    assert (player.rig.speeds(cycle) <= FASTEST).all() and player.rig.speeds(cycle)[:, PAN].max() > 2.0
    assert player.rig.measured()[-1, PAN] == pytest.approx(1.2, abs=0.02)


def test_an_obstacle_ends_the_playing_with_the_joints_name() -> None:
    player = Player(path(seconds=3.0, turns=1.5))
    player.go_on(until=Phase.PLAYING)
    player.rig.take_to = lambda time_s: {"shoulder_pan": 0.0}
    with pytest.raises(TeachError, match="shoulder_pan is off by"):
        player.go_on()


def test_a_silent_servo_ends_the_playing_with_its_name() -> None:
    player = Player(path())
    player.go_on(until=Phase.PLAYING)
    (line,) = player.rig.lines.lines.values()
    line.faults.silence(2)
    with pytest.raises(TeachError, match="servo 2"):
        player.go_on()


def test_hands_free_needs_no_key() -> None:
    rig = Rig()
    play = Play(rig.arm, add_trajectory(rig.arm), path(seconds=1.0), 1.0, HandsFree())
    rig.configure()
    play.begin()
    assert not rig.run(20.0, lambda: play.look(rig.clock.now())) and play.phase is Phase.DONE
