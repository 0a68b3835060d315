"""Tests of ``SlowArm``: interruptions while torque is being enabled, and servos that are silent for a moment."""

from dataclasses import replace
from itertools import count

import pytest

from commissioning.commissioning_errors import CalibrationError
from commissioning.slow_arm import PERIOD_S, SlowArm, StoppedError
from drivers.driver_errors import ServoSilent
from drivers.servos import sts, x
from drivers.servos.catalog import series_of
from drivers.servos.register import ServoModel
from hal.hal_errors import ActivationError
from hal.joint import Joint
from tests.commissioning.interrupted import LIMITS, SILENT_S, Interrupted
from tests.commissioning.loose import Cut, Loose, interrupt

ENTERED = 60
"""A number that exceeds the number of packets of the activation."""
MOMENTS_S = [share * PERIOD_S for share in (0.0, 0.25, 0.5, 0.75)]
"""Times within a cycle at which a silence begins, in seconds."""


def test_an_interrupt_during_activation_releases_the_arm() -> None:
    for at in range(1, ENTERED):
        loose = Loose(sts.STS3215)
        loose.port.before_write = Cut(at, interrupt)
        try:
            with SlowArm(lambda bench=loose: bench.bus, [Joint("jaw", 1, sts.STS3215, LIMITS)], loose.clock) as arm:
                loose.port.before_write = lambda data: None
                assert loose.left[0] == 1
                arm.relax = True
            return
        except KeyboardInterrupt:
            assert loose.left[0] == 0, f"torque is on behind packet {at}"
    pytest.fail("it never began")


def go(bench: Interrupted, after_s: float, silent_s: float) -> None:
    """Move the first joint while the second servo is silent."""
    with SlowArm(lambda: bench.bus, bench.joints, bench.clock) as arm:
        bench.silence(after_s, silent_s)
        arm.go(0, 0.2)


@pytest.mark.parametrize("after_s", MOMENTS_S)
@pytest.mark.parametrize("model", [sts.STS3215, x.XL430_W250], ids=lambda model: model.name)
def test_a_servo_may_be_silent_for_a_moment(model: ServoModel, after_s: float) -> None:
    go(Interrupted(model), after_s, SILENT_S)


@pytest.mark.parametrize("model", [sts.STS3215, x.XL430_W250], ids=lambda model: model.name)
def test_a_servo_that_stays_silent_stops_the_arm(model: ServoModel) -> None:
    bench = Interrupted(model)
    with pytest.raises(StoppedError, match=r"joint2: servo 2"):
        go(bench, 0.0, 2.0)
    torque = series_of(model).torque_enable
    assert not any(servo.memory.get(torque) for servo in bench.line.servos)


def test_an_error_is_kept_if_the_torque_of_a_servo_may_still_be_on() -> None:
    bench = Interrupted(sts.STS3215)
    with pytest.raises(CalibrationError, match="joint1") as kept, SlowArm(lambda: bench.bus, bench.joints, bench.clock):
        bench.silence(0.0, 100.0)
        raise CalibrationError("joint1 (servo 1) is blocked")
    assert kept.value.__notes__[0].startswith("torque may still be on: servo 2")


def test_the_message_of_a_stop_does_not_promise_that_all_torque_is_off() -> None:
    bench = Interrupted(sts.STS3215)
    stopped = False
    with (
        pytest.raises(StoppedError, match=r"^torque may still be on: servo 2"),
        SlowArm(lambda: bench.bus, bench.joints, bench.clock, lambda: stopped) as arm,
    ):
        bench.silence(0.0, 100.0)
        stopped = True
        arm.rest(1.0)


def limits(bench: Interrupted) -> list[int]:
    """Return the torque limits that the servos keep in RAM."""
    register = series_of(bench.joints[0].model).torque_limit
    assert register is not None
    return [servo.memory.get(register) for servo in bench.line.servos]


@pytest.mark.parametrize("model", [sts.STS3215, x.XL430_W250], ids=lambda model: model.name)
def test_limp_servos_have_their_torque_limits_again(model: ServoModel) -> None:
    """Otherwise, a servo whose torque is enabled later would hold its load with 6 % of its torque."""
    bench = Interrupted(model)
    full = limits(bench)
    bench.joints[0] = replace(bench.joints[0], torque_limit=0.5)
    with SlowArm(lambda: bench.bus, bench.joints, bench.clock):
        pass
    assert limits(bench) == [round(0.5 * full[0]), full[1] - 1, full[2] - 1]


def test_a_servo_whose_torque_stays_on_keeps_its_low_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Interrupted(sts.STS3215)
    monkeypatch.setattr(bench.bus, "torque_off", lambda ids: [ServoSilent(ids[0], "does not respond")])
    with (
        pytest.raises(StoppedError, match="torque may still be on"),
        SlowArm(lambda: bench.bus, bench.joints, bench.clock),
    ):
        pass
    assert limits(bench) == [60, 60, 60]


@pytest.mark.parametrize("second_s", [0.0, 0.2, 0.41, 1.5])
def test_a_second_request_to_stop_ends_the_lowering_and_disables_the_torque(second_s: float) -> None:
    """The program exits one second after a second signal."""
    bench = Interrupted(sts.STS3215)
    full = limits(bench)
    with SlowArm(lambda: bench.bus, bench.joints, bench.clock) as arm:
        at_s = bench.clock.now() + second_s
        arm.stopped = lambda: 1 + (bench.clock.now() >= at_s)
    assert bench.clock.now() < at_s + 0.2
    assert not any(servo.memory.get(sts.torque_enable) for servo in bench.line.servos)
    assert limits(bench) == [limit - 1 for limit in full]


def test_an_interrupt_during_the_lowering_disables_the_torque() -> None:
    loose = Loose(sts.STS3215)
    with (
        pytest.raises(KeyboardInterrupt),
        SlowArm(lambda: loose.bus, [Joint("jaw", 1, sts.STS3215, LIMITS)], loose.clock),
    ):
        loose.port.before_write = Cut(3, interrupt)
    assert loose.left[0] == 0


@pytest.mark.parametrize("calls", [1, 2])
def test_a_request_to_stop_before_the_activation_leaves_the_torque_off(calls: int) -> None:
    bench, asked = Interrupted(sts.STS3215), count(1)
    torque: list[int] = []

    def watch(servo_id: int) -> bool:
        torque.extend(servo.memory.get(sts.torque_enable) for servo in bench.line.servos)
        return True

    bench.line.faults.on_instruction.append(watch)
    with (
        pytest.raises(StoppedError, match="stopped: the arm was not moved"),
        SlowArm(lambda: bench.bus, bench.joints, bench.clock, lambda: next(asked) >= calls),
    ):
        pass
    assert not any(torque)


def test_a_servo_that_keeps_its_torque_after_a_failed_activation_is_named() -> None:
    """The servo falls silent when all servos have torque, but before the activation is complete."""
    bench = Interrupted(sts.STS3215)
    memories = [servo.memory for servo in bench.line.servos]

    instructions = count()

    def silence(servo_id: int) -> bool:
        if all(memory.get(sts.torque_enable) for memory in memories) and next(instructions) == 15:
            bench.silence(0.0, 10.0)
        return True

    bench.line.faults.on_instruction.insert(0, silence)
    with pytest.raises(ActivationError) as failed, SlowArm(lambda: bench.bus, bench.joints, bench.clock):
        pass
    assert [memory.get(sts.torque_enable) for memory in memories] == [0, 1, 0]
    (note,) = failed.value.__notes__
    assert note.startswith("torque may still be on: servo 2: does not respond")


@pytest.mark.parametrize("moment", ["lowering", "torque off", "limits"])
def test_an_interrupt_at_the_end_names_the_servos_whose_torque_may_still_be_on(
    moment: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Interrupted(sts.STS3215)

    def once(*args: object) -> None:
        monkeypatch.undo()
        interrupt()

    with (
        pytest.raises(KeyboardInterrupt) as caught,
        SlowArm(lambda: bench.bus, bench.joints, bench.clock) as arm,
    ):
        bench.silence(0.0, 100.0)
        target = {"lowering": bench.clock, "torque off": bench.bus, "limits": bench.bus}[moment]
        method = {"lowering": "sleep_until", "torque off": "torque_off", "limits": "torque_is_on"}[moment]
        monkeypatch.setattr(target, method, once)
    (note,) = caught.value.__notes__
    assert note.startswith("torque may still be on: ") and "servo 2" in note
    assert arm.torque_left
    held = [servo.memory.get(sts.torque_enable) for servo in bench.line.servos]
    assert held == ([1, 1, 1] if moment == "torque off" else [0, 1, 0])


def test_a_servo_that_keeps_its_torque_after_an_activation_that_fails_halfway_is_named() -> None:
    bench = Interrupted(sts.STS3215)
    second = bench.line.servos[1].memory
    bench.line.faults.on_instruction.insert(0, lambda servo_id: servo_id != 2 or not second.get(sts.torque_enable))
    arm = SlowArm(lambda: bench.bus, bench.joints, bench.clock)
    with pytest.raises(ServoSilent) as failed, arm:
        pass
    assert [servo.memory.get(sts.torque_enable) for servo in bench.line.servos] == [0, 1, 0]
    (note,) = failed.value.__notes__
    assert note.startswith("torque may still be on: servo 2: does not respond")
    assert arm.torque_left
