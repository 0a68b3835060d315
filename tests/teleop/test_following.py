"""A leader in somebody's hand and its follower, on virtual servos and simulated time."""

import numpy as np
import pytest

from controller.teleop.leader_follower_controller import Phase
from controller.teleop.ramp_in import SHARE
from drivers.servos import sts
from hal.lifecycle import LifecycleState
from hal.types import FloatArray
from servoloop.teleop.screen import said
from tests.teleop.rig import FOLLOWER, REST, Rig, delay_s, sine

PAN = "shoulder_pan"


def commands(rig: Rig, since: int = 0) -> FloatArray:
    return np.array(rig.commands[since:])


@pytest.mark.parametrize("rate_hz", [50, 100])
def test_the_follower_follows_half_a_hertz_within_sixty_milliseconds(rate_hz: int) -> None:
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
    assert rig.controller.phase is Phase.FOLLOWING and rig.loop.figures.missed == 0
    assert 0.0 < max(rig.teleop.latency.ages_s) <= 1.0 / rate_hz


def test_the_leader_never_gets_torque_and_the_follower_keeps_its_own() -> None:
    rig = Rig().follow()
    rig.run(1.0)
    memories = [servo.memory for line in rig.leader.lines.values() for servo in line.servos]
    assert len(memories) == 6 and not any(memory.get(sts.torque_enable) for memory in memories)
    assert all(servo.memory.get(sts.torque_enable) for line in rig.follower.lines.values() for servo in line.servos)


def test_the_follower_joins_slowly_from_wherever_it_stands() -> None:
    rig = Rig(follower={**REST, PAN: -1.0, "elbow_flex": 0.2})
    assert commands(rig).size == 0
    rig.controller.allowed = True
    rig.run(0.3)
    assert rig.controller.phase is Phase.JOINING
    rig.follow()
    ways = np.abs(np.diff(commands(rig), axis=0)) * 50.0
    fastest = np.array([joint.limits.velocity for joint in FOLLOWER.robot.joints])
    assert (ways.max(axis=0) <= (SHARE + 0.03) * fastest).all() and ways[:, rig.joint(PAN)].max() > 0.5
    assert commands(rig)[-1][rig.joint(PAN)] == pytest.approx(REST[PAN], abs=0.05)


def test_nothing_moves_without_the_key_and_the_follower_holds_when_it_is_let_go() -> None:
    rig = Rig(follower={**REST, PAN: -1.0})
    rig.run(1.0)
    assert rig.controller.phase is Phase.HOLDING and np.ptp(commands(rig), axis=0).max() == 0.0
    rig.follow()
    rig.hand = sine(PAN, 0.5, 0.5)
    rig.run(0.7)
    rig.controller.allowed = False
    cycle = len(rig.commands)
    rig.run(1.0)
    assert np.ptp(commands(rig, cycle), axis=0).max() == 0.0
    rig.controller.allowed = True
    rig.run(0.1)
    assert rig.controller.phase is Phase.JOINING, "the leader has gone on meanwhile"


def test_it_holds_within_a_cycle_when_the_leaders_port_is_pulled_and_joins_anew_when_it_is_back() -> None:
    rig = Rig().follow()
    rig.hand = sine(PAN, 0.5, 0.5)
    rig.run(1.2)
    assert rig.controller.phase is Phase.FOLLOWING
    cycle = len(rig.commands)
    rig.leader.unplug()
    rig.run(1.0)
    held = commands(rig, cycle)
    assert len(held) >= 50 and np.ptp(held, axis=0).max() == 0.0, "from the very cycle on in which it is lost"
    assert np.array_equal(held[0], rig.commands[cycle - 1])
    assert rig.controller.phase is Phase.HOLDING and "was unplugged" in rig.controller.reason
    assert not rig.teleop.lost, "the follower is well"
    rig.leader.plugged = True
    rig.loop.component_transitions.ask("leader", LifecycleState.INACTIVE)
    rig.follow()
    ways = np.abs(np.diff(commands(rig, cycle), axis=0)) * 50.0
    assert ways.max() <= max(joint.limits.velocity for joint in FOLLOWER.robot.joints)


def test_a_silent_servo_of_the_leader_is_named_and_holds_the_follower() -> None:
    rig = Rig().follow()
    (line,) = rig.leader.lines.values()
    line.faults.silence(3)
    cycle = len(rig.commands)
    rig.run(0.5)
    assert rig.controller.phase is Phase.HOLDING and "elbow_flex" in rig.controller.reason
    assert np.ptp(commands(rig, cycle), axis=0).max() == 0.0
    line.faults.restore(3)
    rig.follow()


def test_a_silent_servo_of_the_follower_is_named_and_the_others_follow() -> None:
    rig = Rig().follow()
    (line,) = rig.follower.lines.values()
    line.faults.silence(3)
    begun_s = rig.clock.now()
    rig.hand = lambda time_s: {**REST, PAN: min(0.4, time_s - begun_s)}
    rig.run(1.0)
    assert "servo 3" in rig.states[-1].faults["elbow_flex"].text and len(rig.states[-1].faults) == 1
    assert rig.states[-1].position[rig.joint(PAN)] == pytest.approx(0.4, abs=0.02)
    assert "servo 3" in said(rig.teleop) and said(rig.teleop).startswith("following")


def test_a_leader_beyond_the_limits_takes_the_follower_to_them_and_no_further() -> None:
    rig = Rig().follow()
    rig.hand = lambda time_s: {**REST, PAN: 3.0}
    rig.run(4.0)
    upper = FOLLOWER.limits[PAN].upper
    assert commands(rig)[:, rig.joint(PAN)].max() == pytest.approx(upper, abs=1e-9)


def test_a_leap_of_the_leader_is_not_followed() -> None:
    rig = Rig().follow()
    cycle = len(rig.commands)
    rig.hand = lambda time_s: {**REST, PAN: 1.2}
    rig.run(0.02)
    rig.hand = lambda time_s: REST
    rig.run(1.0)
    assert np.ptp(commands(rig, cycle)[:, rig.joint(PAN)]) <= 0.01
