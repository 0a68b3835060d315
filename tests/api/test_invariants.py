"""The invariants of campaigns hold while a program moves the arm with ``Arm``: no motion bypasses the checks."""

import random
from collections.abc import Iterator
from contextlib import suppress

import pytest

from servoloop import Arm, ArmError
from servoloop.api.own_loop import describe
from servoloop.api.pace import SimulatedPace
from servoloop.api.stack_backend import StackBackend
from servoloop.campaign.invariants.watch import Watch
from servoloop.campaign.run import end_program
from servoloop.recording.stack_recording import StackRecording
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.stack.arm_folders import find_arm, read_arm_files
from tests.api.loaded_arm import FREE

PAN = "shoulder_pan"


class WatchedArm(Arm):
    """Arm on a stack that the invariants watch."""

    def __init__(self) -> None:
        self.stack = FaultyStack(files=read_arm_files(find_arm("so101")), keep_alive=True)
        control = self.stack.control_stack
        pace = SimulatedPace(self.stack.loop, lambda: None, lambda error: None)
        backend = StackBackend(control, describe(control), pace, lambda: None, StackRecording(None))
        self.watch = Watch(self.stack)
        self.stack.up()
        self._use(backend, backend.close, "so101")

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
