"""Activation of Dynamixel servos that were turned by hand, or that another program left in extended position mode."""

import logging
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from drivers.bus.bus import Bus
from drivers.driver_errors import DriverError
from drivers.servos import x
from drivers.types import ServoState
from hal.hal_errors import ActivationError
from hal.joint import Joint
from hal.lifecycle import LifecycleState
from hal.servos.leader_arm import LeaderArm
from hal.servos.servo_hardware import ServoHardware
from hal.types import JointCommand, JointLimits
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant

TURN = 4096
START = 2374
PERIOD_S = 0.05
STEPS = 65
LIMITS = JointLimits(-3.2, 3.2, 4.0, 12.0, 120.0)


class Turned:
    """One servo in a mode, with a homing offset, that was turned by hand while it was limp."""

    MODEL = x.XL430_W250

    def __init__(self, mode: int, offset: int, turns: int, **joint: object) -> None:
        self.clock = SimulatedClock(5.0)
        self.plant = BenchPlant((1,))
        self._place(0.0)
        self.line = VirtualDynamixelBus.of(self.plant, {1: self.MODEL})
        self.servo = self.line.servo(1)
        self.servo.memory.save(x.operating_mode, mode)
        self.servo.memory.save(x.homing_offset, offset)
        self.servo.power_cycle()
        for step in range(STEPS * abs(turns) + 1):
            self._place(math.copysign(step / STEPS, turns))
            self.clock.sleep_until(self.clock.now() + 0.005)
            self.line.advance(self.clock.now())
        limits: JointLimits = joint.pop("limits", LIMITS)  # type: ignore[assignment]
        self.joint = Joint("wrist", 1, self.MODEL, limits, **joint)  # type: ignore[arg-type]
        self.open()

    def open(self) -> None:
        """Start a new driver that does not know the servo yet."""
        self.bus = Bus(VirtualPort(self.line, self.clock), self.clock, {1: self.MODEL})
        self.hardware: ServoHardware = ServoHardware("arm", [self.joint], lambda: self.bus, self.clock)

    def turn(self, counts: Sequence[float]) -> None:
        """Turn the shaft by hand to each of these counts, one per period, and read it if it is configured."""
        for count in counts:
            self._place((count - START) / TURN)
            self.clock.sleep_until(self.clock.now() + PERIOD_S)
            self.line.advance(self.clock.now())
            if self.hardware.state is not LifecycleState.UNCONFIGURED:
                self.hardware.read()

    def _place(self, turns: float) -> None:
        self.plant.place([(START + 0.5 + turns * TURN) / TURN * math.tau])

    @property
    def shaft(self) -> float:
        """Position of the shaft in counts, including all turns."""
        return float(self.plant.joints.position[0]) / math.tau * TURN

    def reads(self) -> int:
        reading = self.bus.read_states([1])[1]
        assert isinstance(reading, ServoState)
        return reading.position_counts

    def activate(self) -> None:
        self.hardware.configure()
        self.hardware.activate()

    def command(self, position: float, periods: int) -> None:
        for _ in range(periods):
            self.hardware.write(JointCommand(np.array([position]), PERIOD_S))
            self.clock.sleep_until(self.clock.now() + PERIOD_S)
            self.hardware.read()


@pytest.mark.parametrize(
    ("mode", "offset", "turns", "reads"),
    [
        (3, 0, 2, START),
        (3, 0, -2, START),
        (3, 1000, 1, START + 1000),
        (3, -1000, -1, START - 1000),
        (3, 1800, 2, START),
        (4, 0, 2, START),
        (4, 1500, -3, START + 1500),
        (4, -2000, 2, START - 2000),
        (4, 1900, 1, START + 1900 - TURN),
    ],
)
def test_a_servo_that_was_turned_by_hand_is_activated_where_it_stands(
    mode: int, offset: int, turns: int, reads: int
) -> None:
    arm = Turned(mode, offset, turns)
    before = arm.shaft
    arm.activate()
    reads %= TURN
    assert arm.reads() == pytest.approx(reads, abs=1)
    arm.command(arm.joint.position(reads), 20)
    assert arm.shaft == pytest.approx(before, abs=2.0)
    nearer = 2048 + (reads - 2048) // 2
    arm.command(arm.joint.position(nearer), 60)
    assert arm.reads() == pytest.approx(nearer, abs=20)
    assert arm.shaft - before == pytest.approx(nearer - reads, abs=20)


def test_dropped_turns_are_not_reported_as_a_leap(caplog: pytest.LogCaptureFixture) -> None:
    arm = Turned(3, 0, 2)
    with caplog.at_level(logging.INFO):
        arm.activate()
    assert [message for message in caplog.messages if "whole turns" in message] == [
        "wrist (servo 1) has counted whole turns while it was limp: restarting it"
    ]
    assert not [message for message in caplog.messages if "from the previous reading" in message]
    assert arm.hardware.read().faults == {}


def test_a_lost_restart_is_repeated() -> None:
    arm = Turned(3, 0, 2)
    reboot, lost = arm.bus.reboot, list[int]()

    def sometimes(servo_id: int) -> None:
        if lost:
            reboot(servo_id)
        lost.append(servo_id)

    arm.bus.reboot = sometimes  # type: ignore[method-assign]
    before = arm.shaft
    arm.activate()
    arm.command(arm.joint.position(START), 20)
    assert len(lost) == 2 and arm.shaft == pytest.approx(before, abs=2.0)


def test_a_servo_that_keeps_its_turns_gets_no_torque() -> None:
    arm = Turned(3, 0, 2)
    arm.bus.reboot = lambda servo_id: None  # type: ignore[method-assign]
    turned = r"^not activated: .* \(servo \d+\) .* it has counted 2 turns\. Hold the arm"
    with pytest.raises(ActivationError, match=turned):
        arm.activate()
    assert arm.servo.memory.get(x.torque_enable) == 0


@pytest.mark.parametrize("turns", [0, 2])
def test_an_arm_from_lerobot_keeps_its_mode_and_its_offset(turns: int, caplog: pytest.LogCaptureFixture) -> None:
    arm = Turned(4, -2000, turns)
    with caplog.at_level(logging.WARNING):
        arm.activate()
    assert arm.servo.memory.get(x.operating_mode) == 4
    (said,) = [message for message in caplog.messages if "extended position mode" in message]
    assert said.startswith("wrist (servo 1) is in extended position mode with a homing_offset of -2000")
    assert "servoloop calibrate" in said


def test_a_servo_that_was_calibrated_in_position_mode_is_not_driven_in_another_mode() -> None:
    arm = Turned(4, 1800, 0, homing_offset=1800)
    with pytest.raises(DriverError, match=r"is in operating mode 4: set it to 3 \(position\)"):
        arm.activate()


@pytest.mark.parametrize(
    ("offset", "advice"),
    [
        (0, r"set it to 3 \(position\)"),
        (1024, r"set it to 3 \(position\)"),
        (-1025, r"set it to 4 \(extended position\), because position mode would ignore its homing_offset of -1025"),
    ],
)
def test_the_advice_for_another_mode_keeps_the_homing_offset(offset: int, advice: str) -> None:
    arm = Turned(3, offset, 0)
    arm.servo.memory.save(x.operating_mode, 16)
    with pytest.raises(DriverError, match=advice):
        arm.activate()


def test_turns_that_are_lost_in_a_restart_do_not_move_the_joint() -> None:
    arm = Turned(4, -2000, 2)
    arm.activate()
    arm.command(arm.joint.position(START - 2000), 10)
    arm.servo.power_cycle()
    before = arm.shaft
    arm.command(arm.joint.position(START - 2000), 10)
    arm.hardware.deactivate(relax=False)
    arm.hardware.activate()
    arm.command(arm.joint.position(START - 2000), 20)
    assert arm.shaft == pytest.approx(before, abs=3.0)


class Weak(Turned):
    """A servo that a hand can push away from its goal."""

    MODEL = x.XL330_M288

    def push(self, position: float, load_nm: float, periods: int) -> None:
        """Push the joint while its position is commanded. The goal and the turn of the servo must not change."""
        self.plant.load_nm[0] = load_nm
        for _ in range(periods):
            self.command(position, 1)
            assert self.servo.memory.get(x.goal_position) == pytest.approx(self.joint.counts(position), abs=200)
        self.plant.load_nm[0] = 0.0


@pytest.mark.parametrize(("counts", "load_nm"), [(4040, 0.3), (60, -0.3)])
@pytest.mark.parametrize("activates", [False, True])
def test_a_joint_that_is_pushed_past_the_end_of_its_turn_stays_in_its_turn(
    counts: int, load_nm: float, activates: bool
) -> None:
    arm = Weak(4, 0, 0, position_p=400)
    arm.activate()
    for at in range(START, counts, 60 if load_nm > 0.0 else -60):
        arm.command(arm.joint.position(at), 1)
    position = arm.joint.position(counts)
    arm.command(position, 40)
    before = arm.shaft
    arm.push(position, load_nm, 10)
    assert abs(arm.shaft - before) > 70 and not 0 <= arm.reads() < TURN
    if activates:
        arm.hardware.deactivate(relax=False)
        arm.hardware.activate()
    arm.command(position, 40)
    assert arm.shaft == pytest.approx(before, abs=20)


@pytest.mark.parametrize("restarts", [False, True])
def test_a_pushed_joint_keeps_its_turn_in_repeated_activations(restarts: bool) -> None:
    """A goal outside the turn would be taken as a goal in the next turn."""
    arm = Weak(4, 0, 0, position_p=400, limits=replace(LIMITS, lower=-3.14, upper=3.14))
    arm.activate()
    for at in range(START, 4040, 60):
        arm.command(arm.joint.position(at), 1)
    arm.command(arm.joint.position(4040), 40)
    before = arm.shaft
    arm.plant.load_nm[0] = 0.3
    arm.command(arm.joint.position(4040), 10)
    for _ in range(2):
        arm.hardware.deactivate(relax=False)
        if restarts:
            arm.hardware.cleanup()
            arm.open()
            arm.hardware.configure()
        arm.hardware.activate()
    arm.plant.load_nm[0] = 0.0
    here = float(arm.hardware.read().position[0])
    for part in np.linspace(0.0, 1.0, 60):
        arm.command(here + (3.0 - here) * part, 1)
    arm.command(3.0, 20)
    assert arm.shaft == pytest.approx(before, abs=100)


@pytest.mark.parametrize("leader", [False, True])
@pytest.mark.parametrize(("begin", "end"), [(START, START + TURN), (START, START - TURN), (-30, START)])
def test_a_limp_joint_is_turned_by_hand_while_it_is_read(
    caplog: pytest.LogCaptureFixture, begin: int, end: int, leader: bool
) -> None:
    """Its position is always within its turn, so its servo does not have to be restarted. A leader is never driven."""
    arm = Turned(4, 0, 0)
    arm.turn([begin])
    if leader:
        bus = arm.bus
        arm.hardware = LeaderArm([arm.joint], lambda: bus, arm.clock)
    arm.hardware.configure()
    arm.turn([*np.linspace(begin, end, 100), end, end, end])
    assert arm.hardware.read().position[0] == pytest.approx(arm.joint.position(START), abs=0.01)
    if not leader:
        with caplog.at_level(logging.INFO):
            arm.hardware.activate()
        assert not any("restarting" in message for message in caplog.messages)


class LimitedByCurrent(Turned):
    """A servo in current-based position mode, in which LeRobot leaves the gripper of a Koch."""

    MODEL = x.XL330_M288


@pytest.mark.parametrize(("offset", "turns"), [(0, 0), (-2000, 2), (1500, -3)])
def test_a_servo_in_current_based_position_mode_is_used_in_it(offset: int, turns: int) -> None:
    arm = LimitedByCurrent(5, offset, turns)
    before = arm.shaft
    arm.activate()
    reads = (START + offset) % TURN
    assert arm.servo.memory.get(x.operating_mode) == 5 and arm.reads() == pytest.approx(reads, abs=1)
    arm.command(arm.joint.position(reads), 20)
    assert arm.shaft == pytest.approx(before, abs=3.0)
    nearer = 2048 + (reads - 2048) // 2
    arm.command(arm.joint.position(nearer), 60)
    assert arm.reads() == pytest.approx(nearer, abs=20)


def test_a_goal_current_below_the_current_limit_is_kept_and_reported(caplog: pytest.LogCaptureFixture) -> None:
    arm = LimitedByCurrent(5, 0, 0)
    arm.servo.memory.put(x.goal_current, 300)
    with caplog.at_level(logging.WARNING):
        arm.activate()
    assert arm.servo.memory.get(x.goal_current) == 300
    (said,) = [message for message in caplog.messages if "goal_current" in message]
    assert said == (
        "wrist (servo 1) is in current-based position mode, and another program has set its goal_current to 300 of "
        "1750: the joint is weaker than usual. To reset goal_current, reboot the servo (servoloop reboot)"
    )


def test_a_servo_without_goal_current_is_refused() -> None:
    arm = LimitedByCurrent(5, 0, 0)
    arm.servo.memory.put(x.goal_current, 0)
    with pytest.raises(DriverError, match=r"wrist: servo 1: would have no torque, because its goal_current is 0 in"):
        arm.activate()


def test_a_servo_that_was_calibrated_in_extended_position_mode_may_be_limited_by_its_current() -> None:
    arm = LimitedByCurrent(5, 1500, 0, homing_offset=1500, extended=True)
    arm.activate()
    assert arm.reads() == pytest.approx(START + 1500, abs=1)
