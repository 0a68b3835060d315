"""The whole stack with two ports and two makes (a Feetech arm and a Dynamixel hand), in simulated time."""

import numpy as np
import pytest

from controller.shutdown import shut_down
from drivers.driver_errors import PortLost
from drivers.servos import sts
from drivers.servos import x as x_series
from servoloop.simulation.stack import SimulatedStack
from servoloop.stack.robot_files import read_files
from servoloop.stack.shipped_files import CONFIG
from tests.stack.rig import BINS, CLOSED_M, PICK, UnpacedJob


def two_ports() -> SimulatedStack:
    return SimulatedStack(files=read_files(robot=CONFIG / "robot_arm_two_buses.yaml")).up()


@pytest.mark.parametrize("grade", BINS)
def test_cube_lands_in_its_bin(grade: str) -> None:
    rig = two_ports()
    job = UnpacedJob(rig, grade)
    job.run()
    rig.run(1.0)
    job.check()
    assert rig.loop.figures.missed == 0
    largest, rms = rig.trace.following_error()
    assert largest.max() < 0.08 and rms.max() < 0.03


def test_two_buses_may_share_ids_and_use_different_protocols() -> None:
    rig = two_ports()
    ids = {joint.name: (joint.bus, joint.servo_id) for joint in rig.files.robot.joints}
    assert ids["joint1"] == ("arm", 1) and ids["hand_right_joint"] == ("hand", 1)
    assert {data[:4] for _, data in rig.ports["hand"].sent} == {b"\xff\xff\xfd\x00"}
    assert all(data[:3] != b"\xff\xff\xfd" for _, data in rig.ports["arm"].sent)


def test_two_buses_share_one_world_and_its_time() -> None:
    """Although two buses advance the physics, time advances only once."""
    rig = two_ports()
    begin_s, world_s = rig.clock.now(), rig.world.time_s
    rig.run(1.0)
    assert rig.world.time_s - world_s == pytest.approx(rig.clock.now() - begin_s, abs=0.01)


def test_two_buses_are_read_in_parallel() -> None:
    """Reading both buses takes as long as the slower bus alone. The times of the simulated clock are exact."""
    rig = two_ports()
    rig.run(0.5)
    buses = {name: rig._open_bus(name) for name in rig.ports}
    alone_s = {}
    for name, bus in buses.items():
        ids = [joint.servo_id for joint in rig.files.robot.joints if joint.bus == name]
        begin_s = rig.clock.now()
        bus.read_states(ids, begin_s + 0.05)
        alone_s[name] = rig.clock.now() - begin_s
    assert min(alone_s.values()) > 0.0003
    begin_s = rig.clock.now()
    rig.hardware.read()
    together_s = rig.clock.now() - begin_s
    assert together_s < max(alone_s.values()) + 0.2 * min(alone_s.values())


@pytest.mark.parametrize(
    ("bus", "servo_id", "joint"), [("arm", 3, "joint3"), ("arm", 1, "joint1"), ("hand", 1, "hand_right_joint")]
)
def test_silent_servo_on_one_bus_does_not_hide_servos_on_the_other(bus: str, servo_id: int, joint: str) -> None:
    rig = two_ports()
    rig.go(PICK)
    rig.run(0.3)
    assert rig.hand.submit([CLOSED_M]) is None
    before = rig.hardware.read().position
    rig.lines[bus].faults.silence(servo_id)
    rig.run(0.2)
    state = rig.hardware.read()
    assert set(state.faults) == {joint}
    assert f"(bus {bus}): servo {servo_id} does not respond" in state.faults[joint].text
    moved = np.abs(state.position - before) > 1e-4
    names = np.array(rig.hardware.joints)
    assert {"joint6", "hand_right_joint"} - {joint} <= set(names[moved])


@pytest.mark.parametrize(("lost", "joint"), [("arm", "joint4"), ("hand", "hand_right_joint")])
@pytest.mark.parametrize("relax", [False, True])
def test_lost_port_is_reported_and_the_exit_policy_is_followed(lost: str, joint: str, relax: bool) -> None:
    rig = two_ports()
    rig.go(PICK)
    rig.run(0.8)
    rig.ports[lost].port.unplug()
    with pytest.raises(PortLost, match=rf"bus {lost}: .*Out of reach: .*{joint}"):
        rig.run(0.5)
    kept = next(name for name in rig.ports if name != lost)
    sent = len(rig.ports[kept].sent)
    problems = shut_down(rig.loop, relax, None, 1.0)
    assert any(f"bus {lost}" in problem for problem in problems)
    assert len(rig.ports[kept].sent) > sent, "the other line was told what to do at the end"
    switch = {"arm": sts.torque_enable.address, "hand": x_series.torque_enable.address}[kept]
    driven = [servo.memory.read(switch, 1) == b"\x01" for servo in rig.lines[kept].servos]
    assert driven == [not relax] * len(driven)


def test_equal_runs_give_equal_bytes() -> None:
    def run() -> tuple[object, ...]:
        rig = two_ports()
        rig.lines["arm"].faults.corrupt_next(3)
        UnpacedJob(rig, "B").run(2.0)
        return {name: (port.sent, port.received) for name, port in rig.ports.items()}, rig.world.position().tolist()

    assert run() == run()
