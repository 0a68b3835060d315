"""At shutdown, an arm whose adapter was lost is parked and released if it can be reached and still holds its
position."""

import pytest

from drivers.servos import sts
from servoloop.campaign.run import end_program, with_exit_policy
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.stack.robot_files import read_files
from sim_backend.faults.text import parse

SWITCHES_ON = bytes([3, sts.torque_enable.address, 1])
"""Packet fragment: instruction WRITE, register and value."""


def up(*faults: str) -> FaultyStack:
    """Return a stack with ``on_exit: relax`` and these faults, 1.5 s after it is up."""
    stack = FaultyStack(files=with_exit_policy(read_files(), "relax"), keep_alive=True)
    stack.player.plan(map(parse, faults))
    stack.up()
    stack.run(1.5)
    return stack


def ended(*faults: str) -> FaultyStack:
    """Return a stack created by ``up``, after its program has ended."""
    stack = up(*faults)
    end_program(stack)
    return stack


def torque(stack: FaultyStack) -> set[int]:
    return {servo.memory.get(sts.torque_enable) for servo in stack.bus.servos}


def parked(stack: FaultyStack) -> dict[str, float]:
    """Return the distance of each joint from the park pose, in rad or m."""
    park = stack.files.robot.file.park
    assert park is not None
    true = dict(zip(stack.world.joints, stack.world.position().tolist(), strict=True))
    return {name: abs(true[name] - position) for name, position in park.pose.items()}


@pytest.mark.parametrize("fault", ["adapter_unplugged at=0.5s for=0.2s", "adapter_unplugged at=0.5s for=0.8s"])
def test_reconnected_arm_is_parked_and_released(fault: str) -> None:
    stack = ended(fault)
    assert torque(stack) == {0}
    assert max(parked(stack).values()) < 0.1


@pytest.mark.parametrize("fault", ["adapter_unplugged at=0.5s", "adapter_unplugged as=another at=0.5s for=0.2s"])
def test_unreachable_arm_keeps_its_torque(fault: str) -> None:
    assert torque(ended(fault)) == {1}


def test_reconnected_arm_with_a_silent_servo_is_released_where_it_is(caplog: pytest.LogCaptureFixture) -> None:
    """The arm cannot be activated, so it cannot be parked."""
    caplog.set_level("INFO")
    stack = ended("adapter_unplugged at=0.5s for=0.2s", "silent id=3 at=0.6s")
    on = {servo.servo_id for servo in stack.bus.servos if servo.memory.get(sts.torque_enable)}
    assert on == {3}
    assert caplog.messages[-1].startswith("robot_arm was lost, and its torque may still be enabled: servo 3")


def test_second_signal_releases_a_reconnected_arm_at_once() -> None:
    stack = up("adapter_unplugged at=0.5s for=0.2s")
    stack.control_stack.end(hurry=lambda: True)
    assert torque(stack) == {0}
    assert max(parked(stack).values()) > 0.5


def test_arm_that_has_sunk_is_not_moved() -> None:
    """A person may be touching the arm, and no client has requested a motion."""
    stack = up("adapter_unplugged at=0.5s for=0.5s", "cable_cut at=0.6s for=0.2s")
    before = len(stack.port.sent)
    end_program(stack)
    assert torque(stack) == {0}
    sent = [data for _, data in stack.port.sent[before:]]
    assert sent and not any(data[4:7] == SWITCHES_ON for data in sent)
