"""Tests with three joints on two buses with the same IDs: faults of one bus do not affect the other."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import cast

import numpy as np
import pytest

from drivers.bus.bus import Bus
from drivers.bus.counters import BusCounters
from drivers.bus.retry import ATTEMPTS
from drivers.driver_errors import DriverError, PortLost, PortMissing, ServoRefused
from drivers.servos import sts
from drivers.types import Reading, ServoState
from hal.components.component_lifecycle import configure_all
from hal.components.component_set import ComponentSet
from hal.hal_errors import ActivationError
from hal.joint import Joint
from hal.lifecycle import LifecycleState
from hal.mock_hardware import MockHardware
from hal.servos.joint_buses import JointBuses
from hal.servos.servo_hardware import ServoHardware
from hal.types import JointCommand
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.faults import Disturbance
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.packets.instructions import Instruction
from tests.hal.bench import JOINTS, PERIOD_S, WatchedPort, at, switches_torque_on
from tests.hal.faults import fault_texts

SHOULDER, ELBOW, FINGER = (
    replace(JOINTS[0], bus="arm"),
    replace(JOINTS[1], bus="arm"),
    replace(JOINTS[2], bus="hand", servo_id=1),
)
IDS: dict[str, tuple[int, ...]] = {"arm": (1, 2), "hand": (1,)}
COUNTS = {"arm": (2048, 2000), "hand": (1500,)}


class Ports:
    """A ``ServoHardware`` with two virtual buses."""

    def __init__(self) -> None:
        self.clock = SimulatedClock(1000.0)
        self.servos: dict[str, VirtualBus] = {}
        self.ports: dict[str, WatchedPort] = {}
        for name, ids in IDS.items():
            plant = BenchPlant(ids)
            plant.place([(c + 0.5) * 2.0 * math.pi / 4096 for c in COUNTS[name]])
            self.servos[name] = VirtualBus.of(plant)
            self.ports[name] = WatchedPort(VirtualPort(self.servos[name], self.clock, name=f"/dev/{name}"))
        self.hardware = ServoHardware("arm", (SHOULDER, FINGER, ELBOW), self.open, self.clock)

    def open(self) -> Mapping[str, Bus]:
        return {name: Bus(port, self.clock) for name, port in self.ports.items()}

    def active(self) -> "Ports":
        self.hardware.configure()
        self.hardware.activate()
        return self

    def torque(self) -> dict[str, list[int]]:
        return {
            name: [s.servo_id for s in line.servos if s.memory.get(sts.torque_enable)]
            for name, line in self.servos.items()
        }

    def goals(self) -> list[int]:
        """Return the measured counts in the joint order of the hardware."""
        arm, hand = self.servos["arm"], self.servos["hand"]
        return [s.memory.get(sts.goal_position) for s in (arm.servo(1), hand.servo(1), arm.servo(2))]


SYNC_READ = 0x82
ALL = {"arm": [1, 2], "hand": [1]}
NONE: dict[str, list[int]] = {"arm": [], "hand": []}


def test_states_and_goals_match_their_joints_although_ids_repeat() -> None:
    bench = Ports().active()
    assert bench.torque() == ALL
    assert bench.goals() == [2048, 1500, 2000]
    np.testing.assert_allclose(bench.hardware.read().position, [0.0, FINGER.position(1500), 0.0])
    bench.hardware.write(JointCommand(at(0.1, 0.02, 0.05), PERIOD_S))
    assert bench.goals() == [j.counts(p) for j, p in ((SHOULDER, 0.1), (FINGER, 0.02), (ELBOW, 0.05))]


@pytest.mark.parametrize("others", [(), ("wheel",)])
def test_noise_is_reported_for_each_bus(others: tuple[str, ...]) -> None:
    """The two buses may also belong to two components."""
    bench = Ports()
    mocks = [MockHardware(name, (name,), bench.clock) for name in others]
    components = ComponentSet([*mocks, bench.hardware], bench.clock)
    configure_all(components)
    bench.servos["hand"].faults.disturbance = Disturbance(seed=1, noise=1.0)
    for _ in range(3):
        components.read()
    lines = components.read().lines
    assert {name: line.noise > 0 for name, line in lines.items()} == {"/dev/arm": False, "/dev/hand": True}


def test_no_torque_before_all_goals_on_all_buses_are_read_back() -> None:
    bench = Ports()
    bench.hardware.configure()
    order: list[str] = []

    def watch(number: int, instruction: Instruction) -> None:
        if switches_torque_on(instruction):
            order.append("torque")
        elif instruction.code == 2 and instruction.parameters[0] == sts.goal_position.address:
            order.append("goal")

    for port in bench.ports.values():
        port.before_write = watch
    bench.hardware.activate()
    assert order == ["goal"] * 3 + ["torque"] * 3


@pytest.mark.parametrize("lost", ["arm", "hand"])
def test_a_port_lost_during_setup_is_reported_with_its_bus_and_joints(lost: str) -> None:
    joints = {"arm": "shoulder (servo 1), elbow (servo 2)", "hand": "finger (servo 1)"}[lost]
    whole = Ports()
    whole.hardware.configure()
    for step in range(len(whole.ports[lost].sent)):
        bench = Ports()
        port = bench.ports[lost]
        port.before_write = lambda number, _, port=port, step=step: port.port.unplug() if number == step else None
        with pytest.raises(PortLost) as caught:
            bench.hardware.configure()
        assert str(caught.value).startswith(f"bus {lost}: /dev/{lost} was unplugged")
        assert str(caught.value).endswith(f"Out of reach: {joints}")


@pytest.mark.parametrize("error", [PortLost("the port was unplugged"), ServoRefused(1, "is wrong")])
def test_notes_of_an_error_are_kept_when_the_bus_is_named(error: DriverError) -> None:
    error.add_note("written before this error: position_p 32 to 16")
    bench = Ports()
    with (
        pytest.raises(type(error), match="bus arm") as caught,
        JointBuses((SHOULDER, FINGER), bench.open()).named("arm"),
    ):
        raise error
    assert caught.value.__notes__ == ["written before this error: position_p 32 to 16"]


@pytest.mark.parametrize("lost", ["arm", "hand"])
@pytest.mark.parametrize("after", range(24))
def test_a_port_lost_during_activation_leaves_no_torque_on_the_other(lost: str, after: int) -> None:
    bench = Ports()
    bench.hardware.configure()
    port = bench.ports[lost]
    begin = len(port.sent)
    port.before_write = lambda number, _: port.port.unplug() if number == begin + after else None
    try:
        bench.hardware.activate()
    except PortLost as error:
        assert str(error).startswith(f"bus {lost}: /dev/{lost} was unplugged")
        other = "hand" if lost == "arm" else "arm"
        assert bench.hardware.state is LifecycleState.INACTIVE
        assert bench.torque()[other] == []
    else:
        assert bench.hardware.state is LifecycleState.ACTIVE


@pytest.mark.parametrize("lost", ["arm", "hand"])
def test_a_port_lost_after_activation_releases_only_servos_limp_before(lost: str) -> None:
    bench = Ports()
    bench.hardware.configure()
    other = "hand" if lost == "arm" else "arm"
    if other == "arm":
        bench.servos["arm"].servo(2).memory.put(sts.goal_position, COUNTS["arm"][1])
        bench.servos["arm"].servo(2).memory.put(sts.torque_enable, 1)

    def lose(number: int, instruction: Instruction) -> None:
        if bench.torque() == ALL and instruction.code == SYNC_READ:
            bench.ports[lost].port.unplug()

    bench.ports[lost].before_write = lose
    with pytest.raises(PortLost, match=f"bus {lost}"):
        bench.hardware.activate()
    assert bench.hardware.state is LifecycleState.INACTIVE
    assert bench.torque()[other] == ([2] if other == "arm" else [])


def test_a_servo_silent_during_activation_leaves_no_torque_on_the_others(
    caplog: pytest.LogCaptureFixture,
) -> None:
    bench = Ports()
    bench.hardware.configure()
    seen: list[int] = []

    def silence(number: int, instruction: Instruction) -> None:
        if switches_torque_on(instruction):
            seen.append(instruction.servo_id)
            bench.servos["arm"].faults.silence(2)

    bench.ports["arm"].before_write = silence
    with pytest.raises(DriverError, match=r"servo 2: does not respond.*\(elbow, bus arm\)"):
        bench.hardware.activate()
    # The goal has enabled the torque of the servo that is now silent. It holds its position.
    assert seen and bench.torque() == {"arm": [2], "hand": []}
    assert "torque may still be on: elbow (bus arm): servo 2" in caplog.text


def test_a_silent_servo_is_reported_with_its_bus_and_hides_no_other() -> None:
    bench = Ports().active()
    bench.servos["arm"].faults.silence(1)
    state = bench.hardware.read()
    assert fault_texts(state) == {"shoulder": "shoulder (bus arm): servo 1 does not respond"}
    bench.servos["arm"].faults.restore(1)
    bench.clock.sleep_until(bench.clock.now() + 1.0)  # silent servos are not read in every cycle
    assert bench.hardware.read().faults == {}
    bench.servos["hand"].faults.silence(1)
    assert fault_texts(bench.hardware.read()) == {"finger": "finger (bus hand): servo 1 does not respond"}


def test_refusals_contain_joint_servo_and_bus() -> None:
    bench = Ports()
    bench.hardware.configure()
    bench.servos["hand"].faults.silence(1)
    with pytest.raises(ActivationError, match=r"not activated: finger \(bus hand\): servo 1 does not respond"):
        bench.hardware.activate()
    assert bench.torque() == NONE


def test_a_dead_bus_differs_from_one_silent_servo() -> None:
    bench = Ports()
    bench.servos["hand"].faults.silence(1)
    bench.servos["arm"].faults.silence(2)
    with pytest.raises(DriverError) as caught:
        bench.hardware.configure()
    arm, hand = str(caught.value).splitlines()
    assert arm.startswith("elbow (bus arm): servo 2: does not respond")
    assert hand == "no servo responds on /dev/hand (bus hand) at any baud rate: check the servos' power and their IDs"


@pytest.mark.parametrize(("lost", "kept"), [("arm", "hand"), ("hand", "arm")])
def test_a_lost_port_is_reported_and_the_other_bus_gets_its_goals(lost: str, kept: str) -> None:
    bench = Ports().active()
    bench.ports[lost].port.unplug()
    joints = {"arm": r"shoulder \(servo 1\), elbow \(servo 2\)", "hand": r"finger \(servo 1\)"}[lost]
    with pytest.raises(PortLost, match=rf"bus {lost}: /dev/{lost} was unplugged.*Out of reach: {joints}$"):
        bench.hardware.read()
    sent = len(bench.ports[kept].sent)
    with pytest.raises(PortLost, match=f"bus {lost}"):
        bench.hardware.write(JointCommand(at(0.1, 0.02, 0.05), PERIOD_S))
    (packet,) = bench.ports[kept].sent[sent:]
    assert packet.code == 0x83


@pytest.mark.parametrize(("lost", "kept"), [("arm", "hand"), ("hand", "arm")])
def test_deactivation_with_a_lost_port_releases_the_other_bus(lost: str, kept: str) -> None:
    bench = Ports().active()
    bench.ports[lost].port.unplug()
    (problem,) = bench.hardware.deactivate(relax=True)
    assert f"bus {lost}" in problem
    assert bench.torque()[kept] == []
    bench.hardware.cleanup()
    assert bench.hardware.state is LifecycleState.UNCONFIGURED


def test_a_missing_port_does_not_prevent_the_release_of_the_other_bus() -> None:
    ports = Ports().active()
    ports.hardware.deactivate(relax=False)
    ports.hardware.cleanup()

    def missing() -> Bus:
        raise PortMissing("there is no /dev/arm")

    def hand() -> Bus:
        return Bus(VirtualPort(ports.servos["hand"], ports.clock), ports.clock)

    hardware = ServoHardware("arm", (SHOULDER, FINGER, ELBOW), {"arm": missing, "hand": hand}, ports.clock)
    assert hardware.disable_torque() == ["there is no /dev/arm"]
    assert ports.torque() == {"arm": [1, 2], "hand": []}
    with pytest.raises(PortMissing, match="there is no /dev/arm"):
        hardware.configure()
    assert hardware.state is LifecycleState.UNCONFIGURED
    with pytest.raises(PortMissing):
        ServoHardware("arm", (SHOULDER, FINGER, ELBOW), {"arm": missing, "hand": missing}, ports.clock).disable_torque()


def test_servos_that_cannot_be_released_are_reported_with_their_joints() -> None:
    bench = Ports().active()
    bench.servos["arm"].faults.silence(1)
    bench.servos["hand"].faults.silence(1)
    arm, hand = bench.hardware.deactivate(relax=True)
    assert arm.startswith("shoulder (bus arm): servo 1: does not respond")
    assert hand.startswith("finger (bus hand): servo 1: does not respond")


STATES = {"arm": ServoState(1, 0, 0.0, 12.0, 30.0), "hand": ServoState(2, 0, 0.0, 12.0, 30.0)}


def test_all_requests_are_sent_before_the_first_answer_is_awaited() -> None:
    log: list[str] = []

    class Line:
        def __init__(self, name: str) -> None:
            self.name = name
            self.counters = BusCounters()

        read_together = True

        def request(self, servo_ids: list[int], deadline_s: float) -> None:
            log.append(f"ask {self.name}")
            self.asked = servo_ids

        def receive(self) -> Mapping[int, Reading]:
            log.append(f"wait {self.name}")
            return dict.fromkeys(self.asked, STATES[self.name])

    joints: list[Joint] = [SHOULDER, FINGER, ELBOW]
    lines = JointBuses(joints, cast(Mapping[str, Bus], {"arm": Line("arm"), "hand": Line("hand")}))
    lines.request(1.0)
    assert lines.receive() == {"shoulder": STATES["arm"], "finger": STATES["hand"], "elbow": STATES["arm"]}
    assert log == ["ask arm", "ask hand", "wait arm", "wait hand"]


# Lost packets


def loses(bench: Ports, wanted: Callable[[Instruction], bool], packets: int) -> list[Instruction]:
    """Lose the next packets of one kind on the bus of the arm."""
    lost: list[Instruction] = []

    def watch(number: int, instruction: Instruction) -> None:
        faults = bench.servos["arm"].faults
        faults.restore(1)
        if wanted(instruction) and instruction.servo_id == 1 and len(lost) < packets:
            lost.append(instruction)
            faults.silence(1)

    bench.ports["arm"].before_write = watch
    return lost


def touches(code: int, address: int) -> Callable[[Instruction], bool]:
    return lambda instruction: instruction.code == code and instruction.parameters[0] == address


SINGLE = {
    "torque_is_on": touches(2, sts.torque_enable.address),
    "goal": touches(2, sts.goal_position.address),
    "limit_torque": touches(3, sts.torque_limit.address),
    "torque_on": touches(3, sts.torque_enable.address),
}


@pytest.mark.parametrize("packets", range(1, ATTEMPTS))
@pytest.mark.parametrize("which", SINGLE)
def test_a_few_lost_packets_do_not_fail_an_activation(which: str, packets: int) -> None:
    bench = Ports()
    bench.hardware.configure()
    lost = loses(bench, SINGLE[which], packets)
    bench.hardware.activate()
    assert len(lost) == packets
    assert bench.torque() == ALL


@pytest.mark.parametrize("which", SINGLE)
def test_too_many_lost_packets_fail_an_activation_without_torque(which: str) -> None:
    bench = Ports()
    bench.hardware.configure()
    lost = loses(bench, SINGLE[which], ATTEMPTS)
    with pytest.raises(DriverError, match="servo 1: does not respond"):
        bench.hardware.activate()
    assert len(lost) == ATTEMPTS
    assert bench.torque() == NONE


@pytest.mark.parametrize("back", [True, False])
def test_the_torque_on_a_lost_bus_is_disabled_if_its_adapter_is_back(back: bool) -> None:
    ports = Ports()
    opened: dict[str, list[VirtualPort]] = {"arm": [], "hand": []}

    def open_bus(name: str) -> Bus:
        if opened[name] and not back:
            raise PortMissing(f"there is no /dev/{name}")
        opened[name].append(VirtualPort(ports.servos[name], ports.clock, name=f"/dev/{name}"))
        return Bus(opened[name][-1], ports.clock)

    openers = {name: partial(open_bus, name) for name in opened}
    hardware = ServoHardware("arm", (SHOULDER, FINGER, ELBOW), openers, ports.clock)
    hardware.configure()
    hardware.activate()
    opened["hand"][0].unplug()
    problems = hardware.deactivate(relax=True)
    if back:
        assert problems == [] and ports.torque() == {"arm": [], "hand": []}
    else:
        assert [text.partition(":")[0] for text in problems] == ["bus hand"]
        assert ports.torque() == {"arm": [], "hand": [1]}
    assert len(opened["arm"]) == 1
    hardware.cleanup()
