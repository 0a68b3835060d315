"""The Dynamixel bus with virtual servos: results of a cycle, and checks during set-up."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.adaptive_timeout import FIRST_REPLY_S
from drivers.bus.backoff import LONGEST_PAUSE_S
from drivers.bus.bus import Bus
from drivers.driver_errors import ServoCorrupt, ServoRefused, ServoSilent
from drivers.servos import x
from drivers.servos.register import Register
from drivers.types import ServoFault, ServoGoal, ServoState
from hal.hal_errors import ActivationError
from hal.joint import Joint
from hal.servos.servo_hardware import ServoHardware
from hal.types import JointCommand, JointLimits
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.line.line import DelayedReply
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.packets.dynamixel import Code, InstructionParser
from sim_backend.packets.instructions import Instruction

MODELS = {1: x.XL430_W250, 2: x.XM430_W350, 7: x.XC330_T288}
IDS = tuple(MODELS)


class Line:
    """Three virtual servos and their bus."""

    def __init__(self, counts: Sequence[int] = (1000, 2000, 3000)) -> None:
        self.clock = SimulatedClock(5.0)
        self.plant = BenchPlant(IDS)
        self.plant.place([(c + 0.5) * 2.0 * math.pi / 4096 for c in counts])
        self.servos = VirtualDynamixelBus.of(self.plant, MODELS)
        self.sent: list[Instruction] = []
        self._parser = InstructionParser()
        self.port = VirtualPort(self.servos, self.clock)
        self.name, self.baud = "line", 1_000_000
        self.discard_input, self.read, self.close = self.port.discard_input, self.port.read, self.port.close
        self.bus = Bus(self, self.clock, MODELS, position_p={1: 1234})

    def write(self, data: bytes) -> None:
        self.sent += self._parser.feed(data)
        self.port.write(data)

    def held(self, servo_id: int, register: Register) -> int:
        return self.servos.servo(servo_id).memory.get(register)

    def put(self, servo_id: int, register: Register, value: int) -> None:
        servo = self.servos.servo(servo_id)
        servo.memory.put(register, value)
        servo.firmware.load_settings()

    def overload(self, servo_id: int) -> None:
        self.servos.servo(servo_id).firmware.protection.status |= 1 << 5


def test_the_bus_has_the_name_of_its_port() -> None:
    bus: Bus = Line().bus
    assert bus.name == "line"


def test_all_states_are_read_in_one_exchange() -> None:
    line = Line()
    states = line.bus.read_states(IDS)
    assert [s.position_counts for s in states.values() if isinstance(s, ServoState)] == [1000, 2000, 3000]
    assert states[1] == ServoState(1000, 0, 0.0, 12.0, 27.0)
    asked = bytes((124, 0, 23, 0, 1, 2, 7))
    # The second request is sent only once, to test whether fast reads are supported.
    assert [(i.code, i.parameters) for i in line.sent] == [
        (Code.SYNC_READ, asked),
        (Code.FAST_SYNC_READ, asked),
    ]


@pytest.mark.parametrize("silent", IDS)
def test_a_silent_servo_does_not_hide_others(silent: int) -> None:
    line = Line()
    line.servos.faults.silence(silent)
    for _ in range(3):
        states = dict(line.bus.read_states(IDS))
        assert states.pop(silent) == ServoFault("silent", f"servo {silent} does not respond")
        assert len(states) == 2
        assert all(isinstance(state, ServoState) for state in states.values())
    assert line.bus.counters.of(silent).silent == 3
    line.servos.faults.restore(silent)
    assert isinstance(line.bus.read_states(IDS)[silent], ServoState)


@pytest.mark.parametrize("silent", IDS)
def test_servos_hidden_by_a_silent_servo_are_read_in_the_next_cycle(silent: int) -> None:
    line = Line()
    line.servos.faults.silence(silent)
    line.bus.read_states(IDS, line.clock.now() + 0.012)
    for _ in range(20):
        line.clock.sleep_until(line.clock.now() + 0.05)
        states = line.bus.read_states(IDS, line.clock.now() + 0.012)
        assert [i for i in IDS if not isinstance(states[i], ServoState)] == [silent]


def test_a_silent_servo_costs_no_wait_and_is_found_again() -> None:
    line = Line()
    line.servos.faults.silence(2)
    line.bus.read_states(IDS, line.clock.now() + 0.012)
    assert line.bus.counters.of(2).retries == 2
    assert line.bus.counters.of(2).skipped == 0
    begin_s = line.clock.now()
    assert isinstance(line.bus.read_states(IDS, begin_s + 0.012)[2], ServoFault)
    assert line.clock.now() - begin_s < 0.0015
    assert line.bus.counters.of(2).skipped == 1
    line.servos.faults.restore(2)
    line.clock.sleep_until(begin_s + LONGEST_PAUSE_S)
    assert isinstance(line.bus.read_states(IDS, line.clock.now() + 0.012)[2], ServoState)


def test_all_servos_are_read_again_after_a_stall() -> None:
    line = Line()
    for servo_id in IDS:
        line.servos.faults.silence(servo_id)
    line.bus.read_states(IDS, line.clock.now() + 0.012)
    for servo_id in IDS:
        line.servos.faults.restore(servo_id)
    states = line.bus.read_states(IDS, line.clock.now() + 0.012)
    assert all(isinstance(state, ServoState) for state in states.values())


def test_a_late_reply_is_not_a_reply_to_the_next_request() -> None:
    line = Line()
    held: list[bytes] = []
    read = line.port.read

    def late(size: int, deadline_s: float) -> bytes:
        held.append(read(size, deadline_s))
        return b""

    line.read = late
    assert not any(isinstance(state, ServoState) for state in line.bus.read_states((1,)).values())
    line.plant.place([0.0] * 3)
    line.servos.advance(line.clock.now() + 0.002)
    line.read = lambda size, deadline_s: held.pop() if held and any(held) else read(size, deadline_s)
    state = line.bus.read_states((1,))[1]
    assert not isinstance(state, ServoState) or state.position_counts < 10


def test_a_silent_bus_costs_at_most_two_waits() -> None:
    line = Line()
    for servo_id in IDS:
        line.servos.faults.silence(servo_id)
    begin_s = line.clock.now()
    assert {r.kind for r in line.bus.read_states(IDS).values() if isinstance(r, ServoFault)} == {"silent"}
    assert line.clock.now() - begin_s == pytest.approx(
        2 * FIRST_REPLY_S, abs=3e-3
    )  # and a short wait for the last servo


def test_a_corrupt_reply_is_reported_and_requested_again_if_there_is_time() -> None:
    line = Line()
    line.servos.faults.corrupt_next(1)
    states = dict(line.bus.read_states(IDS))
    assert states.pop(1) == ServoFault("corrupt", "servo 1 replied with a wrong checksum")
    assert all(isinstance(state, ServoState) for state in states.values())
    line = Line()
    line.servos.faults.corrupt_next(1)
    assert all(isinstance(s, ServoState) for s in line.bus.read_states(IDS, line.clock.now() + 0.05).values())
    assert line.bus.counters.of(1).retries == 1


def test_the_alert_bit_is_an_alarm_and_not_an_error() -> None:
    line = Line()
    line.overload(2)
    states = line.bus.read_states(IDS)
    assert [s.alarms for s in states.values() if isinstance(s, ServoState)] == [(), ("overload",), ()]
    (asked,) = [i.parameters for i in line.sent if i.parameters[:2] == bytes((x.hardware_error_status.address, 0))]
    assert asked[4:] == bytes((2,))
    assert line.bus.read(2, x.goal_position) == 2000
    line.bus.write(2, x.led, 1)
    account = line.bus.counters.of(2)
    assert (account.alarms, account.replies) == (3, 4)  # the reply with the names is not counted as another alarm


def test_an_alarm_is_reported_even_if_its_name_cannot_be_read() -> None:
    line = Line()
    line.overload(2)
    receive = line.servos.receive

    def spoiled(data: bytes, now_s: float, baud: int = 1_000_000) -> list[DelayedReply]:
        if data[8] == x.hardware_error_status.address:
            line.servos.faults.corrupt_next(2)
        return receive(data, now_s, baud)

    line.servos.receive = spoiled  # type: ignore[method-assign]
    state = line.bus.read_states(IDS)[2]
    assert isinstance(state, ServoState)
    assert state.alarms == ("hardware error",)


def test_identify_distinguishes_silent_wrong_and_misconfigured_servos() -> None:
    line = Line()
    for servo_id, model in MODELS.items():
        line.bus.identify(servo_id, model)
    with pytest.raises(ServoSilent, match="does not respond"):
        line.bus.identify(3, x.XL430_W250)
    with pytest.raises(ServoRefused, match=r"is model 1060 \(xl430-w250\), not 1020 \(xm430-w350\)"):
        line.bus.identify(1, x.XM430_W350)
    for register, value, says in (
        (x.operating_mode, 1, "operating mode 1: set it to 3"),
        (x.drive_mode, 4, "time-based profile"),
        (x.drive_mode, 8, "enables its torque at every goal"),
    ):
        line = Line()
        line.put(1, register, value)
        with pytest.raises(ServoRefused, match=says):
            line.bus.identify(1, x.XL430_W250)


def test_the_reason_of_a_refusal_is_reported() -> None:
    line = Line()
    with pytest.raises(ServoRefused, match="value beyond its limit"):
        line.bus.write(1, x.goal_position, 5000)
    with pytest.raises(ServoRefused, match="does not have this register"):
        line.bus.write(1, x.present_position, 0)
    line.bus.torque_on(1)
    with pytest.raises(ServoRefused, match="locked while torque is enabled"):
        line.bus.write(1, x.drive_mode, 1)
    line.servos.faults.corrupt_next(1)
    with pytest.raises(ServoCorrupt):
        line.bus.read(1, x.goal_position)


def test_goals_with_velocities_are_written_in_one_packet() -> None:
    line = Line()
    line.bus.write_goals({1: ServoGoal(1500, 100), 7: ServoGoal(2500)})
    assert [i.code for i in line.sent] == [Code.SYNC_WRITE]
    assert [line.bus.goal(i) for i in IDS] == [1500, 2000, 2500]
    assert [line.held(i, x.profile_velocity) for i in IDS] == [7, 0, 0]


@given(st.integers(0, x.profile_velocity.largest))
def test_a_servo_is_never_slower_than_requested(velocity: int) -> None:
    line = Line()
    line.bus.write_goals({1: ServoGoal(1500, velocity)})
    units = line.held(1, x.profile_velocity)
    assert units * x.VELOCITY_UNIT_COUNTS_S >= velocity
    assert (units - 1) * x.VELOCITY_UNIT_COUNTS_S < velocity or units == 0
    assert (units == 0) == (velocity == 0)


def test_torque_on_writes_the_gain_and_torque_off_continues_after_failures() -> None:
    line = Line()
    line.put(1, x.profile_acceleration, 5)
    for servo_id in IDS:
        line.bus.torque_on(servo_id)
    assert all(line.bus.torque_is_on(i) for i in IDS)
    assert [line.held(i, x.position_p_gain) for i in IDS] == [1234, 800, 900]
    assert line.held(1, x.profile_acceleration) == 0
    line.servos.faults.silence(2)
    assert [error.servo_id for error in line.bus.torque_off(IDS)] == [2]
    assert [line.held(i, x.torque_enable) for i in IDS] == [0, 1, 0]


def test_the_torque_limit_is_a_share_and_stays_below_the_persistent_limit() -> None:
    line = Line()
    line.bus.limit_torque(1, 0.5)
    line.put(2, x.pwm_limit, 400)
    line.bus.limit_torque(2, 1.0)
    assert [line.held(i, x.goal_pwm) for i in IDS] == [442, 399, 885]


# The hardware component above the bus

LIMITS = JointLimits(-2.5, 2.5, 4.0, 12.0, 120.0)
JOINTS = tuple(Joint(f"joint{i}", i, model, LIMITS) for i, model in MODELS.items())


def hardware(line: Line) -> ServoHardware:
    component = ServoHardware("arm", JOINTS, lambda: line.bus, line.clock)
    component.configure()
    return component


def switches_on(instruction: Instruction) -> bool:
    return instruction.code == Code.WRITE and instruction.parameters == b"\x40\x00\x01"


def test_torque_is_enabled_only_if_every_goal_is_the_measured_position() -> None:
    line = Line()
    component = hardware(line)
    for servo_id in IDS:
        line.put(servo_id, x.goal_position, 100)  # left over from another program
    line.sent.clear()
    component.activate()
    first = next(n for n, i in enumerate(line.sent) if switches_on(i))
    before = line.sent[:first]
    assert sum(i.code == Code.SYNC_WRITE for i in before) == 1
    asked = [i.servo_id for i in before if i.code == Code.READ and i.parameters[:2] == b"\x74\x00"]
    assert asked == list(IDS)
    assert [line.held(i, x.goal_position) for i in IDS] == [1000, 2000, 3000]
    assert all(line.held(i, x.torque_enable) for i in IDS)


def test_torque_is_not_enabled_if_one_servo_is_missing() -> None:
    line = Line()
    component = hardware(line)
    line.servos.faults.silence(7)
    with pytest.raises(ActivationError, match="servo 7 does not respond"):
        component.activate()
    assert not any(switches_on(i) for i in line.sent)


def test_a_commanded_position_is_reached() -> None:
    line = Line((2048, 2048, 2048))
    component = hardware(line)
    component.activate()
    goal = np.array([0.3, -0.3, 0.2])
    for _ in range(30):
        component.write(JointCommand(goal, 0.05))
        line.clock.sleep_until(line.clock.now() + 0.05)
        state = component.read()
    assert np.abs(state.position - goal).max() < 0.05
    assert not state.faults
