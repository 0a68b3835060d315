"""The invariants of campaigns hold while a program moves the arm with ``Arm``: no motion bypasses the checks."""

import random
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from pathlib import Path

import pytest

from servoloop import Arm, ArmBusyError, ArmError
from servoloop.api.own_loop import describe
from servoloop.api.pace import SimulatedPace
from servoloop.api.stack_backend import StackBackend
from servoloop.campaign.invariants.watch import Watch
from servoloop.campaign.run import end_program
from servoloop.recording.stack_recording import StackRecording
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.robot_files import Files, read_files
from sim_backend.faults.text import parse
from tests.api.loaded_arm import FREE
from tests.ros.two_components import write_servos

PAN = "shoulder_pan"


class WatchedArm(Arm):
    """Arm on a stack that the invariants watch."""

    def __init__(self, files: Files | None = None) -> None:
        self.stack = FaultyStack(files=files or read_arm_files(find_arm("so101")), keep_alive=True)
        control = self.stack.control_stack
        pace = SimulatedPace(self.stack.loop, lambda: None, lambda error: None)
        backend = StackBackend(control, describe(control), pace, lambda: None, StackRecording(None))
        self.watch = Watch(self.stack)
        self.stack.up()
        self._use(backend, backend.close, "so101")

    def lose(self, bus: str = "") -> None:
        """Unplug an adapter for half a second, until its component is lost."""
        fault = parse(f"adapter_unplugged {bus} for=0.5s")
        self.stack.player.play([fault], self.stack.world.time_s)
        self.sleep(1.0)

    def end(self) -> list[str]:
        """Shut the arm down, and return the violations."""
        end_program(self.stack)
        self.watch.end()
        return [f"{one.invariant} at {one.time_s:.2f} s: {one.text}" for one in self.watch.violations.values()]


@pytest.fixture
def arm() -> Iterator[WatchedArm]:
    yield WatchedArm()


def test_motions_streams_and_torque_keep_the_invariants(arm: WatchedArm) -> None:
    arm.move_to(FREE, duration=2.0)
    motion = arm.move_to({PAN: 0.8, "gripper": 1.0}, speed=0.8, wait=False)
    arm.sleep(0.4)
    arm.move_to({PAN: -0.5}, speed=1.0, wait=False)
    arm.sleep(0.5)
    motion.cancel()
    arm.stop()
    with arm.stream(max_age=0.15) as stream:
        for number in range(20):
            stream.send({PAN: 0.02 * number, "gripper": 0.4})
            arm.sleep(0.03)
        stream.send({PAN: 1.2})
        arm.sleep(1.0)
    arm.move_to(FREE, speed=0.3)
    arm.torque(False)
    arm.sleep(0.5)
    arm.torque(True)
    arm.move_to({"elbow_flex": 1.0}, speed=0.3)
    assert arm.end() == []


@pytest.mark.parametrize("streams", [False, True])
def test_torque_of_an_arm_that_was_lost_can_be_enabled(arm: WatchedArm, streams: bool) -> None:
    arm.move_to(FREE, duration=2.0)
    with suppress(ArmError), arm.stream(max_age=9.0) if streams else nullcontext():
        arm.lose()
    with pytest.raises(ArmBusyError, match=r"is lost .* Call arm\.torque\(True\)"):
        arm.move_to({PAN: 0.2})
    arm.torque(True)
    arm.move_to({PAN: 0.2, "gripper": 0.5}, duration=1.5)
    assert arm.state.position[PAN] == pytest.approx(0.2, abs=0.05)
    assert arm.end() == []


def test_a_stream_that_lost_the_hand_gives_the_arm_back(tmp_path: Path) -> None:
    arm = WatchedArm(read_files(write_servos(tmp_path)))
    joint, hand = arm.joints[0], arm.joints[-1]
    with arm.stream(max_age=9.0):
        arm.lose("bus=hand")
    arm.move_to({joint: 0.2}, duration=1.0)
    with pytest.raises(ArmBusyError, match=f"{hand} cannot be moved: .* is lost"):
        arm.move_to({hand: 0.0})
    arm.torque(True)
    arm.move_to({joint: 0.0, hand: 0.0}, duration=1.0)
    arm.end()


def test_controllers_start_although_another_component_stays_lost(tmp_path: Path) -> None:
    arm = WatchedArm(read_files(write_servos(tmp_path)))
    joint = arm.joints[0]
    arm.torque(False, park=False)
    arm.stack.player.play([parse("adapter_unplugged bus=hand")], arm.stack.world.time_s)
    arm.sleep(1.0)
    with pytest.raises(ArmError, match="hand"):
        arm.torque(True)
    arm.move_to({joint: 0.1}, duration=1.0)
    assert arm.state.position[joint] == pytest.approx(0.1, abs=0.05)


@pytest.mark.parametrize("free", [False, True])
def test_torque_during_a_stream_or_freedrive_gives_the_arm_to_its_controller(arm: WatchedArm, free: bool) -> None:
    """A joint loses its torque, so that the stream or freedrive ends. Neither starts again by itself."""
    arm.move_to(FREE, duration=2.0)
    with suppress(ArmError), arm.freedrive() if free else arm.stream(max_age=9.0):
        arm.stack.player.play([parse("brown_out id=3")], arm.stack.world.time_s)
        arm.sleep(2.0)
        arm.torque(True)
        arm.sleep(0.5)
    arm.move_to({PAN: 0.2}, duration=1.5)
    assert arm.state.position[PAN] == pytest.approx(0.2, abs=0.05)
    running = {entry.spec.name for entry in arm.stack.loop.manager.registry.running}
    assert "arm_controller" in running and "freedrive_controller" not in running
    arm.stack.player.play([parse("overload id=1 torque=2 for=0.3s")], arm.stack.world.time_s)
    arm.sleep(2.0)
    assert arm.state.position[PAN] == pytest.approx(0.2, abs=0.05), "the arm does not yield"


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_random_programs_keep_the_invariants(seed: int) -> None:
    """A program that calls every method at the wrong time gets errors, and no invariant is violated."""
    arm, draw = WatchedArm(), random.Random(seed)
    arm.move_to(FREE, duration=2.0)
    actions = [
        lambda: arm.move_to({PAN: draw.uniform(-0.8, 0.8)}, speed=draw.uniform(0.1, 1.0), wait=False),
        lambda: arm.move_to({"gripper": draw.uniform(0.0, 1.5)}, speed=draw.uniform(0.1, 1.0), wait=False).cancel(),
        lambda: arm.stop(),
        lambda: arm.stream(max_age=0.2).send({PAN: draw.uniform(-0.8, 0.8)}),
        lambda: arm.torque(draw.random() < 0.7, park=False),
        lambda: arm.move_to({PAN: float("nan")}),
    ]
    for _ in range(25):
        with suppress(ArmError):
            draw.choice(actions)()
        arm.sleep(draw.uniform(0.0, 0.6))
    assert arm.end() == []
