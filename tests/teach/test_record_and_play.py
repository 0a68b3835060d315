"""Playback repeats motions recorded by hand, on virtual servos in simulated time."""

import re
from dataclasses import replace

import numpy as np
import pytest

from controller.shutdown import shut_down
from drivers.servos import sts
from hal.types import FloatArray
from servoloop.api.arm_errors import ArmEndedError, ArmError
from servoloop.teach.motion_files import TeachError
from servoloop.teach.play import APPROACH, PlayPhase
from servoloop.teach.record import HANDS_S, RecordPhase
from tests.teach.player import FASTEST, PAN, Player
from tests.teach.rig import FREE, SO101, Lesson


def recorded(soft: bool) -> tuple[Lesson, FloatArray]:
    """Return a finished recording, and the joint positions (k, n) during the motion by hand."""
    lesson = Lesson(soft).begin()
    cycle = len(lesson.rig.states)
    lesson.show(4.0)
    shown = lesson.rig.measured(cycle)
    lesson.recording.press("\n")
    return lesson, shown


def nearest(places: FloatArray, among: FloatArray) -> FloatArray:
    """Return the distance (k,) of each pose from the nearest of the other poses, for the joint with the largest
    distance."""
    return np.array([np.abs(among - place).max(axis=1).min() for place in places])


def delayed(shown: FloatArray, done: FloatArray) -> float:
    """Return the largest distance between two motions over time, at the delay at which they match best."""
    times = np.arange(len(done))

    def beside(delay: float) -> float:
        columns = [np.interp(times + delay, np.arange(len(shown)), column) for column in shown.T]
        return float(np.abs(np.stack(columns, axis=1) - done).max())

    return min(map(beside, np.arange(-50.0, 50.0, 0.25)))


@pytest.mark.parametrize("soft", [True, False])
def test_playback_repeats_the_motion_of_the_hand(soft: bool) -> None:
    lesson, shown = recorded(soft)
    motion, warnings = lesson.kept[0]
    assert motion.path is not None and not warnings and np.ptp(shown[:, PAN]) > 0.6
    player = Player(motion)
    player.go_on(until=PlayPhase.PLAYING)
    cycle = len(player.rig.states)
    assert not player.go_on() and player.play.phase is PlayPhase.DONE
    done = player.rig.measured(cycle)
    assert nearest(done, shown).max() < 0.02 and nearest(shown, done).max() < 0.02
    assert len(done) * 0.02 == pytest.approx(motion.path.duration_s, abs=0.3)
    assert delayed(shown, done) < 0.03, "also in time, but for a delay that is the same for all of it"


@pytest.mark.parametrize("soft", [True, False])
def test_arm_does_not_move_when_torque_is_enabled_again(soft: bool) -> None:
    lesson, _ = recorded(soft)
    rig, left = lesson.rig, lesson.rig.places
    assert lesson.recording.phase is RecordPhase.HELD
    rig.take_to = lambda time_s: {}
    assert not lesson.go_on(HANDS_S + 1.0), "hands have had their time"
    assert np.abs(rig.places - left).max() < 0.02
    for joint in SO101.robot.joints:
        assert rig.register(joint.name, sts.torque_enable) == 1
        full = min(round(1000 * joint.torque_limit), rig.register(joint.name, sts.max_torque) - 1)
        assert rig.register(joint.name, sts.torque_limit) == full, "and with all of its torque"


@pytest.mark.parametrize("soft", [True, False])
def test_arm_is_parked_from_its_last_position(soft: bool) -> None:
    lesson, _ = recorded(soft)
    assert not lesson.go_on(HANDS_S + 1.0)
    rig, cycle = lesson.rig, len(lesson.rig.commands) - 1
    rig.take_to = lambda time_s: {}
    park = SO101.robot.file.park
    assert park is not None
    sent: list[FloatArray] = []
    (hardware,) = (component.hardware for component in rig.loop.hardware.components)
    write = hardware.write
    hardware.write = lambda command: (sent.append(command.values), write(command))  # type: ignore[method-assign]
    assert shut_down(rig.loop, True, park.pose, park.velocity_scale) == []
    steps = np.abs(np.diff(np.array([rig.commands[cycle], *sent]), axis=0)) * 50.0
    assert (steps <= park.velocity_scale * FASTEST + 1e-6).all(), "slowly, without a leap"
    wanted = [park.pose.get(name, place) for name, place in zip(rig.names, rig.places.tolist(), strict=True)]
    assert rig.places == pytest.approx(wanted, abs=0.12), "and falls by no more than it sagged"
    assert not any(rig.register(name, sts.torque_enable) for name in rig.names)


def test_limp_arm_stays_limp_after_an_aborted_recording() -> None:
    lesson = Lesson(soft=False).begin()
    assert shut_down(lesson.rig.loop, True, FREE, 0.25) == []
    assert not any(lesson.rig.register(name, sts.torque_enable) for name in lesson.rig.names)


def test_unmoved_arm_saves_nothing_and_holds_its_position() -> None:
    lesson = Lesson(soft=False).begin()
    lesson.recording.press("q")
    assert isinstance(lesson.recording.error, TeachError) and "was not moved" in str(lesson.recording.error)
    assert not lesson.go_on(HANDS_S + 1.0) and not lesson.kept
    assert all(lesson.rig.register(name, sts.torque_enable) == 1 for name in lesson.rig.names)


def test_lost_port_ends_the_loop_and_the_motion_so_far_is_saved() -> None:
    lesson = Lesson(soft=True).begin()
    lesson.show(2.0)
    lesson.rig.lines.unplug()
    with pytest.raises(ArmEndedError):
        lesson.rig.run(1.0)
    lesson.recording.stop()
    (found,) = lesson.kept
    assert found[0].path is not None and found[0].path.duration_s > 1.5


def test_silent_servo_is_named_and_the_path_continues() -> None:
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
    motion, warnings = lesson.kept[0]
    (warning,) = warnings
    assert re.fullmatch(r"no measurement of elbow_flex for 0\.\d s: the path is a straight line in this gap", warning)
    assert motion.path is not None and motion.position[-1, PAN] == pytest.approx(0.6, abs=0.01)


def test_a_joint_with_an_alarm_is_recorded_and_a_joint_without_measurement_is_not() -> None:
    lesson = Lesson(soft=True).begin()
    count, state = len(lesson.recording._samples), lesson.rig.arm.state
    lesson.recording.take(replace(state, faults={"elbow_flex": "servo 3 is hot"}))
    assert len(lesson.recording._samples) == count + 1
    lesson.recording.take(replace(state, faults={"elbow_flex": "silent"}, unmeasured=("elbow_flex",)))
    assert len(lesson.recording._samples) == count + 1


@pytest.mark.parametrize("soft", [True, False])
def test_failure_to_enable_torque_is_reported_and_the_motion_is_saved(soft: bool) -> None:
    lesson = Lesson(soft).begin()
    lesson.show(1.0)
    (line,) = lesson.rig.lines.lines.values()
    line.faults.silence(3)
    lesson.rig.run(0.2)
    how = "soft: release it" if soft else "limp: lay it down"
    assert re.search(rf"the arm is {how}\..*(elbow_flex|servo 3)", lesson.failure())
    assert len(lesson.kept) == 1, "what was shown is kept first"
    held = [lesson.rig.register(name, sts.torque_enable) for name in lesson.rig.names]
    assert held == [int(soft)] * 6


@pytest.mark.parametrize("soft", [True, False])
@pytest.mark.parametrize("error", [BrokenPipeError("the output is closed"), KeyboardInterrupt()])
def test_torque_is_enabled_even_if_saving_the_motion_fails(error: BaseException, soft: bool) -> None:
    lesson = Lesson(soft).begin()
    lesson.show(1.0)

    def fail(*found: object) -> None:
        raise error

    lesson.keep = fail
    lesson.recording.press("q")
    assert lesson.recording.error is error and lesson.recording.phase is RecordPhase.HELD
    for joint in SO101.robot.joints:
        assert lesson.rig.register(joint.name, sts.torque_enable) == 1
        full = min(round(1000 * joint.torque_limit), lesson.rig.register(joint.name, sts.max_torque) - 1)
        assert lesson.rig.register(joint.name, sts.torque_limit) == full


def test_servo_that_may_hold_torque_is_reported_before_the_recording() -> None:
    lesson = Lesson(soft=False)
    (line,) = lesson.rig.lines.lines.values()
    line.faults.silence(3)
    with pytest.raises(ArmError, match="servo 3"):
        lesson.recording.begin()


def test_marked_poses_are_recorded_and_played_in_order() -> None:
    lesson = Lesson(soft=True, poses=True).begin()
    for count, key in (("0 poses", "p"), ("1 pose", "\n")):
        lesson.show(1.5)
        assert lesson.recording.status == f"recording {count}: press p or Enter at each pose, and q at the end"
        lesson.recording.press(key)
    marked = lesson.rig.measured()[-1]
    lesson.recording.press("q")
    motion, _ = lesson.kept[0]
    assert motion.path is None and motion.position.shape == (2, 6)
    assert motion.position[1] == pytest.approx(marked, abs=0.01)
    assert motion.position[1, PAN] - motion.position[0, PAN] == pytest.approx(0.2, abs=0.03)
    player = Player(motion, pose={**FREE, "shoulder_pan": -0.5})
    speeds = []
    while player.go_on(0.02):
        speeds.append(player.reference_speeds)
    player.rig.run(0.5)
    assert player.rig.measured()[-1] == pytest.approx(motion.position[1], abs=0.02)
    stood = nearest(motion.position, player.rig.measured())
    assert stood.max() < 0.02, "it was at each"
    assert (np.array(speeds) <= APPROACH * FASTEST[:-1] + 1e-6).all()


def test_error_without_marked_poses_explains_the_keys() -> None:
    lesson = Lesson(soft=False, poses=True).begin()
    lesson.show(1.0)
    lesson.recording.press("q")
    assert "press p or Enter" in str(lesson.recording.error)
