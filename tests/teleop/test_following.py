"""A leader moved by hand and its follower, on virtual servos in simulated time."""

from typing import Any

import numpy as np
import pytest

from controller.shutdown import shut_down
from controller.teleop.leader_follower_controller import FollowerPhase
from controller.teleop.ramp_in import SHARE
from drivers.servos import sts
from hal.lifecycle import LifecycleState
from hal.servos.leader_arm import LeaderArm
from hal.types import FloatArray
from servoloop.stack.hardware import open_buses
from servoloop.teleop.arms import TeleopError, release_leader
from servoloop.teleop.attendance import AGAIN_S, HINT
from servoloop.teleop.screen import rows, status_line
from sim_backend.clock import SimulatedClock
from sim_backend.line.line import ServoLine
from tests.teleop.rig import FOLLOWER, LEADER, REST, Lines, Rig, delay_s, sine

PAN = "shoulder_pan"


def commands(rig: Rig, since: int = 0) -> FloatArray:
    return np.array(rig.commands[since:])


@pytest.mark.parametrize("rate_hz", [50, 100])
def test_follower_lags_less_than_sixty_milliseconds_at_half_a_hertz(rate_hz: int) -> None:
    rig = Rig(rate_hz).follow()
    begun_s, cycle = rig.clock.now(), len(rig.states)
    hand = sine(PAN, 0.5, 0.5)
    rig.hand = lambda time_s: hand(time_s - begun_s)
    rig.run(6.0)
    place = rig.joint(PAN)
    measured = np.array([state.position[place] for state in rig.states[cycle:]])
    times = np.array([state.stamp_s for state in rig.states[cycle:]])
    assert 0.0 < delay_s(times, lambda time_s: hand(time_s - begun_s)[PAN], measured) <= 0.060
    assert np.ptp(measured) == pytest.approx(1.0, abs=0.06)
    assert rig.controller.phase is FollowerPhase.FOLLOWING and rig.loop.figures.missed == 0
    assert 0.0 < max(rig.teleop.latency.ages_s) <= 1.0 / rate_hz


def test_leader_never_has_torque_and_follower_keeps_its_torque() -> None:
    rig = Rig().follow()
    rig.run(1.0)
    memories = [servo.memory for line in rig.leader.lines.values() for servo in line.servos]
    assert len(memories) == 6 and not any(memory.get(sts.torque_enable) for memory in memories)
    assert all(servo.memory.get(sts.torque_enable) for line in rig.follower.lines.values() for servo in line.servos)


def hold(line: ServoLine[Any], *servo_ids: int) -> None:
    """Enable the torque of servos, as an earlier program may have done."""
    for servo_id in servo_ids:
        line.servo(servo_id).memory.put(sts.torque_enable, 1)


def torque(line: ServoLine[Any]) -> list[int]:
    return [servo.servo_id for servo in line.servos if servo.memory.get(sts.torque_enable)]


def test_leader_with_torque_is_released_only_after_confirmation() -> None:
    rig = Rig()
    (line,) = rig.leader.lines.values()
    assert rig.asked == []
    hold(line, 2, 3)

    def no(question: str) -> None:
        rig.asked.append(question)
        raise TeleopError("no")

    with pytest.raises(TeleopError, match="no"):
        release_leader(rig.teleop, no)
    assert torque(line) == [2, 3]
    (asked,) = rig.asked
    assert "leader/shoulder_lift (servo 2), leader/elbow_flex (servo 3) have torque enabled, and" in asked
    release_leader(rig.teleop, rig.asked.append)
    assert torque(line) == []


def test_leader_with_torque_is_released_before_its_settings_are_written() -> None:
    lines, clock = Lines(LEADER, REST, lambda time_s: None), SimulatedClock()
    (line,) = lines.lines.values()
    leader = LeaderArm(
        LEADER.robot.joints,
        lambda: open_buses(LEADER.robot.file, lines.devices, clock, open_port=lines.open),
        clock,
    )
    line.servo(6).memory.save(sts.max_torque, 1000)
    hold(line, 6)
    leader.configure()
    assert leader.held() == ["leader/gripper (servo 6)"]
    assert line.servo(6).memory.get(sts.max_torque) == 1000, "it may be another arm's"
    leader.release()
    assert torque(line) == [] and line.servo(6).memory.get(sts.max_torque) == 500


def test_leader_that_returns_with_torque_is_reported_but_not_released() -> None:
    rig = Rig().follow()
    (line,) = rig.leader.lines.values()
    rig.leader.unplug()
    rig.attend(0.5)
    hold(line, 3)
    rig.leader.plugged = True
    shown = rig.attend(2.5)
    assert torque(line) == [3] and rig.controller.phase is FollowerPhase.HOLDING
    assert "leader/elbow_flex (servo 3) has torque enabled, and the arm may fall" in shown


def test_follower_joins_the_leader_slowly_from_any_position() -> None:
    rig = Rig(follower={**REST, PAN: -1.0, "elbow_flex": 0.2})
    assert commands(rig).size == 0
    rig.controller.allowed = True
    rig.run(0.3)
    assert rig.controller.phase is FollowerPhase.JOINING
    rig.follow()
    ways = np.abs(np.diff(commands(rig), axis=0)) * 50.0
    fastest = np.array([joint.limits.velocity for joint in FOLLOWER.robot.joints])
    assert (ways.max(axis=0) <= (SHARE + 0.03) * fastest).all() and ways[:, rig.joint(PAN)].max() > 0.5
    assert commands(rig)[-1][rig.joint(PAN)] == pytest.approx(REST[PAN], abs=0.05)


def test_follower_moves_only_while_the_key_is_held() -> None:
    rig = Rig(follower={**REST, PAN: -1.0})
    rig.run(1.0)
    assert rig.controller.phase is FollowerPhase.HOLDING and np.ptp(commands(rig), axis=0).max() == 0.0
    rig.follow()
    rig.hand = sine(PAN, 0.5, 0.5)
    rig.run(0.7)
    rig.controller.allowed = False
    cycle = len(rig.commands)
    rig.run(1.0)
    assert np.ptp(commands(rig, cycle), axis=0).max() == 0.0
    rig.controller.allowed = True
    rig.run(0.1)
    assert rig.controller.phase is FollowerPhase.JOINING, "the leader has gone on meanwhile"


def test_follower_holds_when_the_leader_port_is_lost_and_rejoins_when_it_returns() -> None:
    rig = Rig().follow()
    rig.hand = sine(PAN, 0.5, 0.5)
    rig.run(1.2)
    assert rig.controller.phase is FollowerPhase.FOLLOWING
    cycle = len(rig.commands)
    rig.leader.unplug()
    rig.run(1.0)
    held = commands(rig, cycle)
    assert len(held) >= 50 and np.ptp(held, axis=0).max() == 0.0, "from the very cycle on in which it is lost"
    assert np.array_equal(held[0], rig.commands[cycle - 1])
    assert rig.controller.phase is FollowerPhase.HOLDING and "was unplugged" in rig.controller.reason
    assert not rig.teleop.lost, "the follower is well"
    rig.leader.plugged = True
    rig.loop.component_transitions.ask("leader", LifecycleState.INACTIVE)
    rig.follow()
    ways = np.abs(np.diff(commands(rig, cycle), axis=0)) * 50.0
    assert ways.max() <= max(joint.limits.velocity for joint in FOLLOWER.robot.joints)


@pytest.mark.parametrize("relax", [False, True])
def test_end_with_a_lost_leader_succeeds_while_the_user_interface_continues(relax: bool) -> None:
    rig = Rig().follow()
    rig.leader.unplug()
    rig.attend(1.5)

    def update() -> bool:
        rig.attendance.update(rig.clock.now())
        return False

    assert shut_down(rig.loop, relax, {PAN: 0.5}, 0.25, hurry=update) == []
    rig.clock.sleep_until(rig.clock.now() + 2.0 * AGAIN_S)
    update()
    assert "leader is lost: virtual was unplugged" in rig.person.shown[-1]


def test_end_during_an_activation_of_the_follower_is_shown() -> None:
    rig = Rig().follow()
    (line,) = rig.follower.lines.values()
    line.servo(3).power_cycle()
    rig.attend(1.0)
    rig.person.typed = ["a"]
    rig.attendance.update(rig.clock.now())
    shut_down(rig.loop, False, None, 1.0)
    rig.attendance.update(rig.clock.now())
    assert "the control loop has ended" in rig.person.shown[-1]


def test_silent_leader_servo_is_reported_and_the_follower_holds() -> None:
    rig = Rig().follow()
    (line,) = rig.leader.lines.values()
    line.faults.silence(3)
    cycle = len(rig.commands)
    rig.run(0.5)
    assert rig.controller.phase is FollowerPhase.HOLDING and "elbow_flex" in rig.controller.reason
    assert np.ptp(commands(rig, cycle), axis=0).max() == 0.0
    line.faults.restore(3)
    rig.follow()


def test_silent_follower_servo_is_reported_and_others_follow() -> None:
    rig = Rig().follow()
    (line,) = rig.follower.lines.values()
    line.faults.silence(3)
    begun_s = rig.clock.now()
    rig.hand = lambda time_s: {**REST, PAN: min(0.4, time_s - begun_s)}
    rig.run(1.0)
    assert "servo 3" in rig.states[-1].faults["elbow_flex"].text and len(rig.states[-1].faults) == 1
    assert rig.states[-1].position[rig.joint(PAN)] == pytest.approx(0.4, abs=0.02)
    assert "servo 3" in status_line(rig.teleop) and status_line(rig.teleop).startswith("following")


def test_follower_stops_at_its_limits_when_the_leader_exceeds_them() -> None:
    rig = Rig().follow()
    rig.hand = lambda time_s: {**REST, PAN: 3.0}
    rig.run(4.0)
    upper = FOLLOWER.limits[PAN].upper
    assert commands(rig)[:, rig.joint(PAN)].max() == pytest.approx(upper, abs=1e-9)


def test_leader_far_outside_the_limits_is_reported_with_the_full_error() -> None:
    rig = Rig(leader={**REST, "wrist_flex": -2.958}).follow()
    rig.run(3.0)
    shown = status_line(rig.teleop)
    assert "leader/wrist_flex would move wrist_flex to -2.958, outside its limits -1.658 to 1.658" in shown
    assert "calibrated wrongly" in shown and "shoulder_pan" not in shown
    (row,) = [row for row in rows(rig.teleop) if row[0] == "wrist_flex"]
    _, leader, follower, error = row
    assert leader == pytest.approx(-2.958, abs=0.01) and follower == pytest.approx(-1.658, abs=0.02)
    assert error == pytest.approx(leader - follower, abs=0.002)
    assert "calibrated" in rig.attend(0.2)
    rig.hand = lambda time_s: {**REST, "wrist_flex": -1.70}  # the stop of the leader may be slightly outside its limits
    rig.run(0.5)
    assert status_line(rig.teleop) == FollowerPhase.FOLLOWING


def test_leader_far_outside_the_limits_is_reported_before_anything_moves() -> None:
    rig = Rig(leader={**REST, "elbow_flex": -2.4})
    rig.person.held = False
    assert "leader/elbow_flex would move elbow_flex to -2.40" in rig.attend(0.2)
    assert np.ptp(commands(rig), axis=0).max() == 0.0


def test_key_reactivates_a_jammed_follower_servo_at_its_position() -> None:
    rig = Rig().follow()
    (line,) = rig.follower.lines.values()
    line.servo(3).power_cycle()
    shown = rig.attend(1.0)
    assert "servo 3 has lost its torque" in shown and HINT in shown
    rig.person.held, rig.person.typed = False, ["a"]
    cycle = len(rig.states)
    shown = rig.attend(1.5)
    assert torque(line) == [1, 2, 3, 4, 5, 6] and "servo 3" not in shown and HINT not in shown
    assert rig.controller.phase is FollowerPhase.HOLDING
    moved = np.ptp(np.array([state.position for state in rig.states[cycle:]]), axis=0)[:6]
    assert np.delete(moved, 2).max() < 0.02, "the others have held"
    rig.person.held = True
    rig.hand = lambda time_s: {**REST, PAN: 0.2}
    rig.attend(3.0)
    assert rig.states[-1].position[rig.joint(PAN)] == pytest.approx(0.2, abs=0.02)


def test_failed_activation_is_shown_and_can_be_repeated() -> None:
    rig = Rig().follow()
    (line,) = rig.follower.lines.values()
    line.servo(3).power_cycle()
    rig.attend(1.0)
    line.faults.silence(2)
    rig.person.held, rig.person.typed = False, ["a"]
    shown = rig.attend(2.0)
    assert "servo 2" in shown and HINT in shown
    assert set(torque(line)) >= {1, 4, 5, 6}
    line.faults.restore(2)
    rig.person.typed = ["a"]
    rig.attend(2.0)
    assert torque(line) == [1, 2, 3, 4, 5, 6]


def test_jump_of_the_leader_is_not_followed() -> None:
    rig = Rig().follow()
    cycle = len(rig.commands)
    rig.hand = lambda time_s: {**REST, PAN: 1.2}
    rig.run(0.02)
    rig.hand = lambda time_s: REST
    rig.run(1.0)
    assert np.ptp(commands(rig, cycle)[:, rig.joint(PAN)]) <= 0.01
