"""Behavior of ``Arm`` that is the same for every kind of connection. A test module must derive its test classes from
``ArmContract``."""

import asyncio
import math
import re
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hal.types import AT_LIMIT
from servoloop import (
    Arm,
    ArmBusyError,
    ArmInputError,
    ArmState,
    ArmTimeoutError,
    ArmTrajectory,
    MotionCanceledError,
    PlanFailedError,
    StreamEndedError,
)
from servoloop.recording.reader import read_recording

NEAR = 0.05
"""Maximum distance of a joint from its target, in rad."""
BAD_TARGETS: dict[str, tuple[Any, dict[str, Any], str]] = {
    "unknown joint": ({"elbow": 0.1}, {}, "so101 has no joint 'elbow': its joints are shoulder_pan, shoulder_lift"),
    "unknown pose": ("nowhere", {}, "there is no pose nowhere"),
    "NaN": ({"elbow_flex": math.nan}, {}, "elbow_flex: position nan is not finite"),
    "beyond a limit": ({"elbow_flex": 9.0}, {}, "elbow_flex: position 9.0000 is outside the limits -1.6"),
    "gripper beyond a limit": ({"gripper": -3.0}, {}, "gripper: position -3.0000 is outside the limits"),
    "more than a float": ({"elbow_flex": -(10**400)}, {}, "elbow_flex: position -inf is not finite"),
    "text": ({"elbow_flex": "up"}, {}, "elbow_flex: 'up' is not a number"),
    "number as text": ({"elbow_flex": "0.1"}, {}, "elbow_flex: '0.1' is not a number"),
    "truth value": ({"elbow_flex": True}, {}, "elbow_flex: True is not a number"),
    "truth values": (np.zeros(6, dtype=bool), {}, "is not a number: use a position in rad or m"),
    "set": ({0.0, 0.1, 0.2, 0.3, 0.4, 0.5}, {}, "is not a target: use positions keyed by joint name, or an array"),
    "more time than a float": ({"elbow_flex": 0.1}, {"duration": 10**400}, "duration must be a finite time above 0 s"),
    "time as text": ({"elbow_flex": 0.1}, {"duration": "1"}, "duration must be a number, not '1'"),
    "speed as text": ({"elbow_flex": 0.1}, {"speed": "fast"}, "speed must be a number, not 'fast'"),
    "no number as timeout": ({"elbow_flex": 0.1}, {"timeout": math.nan}, "timeout must be a time in seconds, not nan"),
    "short array": ([0.0, 0.0], {}, "needs 6 values, one for each of shoulder_pan"),
    "number": (0.5, {}, "0.5 is not a target"),
    "nothing": ({}, {}, "no joint is specified"),
    "no time": ({"elbow_flex": 0.1}, {"duration": 0.0}, "duration must be a finite time above 0 s, not 0.0"),
    "infinite time": ({"elbow_flex": 0.1}, {"duration": math.inf}, "duration must be a finite time above 0 s, not inf"),
    "too fast": ({"elbow_flex": 0.1}, {"speed": 1.5}, "speed must be above 0 and at most 1"),
    "both": ({"elbow_flex": 0.1}, {"speed": 0.5, "duration": 1.0}, "duration and speed cannot be combined"),
}
PAN = "shoulder_pan"


def moved(arm: Arm, action: Callable[[], object]) -> float:
    """Return the largest change of a joint's command caused by an action, in rad. The change is measured a few cycles
    after the action."""
    before = arm.state.command
    action()
    after = arm.step(3).command
    return max(abs(after[joint] - before[joint]) for joint in arm.joints)


def policy_waits_s(arm: Arm, targets: int) -> list[float]:
    """Stream targets at 50 Hz and check that the last target is commanded. For each target, return the time until a
    state contains its command, in seconds."""
    arm.move_to({PAN: 0.0}, speed=0.5)
    sent: dict[float, float] = {}
    seen: dict[float, float] = {}
    end = arm.on_state(lambda state: seen.setdefault(round(state.command[PAN], 6), time.monotonic()))
    with arm.stream() as stream:
        for number in range(targets):
            target = round(0.0004 * number, 6)
            sent[target] = time.monotonic()
            stream.send({PAN: target})
            arm.sleep(0.02)
        arm.step(2)
        assert arm.state.command[PAN] == pytest.approx(target, abs=1e-6)
    end()
    return [seen[target] - sent[target] for target in sent.keys() & seen.keys()]


class ArmContract:
    """Contract of all arms. A subclass defines the fixture ``arm``, an active SO-101."""

    def test_a_motion_is_planned_from_the_measured_state(self, arm: Arm) -> None:
        before = arm.state.position
        arm.move_to({PAN: 0.2, "shoulder_lift": -0.3, "elbow_flex": 0.3}, duration=2.0)
        plan = arm.plan({PAN: -0.2}, speed=0.5)
        assert plan.start == pytest.approx(arm.state.position, abs=NEAR)
        arm.follow(plan)
        assert arm.state.position[PAN] == pytest.approx(-0.2, abs=NEAR)
        with pytest.raises(PlanFailedError, match=f"{PAN} is at"):
            arm.follow(plan)
        arm.move_to(before, duration=2.0)

    def test_joints_reach_named_targets_and_others_hold(self, arm: Arm) -> None:
        before = arm.state
        arm.move_to({PAN: 0.3, "elbow_flex": 1.3}, duration=1.0)
        after = arm.state
        assert after.position[PAN] == pytest.approx(0.3, abs=NEAR)
        assert after.position["elbow_flex"] == pytest.approx(1.3, abs=NEAR)
        assert after.position["shoulder_lift"] == pytest.approx(before.position["shoulder_lift"], abs=NEAR)

    def test_a_joint_that_was_measured_beyond_its_limit_can_be_sent_there(self, arm: Arm) -> None:
        limit, before = arm.limits[PAN], arm.state.position
        tolerated = AT_LIMIT * (limit.upper - limit.lower)
        arm.move_to({PAN: limit.upper + 0.9 * tolerated}, duration=4.0)
        assert arm.state.command[PAN] == pytest.approx(limit.upper)
        with pytest.raises(ArmInputError, match="outside the limits"):
            arm.move_to({PAN: limit.upper + 2.0 * tolerated}, duration=4.0)
        arm.move_to(before, duration=4.0)

    @pytest.mark.parametrize("value", ["off", 1, None, np.True_])
    def test_torque_accepts_only_true_or_false(self, arm: Arm, value: Any) -> None:
        with pytest.raises(
            ArmInputError, match=f"on must be True or False, not {re.escape(repr(value))}: pass a Boolean"
        ):
            arm.torque(value)
        with pytest.raises(ArmInputError, match="park must be True or False"):
            arm.torque(True, park=value)

    def test_an_input_error_has_one_traceback(self, arm: Arm) -> None:
        with pytest.raises(ArmInputError) as error:
            arm.move_to({PAN: 99.0})
        assert error.value.__cause__ is None and (error.value.__suppress_context__ or error.value.__context__ is None)

    def test_an_array_has_one_position_for_each_joint(self, arm: Arm) -> None:
        target = np.array([0.2, -1.6, 1.2, 0.8, 0.1, 0.4])
        arm.move_to(target, speed=0.6)
        assert arm.joints[0] == PAN and arm.joints[-1] == "gripper"
        assert [*arm.state.position.values()] == pytest.approx(target, abs=NEAR)

    def test_a_motion_can_be_waited_for_with_a_limit_and_canceled(self, arm: Arm) -> None:
        motion = arm.move_to({PAN: -0.5}, duration=3.0, wait=False)
        with pytest.raises(ArmTimeoutError, match=r"did not end within 0\.3 s"):
            motion.wait(0.3)
        assert not motion.done
        motion.cancel()
        with pytest.raises(MotionCanceledError, match="was canceled"):
            motion.wait(2.0)
        assert arm.state.position[PAN] > -0.4
        motion.cancel()  # no effect, because the motion has ended

    def test_a_new_motion_replaces_the_former(self, arm: Arm) -> None:
        first = arm.move_to({PAN: 0.6, "gripper": 1.0}, duration=3.0, wait=False)
        arm.sleep(0.3)
        arm.move_to({PAN: 0.0, "gripper": 0.2}, duration=0.8)
        with pytest.raises(MotionCanceledError, match="another motion has replaced"):
            first.wait(1.0)
        assert arm.state.position[PAN] == pytest.approx(0.0, abs=NEAR)

    def test_the_gripper_opens_and_closes(self, arm: Arm) -> None:
        arm.gripper.open(speed=0.5)
        opened = arm.state.position["gripper"]
        arm.gripper.close(duration=0.5)
        assert opened > arm.state.position["gripper"] + 0.5
        arm.gripper.move(0.3)
        assert arm.state.position["gripper"] == pytest.approx(0.3, abs=NEAR)

    @pytest.mark.parametrize(("target", "options", "message"), BAD_TARGETS.values(), ids=BAD_TARGETS)
    def test_a_bad_target_is_explained_and_moves_nothing(
        self, arm: Arm, target: Any, options: dict[str, Any], message: str
    ) -> None:
        arm.stop()
        arm.step(3)

        def move() -> None:
            with pytest.raises(ArmInputError) as caught:
                arm.move_to(target, **options)
            assert message in str(caught.value)
            assert caught.value.joint in ("", *target) if isinstance(target, dict) else True

        assert moved(arm, move) < 1e-6

    def test_a_trajectory_is_followed_after_a_slow_approach(self, arm: Arm) -> None:
        arm.move_to({PAN: 0.0}, speed=0.5)
        seen: list[ArmState] = []
        end = arm.on_state(seen.append)
        arm.follow(ArmTrajectory([0.0, 0.5, 1.0], {PAN: [0.4, 0.2, 0.3]}))
        end()
        pan = [state.position[PAN] for state in seen]
        assert max(pan) == pytest.approx(0.4, abs=NEAR) and pan[-1] == pytest.approx(0.3, abs=NEAR)
        fastest = max(abs(b.command[PAN] - a.command[PAN]) for a, b in pairwise(seen))
        assert fastest * arm.rate_hz < arm.limits[PAN].velocity

    @pytest.mark.parametrize(
        ("trajectory", "message"),
        [
            (ArmTrajectory([0.0, 1.0], {PAN: [0.0]}), "2 times, but 1 rows"),
            (ArmTrajectory([1.0, 0.5], {PAN: [0.0, 0.1]}), "times must increase"),
            (ArmTrajectory([0.0, 1.0], {PAN: [0.0, 9.0]}), "shoulder_pan: position 9.0000 at point 1 is outside"),
            (ArmTrajectory([], {PAN: []}), "has no points"),
            (ArmTrajectory([0.0, 1.0], {PAN: [0.0, 0.1]}, {"elbow_flex": [0.0, 0.0]}), "but no velocities"),
            (
                ArmTrajectory([0.0, 1.0], {PAN: [0.0, 0.1]}, {PAN: [0.0, 0.0], "elbow_flex": [0.0, 0.0]}),
                "elbow_flex has velocities but no positions",
            ),
            (ArmTrajectory(["a", 1.0], {PAN: [0.0, 0.1]}), "a time of the trajectory must be a number, not 'a'"),  # type: ignore[list-item]
            (ArmTrajectory(1.0, {PAN: [0.0]}), "the times of the trajectory must be a sequence, not 1.0"),  # type: ignore[arg-type]
            (ArmTrajectory([1.0], {PAN: 0.1}), "the values of shoulder_pan must be a sequence, not 0.1"),  # type: ignore[dict-item]
            (ArmTrajectory([0.0, 1.0], [0.0, 0.1]), "keyed by joint name, not \\[0.0, 0.1\\]"),  # type: ignore[arg-type]
        ],
        ids=[
            *("rows", "times", "limits", "empty", "velocities", "other velocities"),
            *("text as time", "one time", "one position", "no names"),
        ],
    )
    def test_a_bad_trajectory_is_explained(self, arm: Arm, trajectory: ArmTrajectory, message: str) -> None:
        with pytest.raises(ArmInputError, match=message):
            arm.follow(trajectory)

    def test_a_stream_follows_its_targets_and_holds_the_last(self, arm: Arm) -> None:
        arm.move_to({PAN: 0.0}, speed=0.5)
        with arm.stream(max_age=1.0) as stream:
            for number in range(25):
                stream.send({PAN: 0.01 * number})
                arm.sleep(0.02)
            arm.sleep(0.3)
            assert arm.state.command[PAN] == pytest.approx(0.24, abs=1e-6)
            stream.send({"gripper": 0.5})
            arm.step(2)
            assert arm.state.command[PAN] == pytest.approx(0.24, abs=1e-6)
        assert arm.step(3).position[PAN] == pytest.approx(0.24, abs=NEAR)

    def test_a_stream_that_stops_ends_and_the_arm_holds(self, arm: Arm) -> None:
        with arm.stream(max_age=0.15) as stream:
            stream.send({PAN: 0.1})
            arm.sleep(0.5)
            with pytest.raises(StreamEndedError, match=r"no target arrived for 0\.15 s"):
                stream.send({PAN: 0.2})
        arm.move_to({PAN: 0.15}, duration=0.5)
        assert arm.state.position[PAN] == pytest.approx(0.15, abs=NEAR)

    def test_a_bad_target_in_a_stream_is_explained_and_the_last_target_is_held(self, arm: Arm) -> None:
        with arm.stream(max_age=1.0) as stream:
            stream.send({PAN: 0.1})
            for target, message in (({"elbow": 0.0}, "no joint 'elbow'"), ({PAN: math.nan}, "not finite")):
                with pytest.raises(ArmInputError, match=message):
                    stream.send(target)
            with pytest.raises(ArmInputError, match="outside the limits"):
                stream.send([9.0, 0.0, 0.0, 0.0, 0.0, 0.0])
            arm.sleep(0.3)
            assert arm.state.command[PAN] == pytest.approx(0.1, abs=1e-6)
        with pytest.raises(StreamEndedError, match="no stream is open"):
            stream.send({PAN: 0.1})

    def test_a_stream_and_a_motion_exclude_each_other(self, arm: Arm) -> None:
        with arm.stream(), pytest.raises(ArmBusyError, match="a stream is open"):
            arm.move_to({PAN: 0.0})
        motion = arm.move_to({PAN: 0.5}, duration=3.0, wait=False)
        with pytest.raises(ArmBusyError, match="a motion is running"):
            arm.stream()
        motion.cancel()
        with pytest.raises(MotionCanceledError):
            motion.wait(2.0)

    def test_an_iterable_of_targets_is_sent_at_a_rate(self, arm: Arm) -> None:
        arm.move_to({PAN: 0.0}, speed=0.5)
        begun_s = arm.state.time_s
        arm.stream(({PAN: 0.2 * math.sin(number / 8)} for number in range(20)), rate_hz=40.0)
        assert arm.state.time_s - begun_s == pytest.approx(0.5, abs=0.2)
        assert arm.state.command[PAN] > 0.1

    def test_the_state_has_all_joints_in_si_units(self, arm: Arm) -> None:
        state = arm.step(2)
        for values in (state.position, state.velocity, state.effort, state.temperature, state.command):
            assert tuple(values) == arm.joints and all(map(math.isfinite, values.values()))
        assert 0.0 <= state.age_s < 1.0 and 20.0 < state.temperature[PAN] < 50.0
        assert arm.faults == {} and state.faults == {}

    def test_stop_ends_all_motions(self, arm: Arm) -> None:
        motion = arm.move_to({PAN: -0.8, "gripper": 1.2}, duration=3.0, wait=False)
        arm.sleep(0.5)
        arm.stop()
        with pytest.raises(MotionCanceledError):
            motion.wait(2.0)
        arm.sleep(0.5)
        still = arm.state.command
        assert arm.step(3).command == pytest.approx(still, abs=1e-6)
        assert still[PAN] > -0.7 and still["gripper"] < 1.1

    def test_motions_can_be_awaited_at_the_same_time_as_other_tasks(self, arm: Arm) -> None:
        async def watch(states: list[ArmState]) -> None:
            async for state in arm.states():
                states.append(state)
                if len(states) == 5:
                    return

        async def both() -> list[ArmState]:
            states: list[ArmState] = []
            motion = arm.move_to({PAN: 0.1}, duration=0.6, wait=False)
            await asyncio.gather(watch(states), motion)
            assert motion.done and motion.failure is None
            return states

        states = asyncio.run(both())
        assert [b.time_s > a.time_s for a, b in pairwise(states)] == [True] * 4

    def test_a_canceled_task_cancels_its_motion(self, arm: Arm) -> None:
        async def run() -> None:
            motion = arm.move_to({PAN: 0.6}, duration=3.0, wait=False)
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(motion.wait_async(), 0.05)
            with pytest.raises(MotionCanceledError):
                await motion

        asyncio.run(run())

    def test_released_servos_refuse_motions_until_torque_is_on_again(self, arm: Arm) -> None:
        arm.torque(False)
        with pytest.raises(ArmBusyError, match=r"pan cannot be moved: its torque is off. Call arm\.torque"):
            arm.move_to({PAN: 0.2})
        arm.torque(True)
        arm.move_to({PAN: 0.2}, duration=0.8)
        assert arm.state.position[PAN] == pytest.approx(0.2, abs=NEAR)

    def test_joints_in_freedrive_refuse_motions_until_it_ends(self, arm: Arm) -> None:
        before = arm.state.command
        with arm.freedrive():
            with pytest.raises(ArmBusyError, match="the arm is in freedrive: end freedrive before you start a motion"):
                arm.move_to({PAN: 0.1})
            with pytest.raises(ArmBusyError, match="in freedrive"), arm.freedrive():
                pass
        after = arm.step(3).command
        assert max(abs(after[joint] - before[joint]) for joint in arm.joints) < NEAR
        arm.move_to({PAN: 0.1}, duration=1.0)
        assert arm.state.position[PAN] == pytest.approx(0.1, abs=NEAR)

    def test_a_part_of_a_run_is_recorded(self, arm: Arm, tmp_path: Path) -> None:
        path = tmp_path / "part.mcap"
        with arm.record(path):
            arm.move_to({PAN: 0.0}, duration=0.5)
            with pytest.raises(ArmInputError, match="exists"), arm.record(path):
                pass
        assert len(read_recording(path).time_s) > 5

    @pytest.mark.parametrize("name", ["r" * 300 + ".mcap", "a\0b.mcap"], ids=["long", "null"])
    def test_a_path_that_cannot_be_recorded_is_explained(self, arm: Arm, tmp_path: Path, name: str) -> None:
        with pytest.raises(ArmInputError, match=r"File name too long|contains a null character"):
            arm.record(tmp_path / name).__enter__()
