"""An arm that is soft holds its position under gravity and follows a hand, on virtual servos."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest

from controller.manager.switch import SwitchRequest
from controller.shutdown import shut_down
from controller.teach.freedrive_controller import FreedriveController, GuidedJoint
from drivers.servos import sts
from drivers.servos.catalog import MODELS
from hal.joint import Joint
from hal.mock_hardware import MockHardware
from hal.servos.soft_torque import SOFT_SHARE
from hal.types import JointFault, JointLimits, JointState
from servoloop.api.arm_errors import ArmBusyError, ArmError
from servoloop.api.backend import ArmState
from servoloop.api.freedrive import FREEDRIVE, Freedrive
from servoloop.api.pace import SimulatedPace
from tests.teach.rig import FREE, SO101, Rig

STRETCHED: Mapping[str, float] = {"shoulder_lift": 0.0, "elbow_flex": -0.5, "wrist_flex": 0.2}
"""Pose with the highest load on the elbow, and half the rated load on the shoulder."""
FOLDED: Mapping[str, float] = {"shoulder_lift": -1.2, "elbow_flex": -0.5, "wrist_flex": 0.2}
"""Pose in which gravity pulls the shoulder backward."""
LIFT, PAN = "shoulder_lift", "shoulder_pan"


def floating(pose: Mapping[str, float]) -> tuple[Rig, FreedriveController]:
    rig = Rig(pose)
    return rig, rig.guided()


@pytest.mark.parametrize("pose", [FREE, STRETCHED, FOLDED])
def test_soft_arm_holds_its_position_without_help(pose: Mapping[str, float]) -> None:
    rig, _ = floating(pose)
    begun = rig.places
    rig.run(8.0)
    assert np.abs(rig.places - begun).max() < 0.02
    limits = {joint.name: joint.torque_limit for joint in SO101.robot.joints}
    for name in rig.names:
        assert rig.register(name, sts.torque_limit) <= round(1000 * SOFT_SHARE * limits[name]), "the limit is lower"


def test_limp_arm_sinks_without_help() -> None:
    rig = Rig(STRETCHED)
    rig.arm.torque(False, park=False)
    begun = rig.places
    rig.run(1.0)
    assert np.abs(rig.places - begun).max() > 0.3


@pytest.mark.parametrize("joint", [PAN, LIFT, "elbow_flex"])
def test_soft_joint_follows_a_light_hand_and_stays_there(joint: str) -> None:
    rig, _ = floating(FREE)
    index, begun_s = rig.names.index(joint), rig.clock.now()
    here = float(rig.places[index])
    pushes: list[float] = []

    def poll() -> bool:
        pushes.append(abs(rig.push(joint)))
        return True

    rig.take_to = lambda time_s: {joint: here - min(0.5 * (time_s - begun_s), 0.5)}
    rig.run(2.0, poll)
    taken = rig.places[index]
    assert taken == pytest.approx(here - 0.5, abs=0.03)
    # According to its data sheet, the servo slips at 0.29 N m. The virtual servo is 1.7 times as strong and has
    # friction.
    assert max(pushes) < 1.0
    rig.take_to = lambda time_s: {}
    rig.run(3.0)
    assert rig.places[index] == pytest.approx(taken, abs=0.04), "it springs back by no more than its slack"


def test_soft_arm_stops_when_it_is_released_in_motion() -> None:
    rig, _ = floating(FREE)
    index, begun_s = rig.names.index(PAN), rig.clock.now()
    rig.take_to = lambda time_s: {PAN: 0.8 * (time_s - begun_s)}
    rig.run(0.6)
    rig.take_to = lambda time_s: {}
    thrown = rig.places[index]
    rig.run(0.3)
    stands = rig.places[index]
    rig.run(2.0)
    assert abs(stands - thrown) < 0.06 and abs(rig.places[index] - stands) < 0.01


def test_push_below_the_threshold_does_not_move_the_set_point() -> None:
    rig, freedrive = floating(FREE)
    index = rig.names.index(PAN)
    here, command = float(rig.places[index]), freedrive.command[index]
    rig.take_to = lambda time_s: {PAN: here + 0.02}
    rig.run(0.5)
    push = rig.push(PAN)
    rig.run(3.0)
    assert freedrive.command[index] == command and 0.1 < push < 0.5
    assert rig.push(PAN) < 1.1 * push, "nothing works against the hand while it stays"
    rig.take_to = lambda time_s: {}
    rig.run(1.0)
    assert rig.places[index] == pytest.approx(here, abs=0.005)


def test_set_points_stay_within_the_limits() -> None:
    rig, freedrive = floating(FREE)
    index, begun_s = rig.names.index("wrist_roll"), rig.clock.now()
    upper = SO101.limits["wrist_roll"].upper
    wanted: list[float] = []

    def poll() -> bool:
        wanted.append(float(freedrive.command[index]))
        return True

    rig.take_to = lambda time_s: {"wrist_roll": min(1.0 * (time_s - begun_s), upper + 0.04)}
    rig.run(4.0, poll)
    assert max(wanted) == pytest.approx(upper, abs=1e-6) and rig.push("wrist_roll") > 0.2, "there it is a wall"


def test_silent_servo_keeps_its_set_point_and_other_joints_stay_soft() -> None:
    rig, freedrive = floating(FREE)
    (line,) = rig.lines.lines.values()
    elbow, begun_s = rig.names.index("elbow_flex"), rig.clock.now()
    here = float(rig.places[elbow])
    rig.take_to = lambda time_s: {
        PAN: 0.4 * (time_s - begun_s),
        "elbow_flex": here - min(0.4 * (time_s - begun_s), 0.3),
    }
    rig.run(0.3)
    line.faults.silence(1)
    commands: list[float] = []

    def poll() -> bool:
        if PAN in rig.states[-1].faults:
            commands.append(float(freedrive.command[0]))
        return True

    rig.run(0.9, poll)
    assert len(commands) > 30 and np.ptp(commands) == 0.0, "whatever it was doing"
    assert rig.places[elbow] == pytest.approx(here - 0.3, abs=0.03)


def test_position_change_during_silence_is_not_a_velocity() -> None:
    joint = GuidedJoint("j", JointLimits(-3.0, 3.0, 20.0, 100.0, 1000.0), 0.03, SO101.robot.joints[0].compliance)
    freedrive, still = FreedriveController("freedrive", [joint], ["j"]), np.zeros(1)

    def cycle(time_s: float, place: float, faults: Mapping[str, JointFault]) -> float:
        freedrive.update(JointState(time_s, np.array([place]), still, still, faults), time_s, 0.02)
        return float(freedrive.command[0])

    freedrive.activate(JointState(0.0, still, still, still), still)
    for number in range(60):
        cycle(0.02 * number, 0.0, {})
    assert freedrive.free
    for number in range(60, 70):
        assert cycle(0.02 * number, 0.0, {"j": JointFault("silent", "j is silent")}) == 0.0
    for number in range(70, 90):
        assert cycle(0.02 * number, 0.3, {}) <= 0.3, "it stands there"


def test_holding_sets_the_set_points_to_the_measured_positions() -> None:
    rig, freedrive = floating(FREE)
    here = float(rig.places[0])
    rig.take_to = lambda time_s: {PAN: here + 0.3}
    rig.run(0.5)
    assert abs(freedrive.command[0] - rig.states[-1].position[0]) > 0.01
    freedrive.holds = True
    rig.run(0.02)
    assert freedrive.held and freedrive.command == pytest.approx(rig.states[-1].position, abs=0.002)
    command = freedrive.command.copy()
    rig.run(0.5)
    assert np.array_equal(freedrive.command, command)


def test_arm_without_gravity_compensation_is_not_made_soft() -> None:
    rig = Rig()

    def refused(joints: tuple[Joint, ...]) -> str:
        stack = replace(rig.stack, files=replace(SO101, robot=replace(SO101.robot, joints=joints)))
        with pytest.raises(ArmError, match=r"disable its torque instead .*, and hold the arm") as error:
            Freedrive(stack, rig.arm.joints, lambda action: action()).begin()
        return str(error.value)

    joints = SO101.robot.joints
    assert "gravity is not compensated" in refused(tuple(replace(one, gravity_compensation=False) for one in joints))
    assert "the stiffness of shoulder_lift is unknown" in refused(
        (joints[0], replace(joints[1], model=MODELS["scs0009"]), *joints[2:])
    )


def test_arm_without_servos_is_not_made_soft() -> None:
    rig = Rig()
    (component,) = rig.loop.hardware.components
    component.hardware = MockHardware("mock", rig.names, rig.clock)
    component.hardware.configure()
    component.hardware.activate()
    with pytest.raises(ArmError, match="gripper have no servo: disable"):
        rig.backend.begin_freedrive()


def limits(rig: Rig) -> list[int]:
    return [rig.register(name, sts.torque_limit) for name in rig.names]


def running(rig: Rig) -> set[str]:
    return {entry.spec.name for entry in rig.loop.manager.registry.running if entry.controller.command_interfaces}


def test_after_freedrive_the_arm_has_its_full_torque_and_its_controllers() -> None:
    rig = Rig()
    full, former = limits(rig), running(rig)
    with rig.arm.freedrive():
        assert running(rig) == {FREEDRIVE} and all(soft < hard for soft, hard in zip(limits(rig), full, strict=True))
        with pytest.raises(ArmBusyError, match="in freedrive: end freedrive"):
            rig.arm.move_to({PAN: 0.2})
        with pytest.raises(ArmBusyError, match="in freedrive: end freedrive"):
            rig.arm.stream()
        with pytest.raises(ArmBusyError, match="in freedrive"), rig.arm.freedrive():
            pass
    assert running(rig) == former and limits(rig) == full
    rig.arm.move_to({PAN: 0.2}, duration=1.0)
    assert rig.arm.state.position[PAN] == pytest.approx(0.2, abs=0.02)


def interrupt_while_it_begins(rig: Rig, patch: pytest.MonkeyPatch) -> None:
    """Interrupt the program while the torque limits are already reduced."""

    def interrupt(state: ArmState) -> None:
        if FREEDRIVE in running(rig):
            end()
            raise KeyboardInterrupt

    end = rig.arm.on_state(interrupt)


def interrupt_while_it_waits(rig: Rig, patch: pytest.MonkeyPatch) -> None:
    """Interrupt the program before the loop has received the request."""
    wait = SimulatedPace.wait

    def interrupt(pace: SimulatedPace, until: Callable[[], bool], timeout_s: float) -> bool:
        patch.setattr(SimulatedPace, "wait", wait)
        raise KeyboardInterrupt

    patch.setattr(SimulatedPace, "wait", interrupt)


@pytest.mark.parametrize("interrupt", [interrupt_while_it_begins, interrupt_while_it_waits])
def test_freedrive_whose_start_is_interrupted_ends(
    interrupt: Callable[[Rig, pytest.MonkeyPatch], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Rig()
    full, former = limits(rig), running(rig)
    interrupt(rig, monkeypatch)
    with pytest.raises(KeyboardInterrupt), rig.arm.freedrive():
        pass
    rig.run(0.5)
    assert limits(rig) == full and running(rig) == former
    rig.arm.move_to({PAN: 0.2}, duration=1.0)


def test_freedrive_is_refused_during_a_motion_and_without_torque() -> None:
    rig = Rig()
    motion = rig.arm.move_to({PAN: 0.5}, duration=1.0, wait=False)
    rig.arm.step()
    with pytest.raises(ArmBusyError, match=r"before you move the arm by hand"), rig.arm.freedrive():
        pass
    motion.wait()
    rig.arm.torque(False, park=False)
    with pytest.raises(ArmBusyError, match="its torque is off"), rig.arm.freedrive():
        pass


def test_stop_and_release_end_the_freedrive() -> None:
    rig = Rig()
    full = limits(rig)
    rig.backend.begin_freedrive()
    rig.arm.stop()
    rig.run(0.5)
    assert limits(rig) == full and FREEDRIVE not in running(rig)
    rig.backend.begin_freedrive()
    rig.arm.torque(False, park=False)
    assert not any(rig.register(name, sts.torque_enable) for name in rig.names)
    rig.arm.torque(True)
    assert limits(rig) == full and FREEDRIVE not in running(rig)


def test_another_program_that_activates_a_controller_ends_the_freedrive() -> None:
    rig = Rig()
    full = limits(rig)
    rig.backend.begin_freedrive()
    rig.loop.manager.switch(SwitchRequest(("arm_controller",), (FREEDRIVE,)), rig.loop.within_limits)
    rig.run(0.3)
    assert limits(rig) == full and "arm_controller" in running(rig)


def test_freedrive_ends_although_a_previous_controller_was_unloaded(caplog: pytest.LogCaptureFixture) -> None:
    rig = Rig()
    full = limits(rig)
    with rig.arm.freedrive():
        rig.loop.manager.registry.unload("arm_controller")
    assert limits(rig) == full and running(rig) == {"hand_controller"}
    assert "arm_controller was unloaded and cannot be activated after freedrive_controller: load" in caplog.text
    assert rig.loop.figures.observer_errors == 0


def test_freedrive_begins_again_after_its_controller_was_unloaded() -> None:
    rig = Rig()
    for _ in range(2):
        with rig.arm.freedrive():
            assert running(rig) == {FREEDRIVE}
        rig.loop.manager.registry.unload(FREEDRIVE)


def test_servo_that_is_silent_at_the_end_gets_its_torque_back_once_it_answers() -> None:
    rig = Rig()
    full = limits(rig)
    (line,) = rig.lines.lines.values()
    rig.backend.begin_freedrive()
    line.faults.silence(3)
    rig.run(0.5)
    with pytest.raises(ArmError, match="the torque of elbow_flex stays reduced"):
        rig.backend.end_freedrive()
    assert [one == all_ for one, all_ in zip(limits(rig), full, strict=True)] == [True, True, False, True, True, True]
    line.faults.restore(3)
    rig.run(2.0)
    assert limits(rig) == full


def test_arm_with_a_silent_servo_does_not_become_soft_and_its_loop_is_not_delayed() -> None:
    """In a former version, the writes to the silent servo delayed the loop by almost a second."""
    rig = Rig()
    full = limits(rig)
    (line,) = rig.lines.lines.values()
    line.faults.silence(3)
    rig.run(0.5)
    before_s = rig.loop.clock.now()
    with pytest.raises(ArmError, match=r"cannot be moved by hand: elbow_flex.*does not respond"):
        rig.backend.begin_freedrive()
    assert rig.loop.clock.now() - before_s <= 4 * rig.loop.period_s
    assert limits(rig) == full and FREEDRIVE not in running(rig)


def test_arm_that_ends_in_freedrive_holds_with_its_full_torque() -> None:
    rig = Rig()
    full = limits(rig)
    rig.backend.begin_freedrive()
    assert shut_down(rig.loop, False, None, 1.0) == []
    assert limits(rig) == full and all(rig.register(name, sts.torque_enable) for name in rig.names)
