"""``Arm.simulated``: the contract of all arms in simulated time, and the features of simulated time."""

import math
import re
import runpy
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from decimal import Decimal
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import servoloop
from controller.gripper.gripper_action_controller import GripperActionController
from controller.trajectory.joint_trajectory_controller import JointTrajectoryController
from servoloop import (
    Arm,
    ArmBusyError,
    ArmEndedError,
    ArmError,
    ArmInputError,
    ArmSetupError,
    ArmTrajectory,
    MotionCanceledError,
    MotionFailedError,
)
from servoloop.api import stack_backend
from servoloop.api.pace import SimulatedPace
from servoloop.api.stream_gate import Takeover
from servoloop.api.thread_loop import exit_on_signals
from servoloop.manual.poses import Poses
from servoloop.recording.reader import read_recording
from servoloop.stack.shipped_files import ARMS
from tests.api.contract import PAN, ArmContract
from tests.api.loaded_arm import FREE, LoadedArm
from tests.pages import ROOT

ELBOW = "elbow_flex"
RATE_RANGE = "rate_hz must be a whole number from 1 to 1000"
GRIPPER_TYPE = "parallel_gripper_action_controller/GripperActionController"


@pytest.fixture(scope="module")
def simulated_arm() -> Iterator[Arm]:
    with Arm.simulated("so101", backlash_deg=0.0) as arm:
        arm.move_to(FREE, duration=1.5)
        yield arm


class TestSimulatedArm(ArmContract):
    """The contract of ``Arm`` in simulated time."""

    @pytest.fixture
    def arm(self, simulated_arm: Arm) -> Arm:
        return simulated_arm


@pytest.fixture
def loaded() -> Iterator[LoadedArm]:
    with LoadedArm() as arm:
        yield arm


def test_a_blocked_joint_ends_the_motion_with_its_name(loaded: LoadedArm) -> None:
    motion = loaded.move_to({PAN: 1.5}, duration=1.5, wait=False)
    loaded.sleep(0.3)
    loaded.push(PAN, -8.0)
    with pytest.raises(MotionFailedError, match=f"(?s)reached its target: .*{PAN}.*holds its position") as caught:
        motion.wait(10.0)
    assert caught.value.joint == PAN and str(motion.failure) == str(caught.value)
    loaded.stop()  # no effect, because the motion has ended
    assert str(motion.failure) == str(caught.value)


def test_a_silent_servo_is_a_fault_with_its_name(loaded: LoadedArm) -> None:
    line = loaded.loop.lines[""]
    line.faults.mute.add(line.servo(3))
    motion = loaded.move_to({ELBOW: 1.0}, duration=3.0, wait=False)
    loaded.sleep(0.3)
    assert list(loaded.faults) == [ELBOW] and "servo 3" in loaded.faults[ELBOW]
    with pytest.raises(MotionFailedError, match="servo 3"):
        motion.wait(10.0)


def test_a_lost_bus_ends_the_loop_with_its_reason(loaded: LoadedArm) -> None:
    def fail(deadline_s: float | None = None) -> None:
        raise ArmError("the cable was pulled")

    loaded.loop.backend.stack.loop.hardware.read = fail  # type: ignore[method-assign, assignment]
    motion = loaded.move_to({PAN: 0.5}, wait=False)
    with pytest.raises(ArmEndedError, match="the control loop has ended: the cable was pulled"):
        motion.wait()
    with pytest.raises(ArmEndedError, match="create a new Arm"):
        loaded.move_to({PAN: 0.0})


def test_a_stream_that_stops_in_motion_ends_within_the_limits(loaded: LoadedArm) -> None:
    loaded.move_to({PAN: -1.0}, speed=1.0)
    commands = [loaded.state.command[PAN]]
    with loaded.stream(max_age=0.1) as stream:
        stream.send({PAN: 1.5})
        for _ in range(30):
            commands.append(loaded.step().command[PAN])
    limit = loaded.limits[PAN]
    velocity = np.diff(commands) * loaded.rate_hz
    braking = np.diff(velocity)[velocity[:-1].argmax() :] * loaded.rate_hz
    assert velocity.max() <= limit.velocity * 1.001 and velocity.max() > 1.0
    assert braking.min() >= -limit.acceleration * 1.001
    assert commands[-1] < 1.4 and velocity[-5:] == pytest.approx(0.0, abs=1e-6)


def test_a_joint_that_a_stream_pressed_against_an_obstacle_is_relieved_after_its_end(loaded: LoadedArm) -> None:
    loaded.push(PAN, -8.0)
    with loaded.stream(max_age=1.0) as stream:
        stream.send({PAN: 1.0})
        loaded.sleep(0.8)
        assert loaded.state.command[PAN] - loaded.state.position[PAN] > 0.5
    loaded.sleep(4.0)
    assert loaded.state.command[PAN] == pytest.approx(loaded.state.position[PAN], abs=0.1)


def test_a_joint_that_a_stream_presses_against_an_obstacle_is_relieved_when_the_program_ends(
    loaded: LoadedArm,
) -> None:
    loaded.push(PAN, -8.0)
    stream = loaded.stream(max_age=2.0)
    stream.send({PAN: 1.0})
    loaded.sleep(0.8)
    assert loaded.state.command[PAN] - loaded.state.position[PAN] > 0.5
    stack = loaded.loop.backend.stack
    place = stack.loop.hardware.joints.index(PAN)
    assert stack.end() == []
    assert stack.loop.command[place] == pytest.approx(loaded.state.position[PAN], abs=0.1)


def test_a_joint_that_an_own_controller_presses_is_relieved_when_the_program_ends(loaded: LoadedArm) -> None:
    own = runpy.run_path(str(ROOT / "examples" / "own_controller.py"))["Swing"]
    loaded.push(PAN, -8.0)
    stack = loaded.loop.backend.stack
    place = stack.loop.hardware.joints.index(PAN)
    context = loaded.controller(own, joint=PAN)  # The program ends before the context does.
    context.__enter__()
    loaded.sleep(0.8)
    assert abs(loaded.state.command[PAN] - loaded.state.position[PAN]) > 0.5
    assert stack.end() == []
    assert stack.loop.command[place] == pytest.approx(loaded.state.position[PAN], abs=0.1)
    with pytest.raises(ArmError, match="the control loop has ended"):
        context.__exit__(None, None, None)


def test_a_stream_ends_although_a_previous_controller_was_unloaded(loaded: LoadedArm) -> None:
    registry = loaded.loop.backend.stack.loop.manager.registry
    with loaded.stream(max_age=1.0) as stream:
        stream.send({PAN: 0.1})
        registry.unload("arm_controller")
    assert {entry.spec.name for entry in registry.running} == {"joint_state_broadcaster", "hand_controller"}
    loaded.gripper.open()
    with pytest.raises(ArmBusyError, match=f"{PAN} cannot be moved: no active controller moves it"):
        loaded.move_to({PAN: 0.0})


def test_a_stream_ends_although_a_previous_controller_cannot_be_activated(
    loaded: LoadedArm, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(controller: object, state: object, command: object) -> None:
        raise ValueError("broken")

    registry = loaded.loop.backend.stack.loop.manager.registry
    with monkeypatch.context() as patch, loaded.stream(max_age=1.0):
        patch.setattr(JointTrajectoryController, "activate", broken)
    assert {entry.spec.name for entry in registry.running} == {"joint_state_broadcaster"}
    loaded.torque(True)
    loaded.move_to({PAN: 0.1, "gripper": 0.5}, duration=1.0)


def test_joints_that_still_stop_when_a_stream_begins_do_not_move_back(loaded: LoadedArm) -> None:
    with loaded.stream(max_age=1.0) as stream:
        stream.send({PAN: 1.5})
        loaded.sleep(0.3)
    with loaded.stream(max_age=2.0) as stream:
        stream.send({ELBOW: loaded.state.command[ELBOW]})
        commands = [loaded.step().command[PAN] for _ in range(20)]
    assert commands == sorted(commands) and commands[-1] > commands[0] + 0.01


def test_moving_joints_that_the_next_motion_does_not_name_stop_without_moving_back(loaded: LoadedArm) -> None:
    loaded.move_to({PAN: 1.5}, duration=2.0, wait=False)
    loaded.sleep(0.8)
    loaded.move_to({ELBOW: loaded.state.command[ELBOW] - 0.1}, duration=1.0, wait=False)
    commands = [loaded.step().command[PAN] for _ in range(30)]
    assert np.diff(commands).min() > -1e-9 and commands[-1] < 1.4


def test_a_streamed_target_is_commanded_in_the_next_cycle(loaded: LoadedArm) -> None:
    with loaded.stream() as stream:
        before = loaded.step().command[PAN]
        stream.send({PAN: before + 0.01})
        assert loaded.step().command[PAN] == pytest.approx(before + 0.01, abs=1e-9)


def test_a_canceled_gripper_motion_slows_down_within_its_limits(loaded: LoadedArm) -> None:
    commands = [loaded.state.command["gripper"]]
    motion = loaded.gripper.move(1.5, duration=0.6, wait=False)
    for number in range(15):
        commands.append(loaded.step().command["gripper"])
        if number == 5:
            motion.cancel()
    acceleration = np.diff(commands, 2)[5:] * loaded.rate_hz**2
    assert acceleration.min() >= -loaded.limits["gripper"].acceleration * 1.001
    assert 0.1 < commands[-1] < 1.2 and np.diff(commands)[-3:] == pytest.approx(0.0, abs=1e-6)


def test_the_gripper_moves_along_a_trajectory_with_the_arm(loaded: LoadedArm) -> None:
    loaded.move_to({"gripper": 0.2, PAN: 0.0}, speed=0.5)
    pairs = []
    loaded.on_state(lambda state: pairs.append((state.command[PAN], state.command["gripper"])))
    loaded.follow(ArmTrajectory([0.1, 2.1], {PAN: [0.0, 1.0], "gripper": [0.2, 1.2]}))
    off = [gripper - 0.2 - pan for pan, gripper in pairs if 0.3 < pan < 0.7]
    assert len(off) > 4 and max(map(abs, off)) < 0.25


def test_equal_programs_have_equal_results() -> None:
    def run(seed: int) -> list[float]:
        with Arm.simulated("so101", seed=seed) as arm:
            arm.move_to({**FREE, "gripper": 0.8}, duration=1.0)
            return [arm.state.time_s, *arm.state.position.values(), *arm.state.effort.values()]

    first = run(5)
    assert run(5) == first and run(6) != first


@pytest.mark.parametrize("rate_hz", [50, Decimal(50)])
def test_each_step_is_one_cycle_and_waits_keep_the_rate(rate_hz: Any) -> None:
    with Arm.simulated("so101", rate_hz=rate_hz) as arm:
        times = [arm.step().time_s for _ in range(10)]
        assert np.diff(times) == pytest.approx(0.02, abs=5e-4)
        arm.sleep(0.5)
        assert arm.state.time_s - times[-1] == pytest.approx(0.5, abs=0.021)


def test_a_hand_guided_path_is_recorded_and_followed(loaded: LoadedArm) -> None:
    loaded.torque(False)
    states = []
    end = loaded.on_state(states.append)
    for load in (1.0, 0.0, -1.0, 0.0):
        loaded.push(PAN, load)
        loaded.sleep(0.5)
    end()
    loaded.torque(True)
    shown = [state.position[PAN] for state in states]
    assert max(shown) - min(shown) > 0.2
    loaded.follow(ArmTrajectory.recorded(states, loaded.limits))
    assert loaded.state.position[PAN] == pytest.approx(loaded.clip(states[-1].position)[PAN], abs=0.05)


def test_a_recording_without_motion_is_refused(loaded: LoadedArm) -> None:
    with pytest.raises(ArmInputError, match="no joint moved"):
        ArmTrajectory.recorded([loaded.step() for _ in range(5)], loaded.limits)
    with pytest.raises(ArmInputError, match="at least two states"):
        ArmTrajectory.recorded([], loaded.limits)


def test_the_torque_stays_on_if_the_park_pose_is_not_reached(loaded: LoadedArm) -> None:
    loaded.move_to({PAN: 1.0}, speed=0.5)
    loaded.push(PAN, 8.0)
    with pytest.raises(MotionFailedError, match="the park pose was not reached, so the torque stays enabled"):
        loaded.torque(False)
    loaded.torque(False, park=False)


def test_the_park_pose_may_be_reached_slowly(loaded: LoadedArm, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stack_backend, "PARK_S", 1.5)
    begun_s = loaded.state.time_s
    loaded.torque(False)
    assert loaded.state.time_s > begun_s + 2.0


def test_an_arm_that_parks_for_too_long_stops_with_its_torque_on(
    loaded: LoadedArm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stack_backend, "PARK_S", -1.0)
    with pytest.raises(MotionFailedError, match=r"torque stays enabled: the motion did not end within \d\.\d s\. Use"):
        loaded.torque(False)
    loaded.sleep(0.5)
    assert loaded.state.command == loaded.step(5).command
    loaded.move_to(FREE, duration=1.0)


def test_the_whole_run_is_recorded(tmp_path: Path) -> None:
    with Arm.simulated("so101", record=tmp_path / "run.mcap") as arm:
        arm.move_to({PAN: 0.3}, duration=0.5)
    run = read_recording(tmp_path / "run.mcap")
    assert run.position[-1, run.joints.index(PAN)] == pytest.approx(0.3, abs=0.05)
    with pytest.raises(ArmSetupError, match="exists"):
        Arm.simulated("so101", record=tmp_path / "run.mcap")


def test_a_closed_arm_explains_itself() -> None:
    arm = Arm.simulated("so101")
    arm.close()
    arm.close()
    for call in (
        lambda: arm.move_to({PAN: 0.0}),
        lambda: arm.stream(),
        lambda: arm.torque(True),
        lambda: arm.sleep(1.0),
        arm.step,
    ):
        with pytest.raises(ArmEndedError, match="has been shut down: create a new Arm"):
            call()
    assert arm.state.age_s >= 0.0


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("so99", {}, "there is no arm so99: choose one of bimanual_so101, koch"),
        ("so101", {"rate_hz": 0}, f"{RATE_RANGE}, not 0$"),
        ("so101", {"rate_hz": 1e-9}, f"{RATE_RANGE}, not 1e-09$"),
        ("so101", {"rate_hz": 1001}, f"{RATE_RANGE}, not 1001$"),
        ("so101", {"rate_hz": 10**5000}, f"{RATE_RANGE}, not inf$"),
        ("so101", {"rate_hz": Decimal("50.5")}, rf"{RATE_RANGE}, not 50\.5$"),
        ("so101", {"rate_hz": math.nan}, f"{RATE_RANGE}, not nan$"),
        ("so101", {"rate_hz": "20"}, f"{RATE_RANGE}, not '20'$"),
        ("so101", {"rate_hz": 1000}, "1000 Hz is too fast"),
        ("so101", {"seed": -1}, "seed must be a whole number of at least 0, not -1"),
        ("so101", {"seed": 0.5}, r"seed must be a whole number of at least 0, not 0\.5"),
        ("so101", {"backlash_deg": -5}, "backlash_deg must be a finite angle of at least 0, not -5"),
        ("so101", {"backlash_deg": math.nan}, "backlash_deg must be a finite angle of at least 0, not nan"),
        ("so101", {"controllers": "none.yaml"}, "none.yaml"),
        ("so101", {"record": "r" * 300 + ".mcap"}, "cannot write the recording .*: File name too long"),
        ("a" * 300, {}, "there is no arm aaa"),
    ],
    ids=[
        *("arm", "no rate", "slow", "fast", "huge rate", "fraction as rate", "no number as rate", "rate as text"),
        *("too fast for the bus", "seed", "fraction as seed", "backlash", "no number as backlash"),
        *("controllers", "recording", "long name"),
    ],
)
def test_an_arm_that_cannot_start_gives_the_reason(name: str, options: dict[str, object], message: str) -> None:
    with pytest.raises(ArmSetupError, match=message):
        Arm.simulated(name, **options)  # type: ignore[arg-type]


def test_a_saved_pose_of_an_arm_folder_is_a_target(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(ARMS / "so101", tmp_path / "mine"))
    Poses(folder).save("free", FREE)
    Poses(folder).save("far", {PAN: 9.0})
    with Arm.simulated(folder) as arm:
        arm.move_to("free", duration=1.5)
        assert arm.name == "mine" and arm.state.position[ELBOW] == pytest.approx(FREE[ELBOW], abs=0.05)
        with pytest.raises(ArmInputError, match=r"shoulder_pan: position 9\.0000 is outside"):
            arm.move_to("far")


def gripper_with_goals(folder: Path) -> Path:
    """Write a controllers file of the SO-101 whose gripper has an action controller, and return its path."""
    text = (ARMS / "so101" / "controllers.yaml").read_text()
    text = text.replace("forward_command_controller/ForwardCommandController", GRIPPER_TYPE)
    text = text.replace("joints: [gripper]\n    interface_name: position", "joint: gripper\n    allow_stalling: true")
    (folder / "controllers.yaml").write_text(text)
    return folder / "controllers.yaml"


def test_another_controllers_file_and_a_gripper_with_goals_are_used(tmp_path: Path) -> None:
    with Arm.simulated("so101", controllers=gripper_with_goals(tmp_path)) as arm:
        arm.gripper.open()
        arm.gripper.move(0.2, duration=1.0)
        assert arm.state.position["gripper"] == pytest.approx(0.2, abs=0.05)
        motion = arm.gripper.move(1.5, duration=3.0, wait=False)
        arm.sleep(0.5)
        motion.cancel()
        with pytest.raises(MotionCanceledError):
            motion.wait(2.0)
        arm.move_to({**FREE, "gripper": 0.8}, duration=1.5)
        assert arm.state.position["gripper"] == pytest.approx(0.8, abs=0.05)


def test_a_motion_that_one_controller_rejects_moves_no_joint() -> None:
    left, right = "left_shoulder_pan", "right_shoulder_pan"
    with Arm.simulated("bimanual_so101") as arm:
        speeds = {left: [0.0, 0.3, 0.0], right: [0.0, 2.0 * arm.limits[right].velocity, 0.0]}
        path = ArmTrajectory([0.0, 1.0, 2.0], {joint: [0.0, 0.3, 0.6] for joint in speeds}, speeds)
        before = arm.state.command
        with pytest.raises(ArmInputError, match=f"the arm rejected the motion: {right} would move at") as caught:
            arm.follow(path)
        assert caught.value.joint == right
        assert arm.step(10).command == before


def test_a_motion_that_the_gripper_rejects_moves_no_joint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with Arm.simulated("so101", controllers=gripper_with_goals(tmp_path)) as arm:
        monkeypatch.setattr(GripperActionController, "check", lambda gripper, goal: "not now")
        before = arm.state.command
        with pytest.raises(ArmInputError, match="the gripper rejected the motion: not now"):
            arm.move_to({PAN: 0.3, "gripper": 0.8})
        assert arm.step(10).command == before


def test_joints_of_a_hand_stop_without_moving_back_when_the_next_motion_begins(tmp_path: Path) -> None:
    text = (ARMS / "so101" / "controllers.yaml").read_text()
    text = "".join(line for line in text.splitlines(keepends=True) if "wrist_roll:" not in line)
    text = text.replace(", wrist_roll]", "]").replace("joints: [gripper]", "joints: [wrist_roll, gripper]")
    (tmp_path / "controllers.yaml").write_text(text)
    with Arm.simulated("so101", controllers=tmp_path / "controllers.yaml") as arm:
        arm.move_to({"wrist_roll": 1.5, "gripper": 1.2}, duration=1.0, wait=False)
        arm.sleep(0.6)
        arm.move_to({"gripper": 1.5}, duration=4.0, wait=False)
        cycles = np.array([[arm.step().command[joint] for joint in ("wrist_roll", "gripper")] for _ in range(40)])
        assert np.diff(cycles, axis=0).min() > -1e-9 and cycles[-1, 0] < 1.0


def test_a_user_controller_needs_valid_parameters_and_releases_its_joints(loaded: LoadedArm) -> None:
    own = runpy.run_path(str(ROOT / "examples" / "own_controller.py"))["Swing"]
    with pytest.raises(ArmInputError, match="joint: is missing: add the key"):
        loaded.controller(own).__enter__()
    with pytest.raises(ArmInputError, match=r"own_controller\.joint names elbow"):
        loaded.controller(own, joint="elbow").__enter__()
    for _ in range(2):
        with loaded.controller(own, joint=ELBOW):
            loaded.sleep(0.3)
            with pytest.raises(ArmBusyError, match="elbow_flex cannot be moved: own_controller drives it"):
                loaded.move_to({ELBOW: 0.0})
        loaded.move_to({ELBOW: 0.5}, duration=0.5)


def test_a_user_controller_that_was_refused_can_be_started_later(loaded: LoadedArm) -> None:
    own = runpy.run_path(str(ROOT / "examples" / "own_controller.py"))["Swing"]
    loaded.torque(False, park=False)
    with pytest.raises(ArmBusyError, match="own_controller cannot take over its joints"):
        loaded.controller(own, joint=ELBOW).__enter__()
    loaded.torque(True)
    with loaded.controller(own, joint=ELBOW):
        loaded.sleep(0.1)


def test_torque_can_be_enabled_after_it_was_disabled_during_a_user_controller(loaded: LoadedArm) -> None:
    own = runpy.run_path(str(ROOT / "examples" / "own_controller.py"))["Swing"]
    with loaded.controller(own, joint=PAN):
        loaded.torque(False, park=False)
        loaded.torque(True)
        with pytest.raises(ArmBusyError, match="own_controller drives it"):
            loaded.move_to({PAN: 0.1})
        loaded.torque(False, park=False)
    loaded.torque(True)
    loaded.move_to({PAN: 0.1, "gripper": 0.5}, duration=1.0)


def test_a_user_controller_whose_start_is_interrupted_releases_its_joints(
    loaded: LoadedArm, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = runpy.run_path(str(ROOT / "examples" / "own_controller.py"))["Swing"]
    take = Takeover.take

    def interrupted(takeover: Takeover) -> None:
        take(takeover)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Takeover, "take", interrupted)
        loaded.controller(own, joint=ELBOW).__enter__()
    loaded.move_to({ELBOW: 0.3}, duration=0.5)
    with loaded.controller(own, joint=ELBOW):
        loaded.sleep(0.1)


@pytest.mark.parametrize("number", [1, 2, 3])
def test_a_user_controller_is_unloaded_if_any_of_its_waits_is_interrupted(
    loaded: LoadedArm, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    """The waits are for loading, for activating and for unloading the controller."""
    own = runpy.run_path(str(ROOT / "examples" / "own_controller.py"))["Swing"]
    wait, waits = SimulatedPace.wait, count(1)

    def interrupted(pace: SimulatedPace, until: Callable[[], bool], timeout_s: float) -> bool:
        if next(waits) == number:
            raise KeyboardInterrupt
        return wait(pace, until, timeout_s)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(SimulatedPace, "wait", interrupted)
        with loaded.controller(own, joint=ELBOW):
            pass
    loaded.step()  # The loop runs the actions before this cycle.
    loaded.move_to({ELBOW: 0.3}, duration=0.5)
    with loaded.controller(own, joint=ELBOW):
        loaded.sleep(0.1)


def test_a_controller_whose_name_is_taken_leaves_the_other_controller_active(loaded: LoadedArm) -> None:
    own = runpy.run_path(str(ROOT / "examples" / "own_controller.py"))["Swing"]
    with pytest.raises(ArmInputError, match="'arm_controller' was already loaded"):
        loaded.controller(own, "arm_controller", joint=ELBOW).__enter__()
    loaded.move_to({ELBOW: 0.3}, duration=0.5)


def test_a_user_controller_that_claims_an_unknown_interface_is_not_kept(loaded: LoadedArm) -> None:
    own = runpy.run_path(str(ROOT / "examples" / "own_controller.py"))["Swing"]

    def build(name: str, parameters: object, context: object) -> object:
        made = own(name, parameters)
        made.command_interfaces = ("elbow_flex/warmth",)
        return made

    wrong = type("Wrong", (own,), {"build": staticmethod(build)})
    with pytest.raises(ArmInputError, match="own_controller claims elbow_flex/warmth"):
        loaded.controller(wrong, joint=ELBOW).__enter__()
    with loaded.controller(own, joint=ELBOW):
        loaded.sleep(0.1)


@pytest.mark.parametrize("rate_hz", [Decimal(40), 10**400])
def test_targets_are_sent_at_a_rate_of_any_numeric_type(loaded: LoadedArm, rate_hz: Any) -> None:
    loaded.stream([{PAN: 0.1}, {PAN: 0.2}], rate_hz=rate_hz)


def test_targets_cannot_be_sent_at_a_negative_rate(loaded: LoadedArm) -> None:
    with pytest.raises(ArmInputError, match="rate_hz must be above 0, not -inf"):
        loaded.stream([{PAN: 0.1}], rate_hz=-(10**5000))


def test_a_port_that_does_not_exist_is_named() -> None:
    with pytest.raises(ArmSetupError, match="/dev/ttyACM77 does not exist"):
        Arm("so101", port="/dev/ttyACM77")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"port": 3}, "port must be a string or a list of strings such as '/dev/ttyACM0', not 3"),
        ({"port": ["/dev/ttyACM0", 4]}, "port must be a string or a list of strings"),
        ({"port": {"arm": "/dev/ttyACM0"}}, "port must be a string or a list of strings"),
        ({"name_or_folder": {}}, "name_or_folder must be a name or a path, not {}"),
        ({"controllers": 3}, "controllers must be a path, not 3"),
        ({"record": 3}, "record must be a path, not 3"),
    ],
)
def test_an_argument_of_the_wrong_type_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ArmSetupError, match=re.escape(message)):
        Arm(**{"name_or_folder": "so101", **options})


@pytest.mark.parametrize("name", ["robot_arm", "koch"])
def test_other_arms_move_too(name: str) -> None:
    with Arm.simulated(name) as arm:
        first = arm.joints[0]
        arm.move_to({first: 0.2}, speed=0.5)
        arm.gripper.open()
        assert arm.state.position[first] == pytest.approx(0.2, abs=0.05)


def test_callbacks_cannot_wait_and_their_errors_do_not_end_the_arm(
    loaded: LoadedArm, caplog: pytest.LogCaptureFixture
) -> None:
    loaded.on_state(lambda state: loaded.sleep(1.0))
    loaded.step(3)
    assert caplog.text.count("an on_state callback failed") == 1 and "cannot wait in simulated time" in caplog.text


def test_signals_end_a_program_through_its_context_managers() -> None:
    program = (
        "import os, signal\n"
        "from servoloop.api.thread_loop import exit_on_signals\n"
        "with exit_on_signals():\n"
        "    try:\n        os.kill(os.getpid(), signal.SIGTERM); signal.pause()\n"
        "    finally:\n        print('shut down')\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, timeout=60)
    assert (done.returncode, done.stdout) == (143, "shut down\n"), done.stderr
    with exit_on_signals():
        pass


def test_the_interface_is_loaded_at_first_use_and_without_simulation() -> None:
    heavy = ("mujoco", "numba", "ruckig", "rclpy", "pydantic", "numpy")
    program = (
        "import sys, servoloop\n"
        f"print([m for m in {heavy} if m in sys.modules])\n"
        "from servoloop import Arm\n"
        f"print([m for m in {heavy[:5]} if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, timeout=60)
    assert (done.returncode, done.stdout.split()) == (0, ["[]", "[]"]), done.stderr


def test_every_public_name_has_a_docstring() -> None:
    for name in servoloop.__all__:
        assert getattr(servoloop, name).__doc__, name
    assert issubclass(servoloop.ArmInputError, ArmError) and math.isfinite(servoloop.api.arm.STREAM_AGE_S)
    with pytest.raises(AttributeError, match="no attribute 'Leg'"):
        servoloop.Leg  # noqa: B018
