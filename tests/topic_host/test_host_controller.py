"""Drive a virtual SO-101 through a stand-in for ros2_control's plugin: the arm never jumps, and it holds its position
when it must."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest

from controller.host.host_controller import MAX_SILENCE_S, HostController, HostPhase
from hal.types import JointLimits, JointState
from tests.topic_host.plugin import Message
from tests.topic_host.rig import PERIOD_S, HostRig

JOINT, PLACE = "shoulder_pan", 0
WIDE_RAD, TURN_S = 0.6, 3.0
"""Width and period of the motion."""
Changed = Callable[[Message], Message]


def swing(time_s: float, middle: Mapping[str, float]) -> dict[str, float]:
    """Return commands that move one joint back and forth about its middle and leave the other joints at their
    middle."""
    angle = WIDE_RAD * math.sin(2.0 * math.pi * max(time_s - 1.0, 0.0) / TURN_S) ** 3
    return {**middle, JOINT: middle[JOINT] + angle}


def swinging() -> HostRig:
    """Return a rig at rest whose controllers begin to move a joint back and forth after one second."""
    rig = HostRig(lambda time_s: {})
    rig.stack.up()
    rig.stack.run(0.1)
    middle = dict(rig.plugin.states)
    rig.wanted = lambda time_s: swing(time_s, middle)
    return rig


def moving(rig: HostRig, last: int = 1) -> bool:
    """Return whether the command of the joint changed in the last cycles."""
    return bool(np.ptp(rig.path[-last - 1 :, PLACE]) > 1e-9)


def test_the_arm_holds_until_a_controller_commands_it() -> None:
    """Before the activation of its controllers, the plugin sends NaN for every joint."""
    rig = HostRig(lambda time_s: {})
    rig.stack.up()
    rig.stack.run(1.0)
    assert rig.messages > 90 and not rig.refused
    assert rig.controller.phase is HostPhase.WAITING
    assert np.ptp(rig.path, axis=0).max() == 0.0


def test_the_arm_follows_the_commands_closely(caplog: pytest.LogCaptureFixture) -> None:
    rig = swinging()
    rig.stack.run(8.0)
    times_s = PERIOD_S * np.arange(len(rig.path)) + rig.stack.clock.now() - PERIOD_S * len(rig.path)
    wanted = np.array([rig.wanted(time_s)[JOINT] for time_s in times_s[100:]])
    followed = rig.path[100:, PLACE]
    errors = {lag: np.abs(followed[lag:] - wanted[: len(wanted) - lag]).max() for lag in range(12)}
    assert min(errors.values()) < 0.06 and min(errors, key=lambda lag: errors[lag]) * PERIOD_S <= 0.08
    rig.check_motion()
    assert rig.controller.phase is HostPhase.FOLLOWING and caplog.text == ""


def test_the_arm_arrives_at_the_last_command_and_approaches_the_next_one_slowly(
    caplog: pytest.LogCaptureFixture,
) -> None:
    rig = swinging()
    silence_s = (1.35, 1.7)
    rig.reaches = lambda time_s: not silence_s[0] <= time_s < silence_s[1]
    rig.stack.run(silence_s[0] - rig.stack.clock.now())
    assert moving(rig)
    rig.stack.run(MAX_SILENCE_S)
    assert not moving(rig, 5)
    rig.stack.run(silence_s[1] + 0.1 - rig.stack.clock.now())
    assert rig.controller.phase is HostPhase.APPROACHING
    assert caplog.text.count("the first command would move shoulder_pan by") == 1
    speed = np.abs(np.diff(rig.path[-9:, PLACE])).max() / PERIOD_S
    assert speed == pytest.approx(0.1 * rig.limits[PLACE].velocity, rel=1e-6)
    rig.check_motion()


def test_silence_on_the_way_stops_the_arm(caplog: pytest.LogCaptureFixture) -> None:
    rig = swinging()
    middle = rig.wanted(0.0)
    far = {**middle, JOINT: middle[JOINT] + 1.5}
    rig.wanted = lambda time_s: far if time_s > 1.0 else middle
    rig.reaches = lambda time_s: time_s <= 1.05
    rig.stack.run(1.7 - rig.stack.clock.now())
    assert rig.controller.phase is HostPhase.HOLDING and not moving(rig, 5)
    assert rig.path[-1, PLACE] < far[JOINT] - 0.3
    assert "no command for 0.2 s while shoulder_pan was" in caplog.text
    assert caplog.text.count("brakes and holds its position until the next command") == 1
    rig.check_motion()


def test_silence_at_the_command_is_normal(caplog: pytest.LogCaptureFixture) -> None:
    rig = swinging()
    middle = rig.wanted(0.0)
    rig.wanted = lambda time_s: middle
    rig.stack.run(1.0)
    rig.reaches = lambda time_s: time_s > 3.0
    rig.stack.run(4.0)
    assert rig.controller.phase is HostPhase.FOLLOWING and caplog.text == ""


def test_the_arm_stops_when_the_sender_leaves(caplog: pytest.LogCaptureFixture) -> None:
    rig = swinging()
    rig.stack.run(1.4 - rig.stack.clock.now())
    rig.reaches = lambda time_s: False
    rig.controller.lose("the sender of /commands has left")
    rig.stack.run(0.02)
    assert rig.controller.phase is HostPhase.HOLDING
    rig.stack.run(0.25)
    assert not moving(rig, 5)
    assert "the sender of /commands has left: the arm brakes and holds" in caplog.text
    rig.check_motion()


@pytest.mark.parametrize(
    ("changed", "refused"),
    [
        (lambda m: replace(m, position=m.position[:2]), True),
        (lambda m: replace(m, name=("other", *m.name[1:])), True),
        (lambda m: replace(m, position=(math.inf,) * len(m.position)), True),
        (lambda m: replace(m, position=(math.nan,) * len(m.position)), False),
        (lambda m: replace(m, position=(math.nan, *m.position[1:])), False),
    ],
    ids=["short", "unknown", "infinite", "NaN", "one NaN"],
)
def test_a_few_wrong_messages_change_nothing_and_more_of_them_stop_the_joint(
    changed: Changed, refused: bool, caplog: pytest.LogCaptureFixture
) -> None:
    rig = swinging()
    wrong_s = (1.3, 1.35)
    rig.passes = lambda time_s, message: changed(message) if wrong_s[0] <= time_s < wrong_s[1] else message
    rig.stack.run(1.5 - rig.stack.clock.now())
    assert bool(rig.refused) == refused
    assert rig.controller.phase is HostPhase.FOLLOWING and caplog.text == ""
    wrong_s = (1.4, 9.0)
    rig.stack.run(0.5)
    assert not moving(rig, 5)
    rig.check_motion()


def test_a_silent_servo_stops_the_arm_and_a_short_loss_does_not(caplog: pytest.LogCaptureFixture) -> None:
    rig = swinging()
    rig.stack.run(1.3 - rig.stack.clock.now())
    rig.stack.bus.faults.silence(3)
    rig.stack.run(0.05)
    rig.stack.bus.faults.restore(3)
    rig.stack.run(0.05)
    assert rig.controller.phase is HostPhase.FOLLOWING and "holds" not in caplog.text
    rig.stack.bus.faults.silence(3)
    rig.stack.run(0.5)
    assert rig.controller.phase is HostPhase.HOLDING and not moving(rig, 5)
    assert "servo 3" in rig.controller.reason
    rig.stack.bus.faults.restore(3)
    rig.stack.run(2.0)
    assert rig.controller.phase is not HostPhase.HOLDING
    rig.check_motion()


def test_a_far_first_command_is_approached_slowly_and_then_followed(caplog: pytest.LogCaptureFixture) -> None:
    rig = swinging()
    far = {**rig.wanted(0.0), JOINT: rig.wanted(0.0)[JOINT] + 0.5}
    rig.wanted = lambda time_s: far
    rig.stack.run(1.0)
    assert rig.controller.phase is HostPhase.APPROACHING
    assert "the first command would move shoulder_pan by +0.500 (from" in caplog.text
    rig.stack.run(4.0)
    assert rig.path[-1, PLACE] == pytest.approx(far[JOINT])
    rig.check_motion()
    speed = np.abs(np.diff(rig.path[:, PLACE])).max() / PERIOD_S
    assert speed == pytest.approx(0.1 * rig.limits[PLACE].velocity, rel=1e-6)


def test_a_far_first_command_of_a_joint_without_limits_is_approached_slowly() -> None:
    endless = JointLimits(-math.inf, math.inf, 4.0, 12.0, 120.0)
    controller = HostController("host", ("wheel",), (endless,), ("wheel",))
    state = JointState(0.0, np.zeros(1), np.zeros(1), np.zeros(1))
    controller.activate(state, np.zeros(1))
    controller.submit(["wheel"], [3.0])
    controller.update(state, 0.0, PERIOD_S)
    assert controller.phase is HostPhase.APPROACHING


@pytest.mark.slow
def test_a_minute_at_100_hz_with_every_disturbance() -> None:
    """Missing messages, NaN, wrong lengths, and the loss of the sender or a servo cause no jump, and every command is
    reached."""
    rig, chance = swinging(), np.random.default_rng(41)
    disturbed = {second: chance.uniform(0.05, 0.6) for second in range(4, 56, 4)}
    nan, short = (lambda m: replace(m, position=(math.nan,) * 6)), (lambda m: replace(m, position=m.position[:3]))

    def since(time_s: float, kind: int) -> bool:
        second = int(time_s) // 4 * 4
        return second in disturbed and second // 4 % 5 == kind and time_s - second < disturbed[second]

    rig.reaches = lambda time_s: not since(time_s, 0)
    rig.passes = lambda time_s, m: nan(m) if since(time_s, 1) else short(m) if since(time_s, 2) else m
    for _ in range(600):
        rig.stack.run(0.1)
        now_s = rig.stack.clock.now()
        (rig.stack.bus.faults.silence if since(now_s, 3) else rig.stack.bus.faults.restore)(3)
        if since(now_s, 4):
            rig.controller.lose("the sender has left")
    rig.check_motion()
    middle = rig.wanted(0.0)
    rig.wanted = lambda time_s: middle
    rig.stack.run(3.0)
    ends = [np.clip(middle[joint], one.lower, one.upper) for joint, one in zip(rig.joints, rig.limits, strict=True)]
    assert rig.path[-1] == pytest.approx(ends)
    assert rig.refused and rig.messages > 6000
