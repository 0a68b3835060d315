"""A servo that has lost its torque is activated again while its component is active and the other servos hold."""

from collections.abc import Sequence

import numpy as np
import pytest

from controller.action_goals import GoalStatus
from controller.component_transitions import ComponentTransition
from drivers.servos import sts
from drivers.servos.catalog import series_of
from drivers.servos.register import Register
from hal.hal_errors import ActivationError
from hal.lifecycle import LifecycleState
from hal.servos.servo_hardware import ServoHardware
from sim_backend.faults.text import parse
from tests.faults.rig import FaultRig
from tests.stack.rig import READY

ACTIVE = LifecycleState.ACTIVE


def lost(fault: str, arm: str = "robot_arm") -> FaultRig:
    """Return an arm that holds its position, with one servo that was reset and has no torque."""
    rig = FaultRig(arm)
    rig.up()
    rig.endure(0.5)
    rig.play(parse(fault))
    rig.endure(3.0, lambda: rig.says("activate again"))
    assert rig.says("activate again")
    rig.endure(0.5)
    return rig


def activated(rig: FaultRig) -> ComponentTransition:
    change = rig.loop.component_transitions.ask(rig.made[0].name, ACTIVE)
    rig.endure(2.0, lambda: change.done)
    assert change.done
    return change


def controllers(rig: FaultRig) -> list[str]:
    return [entry.spec.name for entry in rig.manager.registry.running]


def test_a_second_request_after_a_failed_activation_resumes_the_controllers(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = lost("brown_out id=4")
    running, reactivate, calls = controllers(rig), ServoHardware.reactivate, 0

    def fails_once(hardware: ServoHardware) -> frozenset[str]:
        nonlocal calls
        calls += 1
        if calls == 1:
            raise ActivationError("joint4: servo 4 does not respond")
        return reactivate(hardware)

    monkeypatch.setattr(ServoHardware, "reactivate", fails_once)
    first, second = (rig.loop.component_transitions.ask(rig.made[0].name, ACTIVE) for _ in range(2))
    rig.endure(3.0, lambda: second.done)
    with pytest.raises(ActivationError, match="does not respond"):
        first.result()
    second.result()
    assert calls == 2
    assert controllers(rig) == running


@pytest.mark.parametrize(("arm", "servo_id"), [("robot_arm", 4), ("robot_arm", 5), ("robot_arm_dynamixel", 3)])
def test_one_request_reactivates_a_reset_servo_without_motion(arm: str, servo_id: int) -> None:
    rig = lost(f"brown_out id={servo_id}", arm)
    running = controllers(rig)
    before = rig.world.position().copy()
    activated(rig).result()
    assert controllers(rig) == running, "those that ended meanwhile have begun again"
    assert rig.says("torque is enabled again, and the joint holds its position")
    rig.endure(1.0)
    np.testing.assert_allclose(rig.world.position()[:6], before[:6], atol=0.03)  # it sags a little
    assert rig.hardware.read().faults == {}
    handle = rig.go(READY, 1.5)
    rig.endure(5.0, lambda: handle.status is not GoalStatus.EXECUTING)
    assert handle.status is GoalStatus.SUCCEEDED, handle.error_text


def test_reactivation_causes_no_jump_of_the_goal() -> None:
    rig = lost("brown_out id=2")
    limits = np.array([joint.limits.velocity for joint in rig.files.robot.joints])
    sent: list[Sequence[float]] = []
    write = rig.loop.hardware.write

    def note(values: np.ndarray, period_s: float) -> None:
        sent.append(values.copy())
        write(values, period_s)

    rig.loop.hardware.write = note  # type: ignore[method-assign]
    limp = rig.world.position()[1]
    activated(rig).result()
    rig.endure(0.5)
    steps = np.abs(np.diff(np.array(sent), axis=0))
    others = [i for i in range(len(limits)) if i != 1]
    assert (steps[:, others] <= 1e-6).all(), "the other joints hold their commands"
    assert sent[-1][1] == pytest.approx(limp, abs=0.02)


@pytest.mark.parametrize(
    ("register", "value", "says"),
    [(sts.operating_mode, 1, "is not in position mode"), (sts.max_position, 2100, "has position limits ")],
)
def test_servo_with_wrong_settings_stays_limp_and_others_hold(register: Register, value: int, says: str) -> None:
    rig = lost("brown_out id=3")
    rig.bus.servo(3).memory.put(register, value)
    running = controllers(rig)
    with pytest.raises(ActivationError, match=rf"^not activated: joint3: servo 3: {says}"):
        activated(rig).result()
    assert (rig.made[0].state, controllers(rig)) == (ACTIVE, running)
    assert "joint3" in rig.hardware.read().faults
    assert [servo.servo_id for servo in rig.bus.servos if servo.memory.get(sts.torque_enable)] == [1, 2, 4, 5, 6, 7]
    handle = rig.go([0.1] * 6, 1.5)
    rig.endure(1.0)
    assert handle.status is GoalStatus.ABORTED
    assert "servo 3 returned with its torque disabled" in handle.error_text


def test_reactivation_reports_silent_servo_and_changes_nothing_else() -> None:
    rig = FaultRig()
    rig.up()
    rig.endure(0.5)
    rig.play(parse("silent id=3"))
    rig.endure(0.5)
    with pytest.raises(ActivationError, match="joint3: servo 3 does not respond"):
        activated(rig).result()
    assert rig.made[0].state is ACTIVE


@pytest.mark.parametrize(("arm", "servo_id"), [("robot_arm", 4), ("robot_arm", 7), ("robot_arm_dynamixel", 3)])
@pytest.mark.parametrize("after_s", [0.0, 0.1, 0.3])
def test_request_detects_torque_lost_just_before(arm: str, servo_id: int, after_s: float) -> None:
    rig = FaultRig(arm)
    rig.up()
    rig.endure(0.5)
    servo = rig.bus.servo(servo_id)
    servo.power_cycle()
    rig.endure(after_s)
    activated(rig).result()
    assert rig.says("torque is enabled again, and the joint holds its position")
    assert servo.memory.get(series_of(servo.model).torque_enable) == 1
    rig.endure(1.0)
    assert rig.hardware.read().faults == {}


def test_request_reports_servo_that_has_just_become_silent() -> None:
    rig = FaultRig()
    rig.up()
    rig.endure(0.5)
    rig.bus.faults.silence(3)
    with pytest.raises(ActivationError, match="joint3: servo 3 does not respond"):
        activated(rig).result()
    assert rig.made[0].state is ACTIVE


def test_lost_reply_to_torque_check_costs_one_cycle_but_no_torque() -> None:
    rig = FaultRig()
    rig.up()
    rig.endure(0.5)
    running = controllers(rig)
    rig.bus.faults.corrupt_next(3)
    activated(rig).result()
    assert controllers(rig) == running
    assert not rig.says("torque is enabled again")


def test_component_without_faults_is_unchanged() -> None:
    rig = FaultRig()
    rig.up()
    handle = rig.go([0.2] * 6, 1.5)
    rig.endure(0.3)
    activated(rig).result()
    rig.endure(2.5)
    assert handle.status is GoalStatus.SUCCEEDED
