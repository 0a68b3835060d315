"""Tests of the setup on buses that lose packets or have two servos with the same ID."""

from collections.abc import Sequence
from dataclasses import replace

import pytest

from drivers.bus.bus import Bus
from drivers.bus.retry import ATTEMPTS
from drivers.driver_errors import DriverError
from drivers.servos import sts
from drivers.servos.register import Register
from drivers.types import ServoState
from hal.hal_errors import ActivationError
from hal.joint import Joint
from hal.lifecycle import LifecycleState
from hal.servos.servo_hardware import ServoHardware
from hal.types import JointLimits
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.faults import Disturbance
from sim_backend.line.rig import Rig
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.packets.instructions import Instruction
from sim_backend.servos.sts.servo import VirtualServo
from tests.drivers.fault_lines import CYCLES, IDS, KINDS, Kind, Line
from tests.hal.bench import JOINTS, Bench

LIMITS = JointLimits(-5.0, 5.0, 3.0, 5.0, 50.0)
plain_kinds = pytest.mark.parametrize(
    "kind", [kind for kind in KINDS if not kind.with_goals and not kind.mapped], ids=lambda kind: kind.name
)


def arm_on(line: Line) -> ServoHardware:
    joints = [
        Joint(f"j{i}", i, model, LIMITS, zero_counts=(model.last_count + 1) // 2)
        for i, model in line.kind.models.items()
    ]
    return ServoHardware("arm", joints, lambda: line.bus, line.clock)


def loses_the_question_for(register: Register, bench: Bench, packets: int) -> None:
    """Lose the next packets to the elbow (servo 2)."""
    lost: list[Instruction] = []

    def watch(number: int, instruction: Instruction) -> None:
        bench.servos.faults.restore(2)
        wanted = instruction.code == 2 and instruction.parameters[0] == register.address
        if wanted and instruction.servo_id == 2 and len(lost) < packets:
            lost.append(instruction)
            bench.servos.faults.silence(2)

    bench.port.before_write = watch


@pytest.mark.parametrize("packets", range(1, ATTEMPTS))
def test_a_few_lost_packets_do_not_fail_a_configuration(packets: int) -> None:
    bench = Bench()
    loses_the_question_for(sts.model_number, bench, packets)
    bench.hardware.configure()
    assert bench.hardware.state is LifecycleState.INACTIVE


def test_many_lost_packets_fail_it_but_the_servo_is_not_reported_as_silent() -> None:
    bench = Bench()
    loses_the_question_for(sts.model_number, bench, 2 * ATTEMPTS)
    with pytest.raises(DriverError, match=r"^elbow: servo 2: responds to pings but not to reads: set its status_level"):
        bench.hardware.configure()


@pytest.mark.parametrize("register", [sts.status_level, sts.min_position], ids=lambda register: register.name)
def test_a_servo_that_answers_intermittently_is_reported_with_joint_and_id(register: Register) -> None:
    """The lost reply may belong to a request for the model or for a setting."""
    bench = Bench()
    loses_the_question_for(register, bench, ATTEMPTS)
    with pytest.raises(DriverError, match=r"^elbow: servo 2: responds only intermittently: check"):
        bench.hardware.configure()


@pytest.mark.soak
@plain_kinds
def test_an_arm_on_a_bad_bus_is_set_up(kind: Kind) -> None:
    for seed in range(CYCLES // 100):
        is_set_up(kind, seed)


@pytest.mark.parametrize("seed", [2, 8])
def test_an_ax_arm_on_a_bad_bus_is_set_up(seed: int) -> None:
    """This test also runs in `make test`, which omits soak tests. With an AX, most requests are sent after the first
    goals and before torque is enabled."""
    is_set_up(next(kind for kind in KINDS if kind.name == "ax-12a"), seed)


def is_set_up(kind: Kind, seed: int) -> None:
    """Set up an arm on a bus that loses packets, and check that every servo holds its position."""
    line = Line(kind)
    line.faults.disturbance = Disturbance(seed=seed, drop=0.03, flip=0.02, noise=0.02, miss=0.03)
    arm = arm_on(line)
    arm.configure()
    arm.activate()
    line.faults.disturbance = None
    states = line.bus.read_states(IDS)
    for servo_id in IDS:
        state = states[servo_id]
        assert isinstance(state, ServoState)
        assert line.bus.torque_is_on(servo_id)
        assert abs(line.bus.goal(servo_id) - state.position_counts) <= 1


@plain_kinds
def test_a_bus_that_is_too_bad_is_reported(kind: Kind) -> None:
    failures: list[str] = []
    for seed in range(10):
        line = Line(kind)
        line.faults.disturbance = Disturbance(seed=seed, drop=0.3, flip=0.2, noise=0.2)
        try:
            arm_on(line).configure()
        except DriverError as error:
            failures.append(str(error))
    assert failures
    assert all("intermittently" in text for text in failures), failures


# Two servos with the same ID


class Doubled:
    """The arm of the bench, with a second servo that gets the ID of the elbow later."""

    def __init__(self, joints: Sequence[Joint] = JOINTS) -> None:
        plant = BenchPlant((1, 2, 7, 9))
        plant.place([3.2, 3.1, 2.3, 4.5])
        servos = [VirtualServo(sts.STS3215, coupling.servo_id) for coupling in plant.couplings]
        self.twin = servos[-1]
        clock = SimulatedClock(1000.0)
        port = VirtualPort(VirtualBus(Rig(servos, plant)), clock)
        self.hardware = ServoHardware("arm", joints, lambda: Bus(port, clock), clock)

    def double(self) -> None:
        self.twin.memory.put(sts.servo_id, 2)


def test_two_servos_with_the_same_id_are_reported_at_configuration() -> None:
    bench = Doubled()
    bench.double()
    with pytest.raises(
        DriverError, match=r"^elbow: servo 2: responds, but every reply is corrupted: do two servos have ID 2"
    ):
        bench.hardware.configure()
    assert bench.hardware.state is LifecycleState.UNCONFIGURED


def test_a_duplicate_id_plugged_in_later_is_reported_at_activation() -> None:
    bench = Doubled()
    bench.hardware.configure()
    bench.double()
    with pytest.raises(ActivationError, match=r"^not activated: elbow: servo 2: .*do two servos have ID 2"):
        bench.hardware.activate()


def test_a_servo_missing_since_configuration_is_not_searched_at_other_baud_rates() -> None:
    """The search would block other components, which may be moving."""
    bench = Bench().configured()
    bench.servos.faults.silence(2)
    begin_s = bench.clock.now()
    with pytest.raises(ActivationError, match="elbow: servo 2 does not respond"):
        bench.hardware.activate()
    assert bench.clock.now() - begin_s < 0.6


def test_all_kinds_of_problems_are_reported_together() -> None:
    bench = Doubled([replace(JOINTS[0], model=sts.STS3250), *JOINTS[1:]])
    bench.double()
    with pytest.raises(DriverError) as caught:
        bench.hardware.configure()
    shoulder, elbow = str(caught.value).splitlines()
    assert shoulder.startswith("shoulder: servo 1: is model 777")
    assert elbow.startswith("elbow: servo 2: responds, but every reply is corrupted")
