"""Unsafe commands never reach the bus, in many random scenarios drawn by seed."""

import random
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
import pytest

from controller.action_goals import GoalStatus
from controller.interface import Controller
from controller.parameters import Parameters
from controller.shutdown import shut_down
from controller.trajectory.goal import GoalHandle, GoalPoint, TrajectoryGoal
from drivers.bus.bus import Bus
from drivers.driver_errors import DriverError, PortLost
from drivers.protocol import v1
from drivers.servos import sts
from drivers.servos.register import Register
from drivers.types import ServoGoal
from hal.hal_errors import ActivationError, HalError
from hal.lifecycle import LifecycleState
from hal.types import FloatArray, JointState
from servoloop.campaign.invariants.commands.wire_monitor import WireMonitor
from servoloop.simulation.stack import SimulatedStack
from sim_backend.faults.lines import WRITE
from tests.drivers.fault_lines import CYCLES
from tests.stack.rig import ARM, BINS, PICK, READY

POSES = (READY, PICK, *BINS.values(), (0.0,) * 6)
SCENARIO_S = 2.5


@dataclass(slots=True)
class Rogue:
    """Defective controller that sometimes commands NaN, a huge value or the opposite end of a joint's range."""

    inner: Controller
    chance: random.Random
    command: FloatArray = field(default_factory=lambda: np.empty(0))

    @property
    def name(self) -> str:
        return self.inner.name

    @property
    def kind(self) -> str:
        return self.inner.kind

    @property
    def parameters(self) -> Parameters:
        return self.inner.parameters

    @property
    def command_interfaces(self) -> tuple[str, ...]:
        return self.inner.command_interfaces

    @property
    def state_interfaces(self) -> tuple[str, ...]:
        return self.inner.state_interfaces

    def activate(self, state: JointState, command: FloatArray) -> None:
        self.inner.activate(state, command)

    def deactivate(self, reason: str = "") -> None:
        self.inner.deactivate(reason)

    def settled(self) -> bool:
        return self.inner.settled()

    def update(self, state: JointState, now_s: float, period_s: float) -> None:
        self.inner.update(state, now_s, period_s)
        self.command = self.inner.command.copy()
        if self.command_interfaces and self.chance.random() < 0.3:
            wrong = self.chance.choice((np.nan, np.inf, -np.inf, 1e9, -1e9, 0.0, 3.0, -3.0))
            self.command[self.chance.randrange(len(self.command))] = wrong
        if self.chance.random() < 0.005:
            raise RuntimeError("a controller's bug")


class RogueStack(SimulatedStack):
    """Stack whose controllers may be defective."""

    def __init__(self, chance: random.Random, rogue: bool) -> None:
        self.chance, self.rogue = chance, rogue
        super().__init__()

    def wrapped(self, controller: Controller) -> Controller:
        return Rogue(controller, self.chance) if self.rogue else controller


class Scenario:
    """Random scenario on one rig."""

    def __init__(self, seed: int, rogue: bool) -> None:
        self.chance = random.Random(seed)
        self.rig = RogueStack(self.chance, rogue)
        rig = self.rig
        self.monitor = WireMonitor(rig.files.robot.joints, rig.bus, rig.loop.period_s)
        rig.port.on_write = self.monitor.see
        rig.after_cycle = self.mischief
        self.handles: list[GoalHandle] = []

    def play(self) -> list[str]:
        """Run the scenario from configuration to shutdown, and return the failures of the shutdown."""
        self.rig.up()
        with suppress(PortLost, RuntimeError):  # such an error ends the program
            self.rig.run(SCENARIO_S)
        park = self.rig.files.robot.file.park
        assert park is not None
        relax, hurried = self.chance.random() < 0.5, self.chance.random() < 0.2
        return shut_down(self.rig.loop, relax, park.pose, park.velocity_scale, lambda: hurried)

    def mischief(self) -> None:
        """Run the events of one cycle."""
        chance, rig = self.chance, self.rig
        acts: list[tuple[float, Callable[[], None]]] = [
            (0.08, self.send_goal),
            (0.04, self.cancel_one),
            (0.08, self.tell_hand),
            (0.03, lambda: rig.bus.faults.silence(chance.randint(1, 7))),
            (0.20, lambda: rig.bus.faults.restore(chance.randint(1, 7))),
            (0.10, lambda: rig.bus.faults.corrupt_next(chance.randint(1, 7), chance.randint(1, 3))),
            (0.02, lambda: rig.clock.sleep_until(rig.clock.now() + chance.uniform(0.01, 0.5))),
            (0.004, rig.virtual_port.unplug),
        ]
        for probability, act in acts:
            if chance.random() < probability:
                act()

    def send_goal(self) -> None:
        chance = self.chance
        pose = chance.choice((*POSES, tuple(chance.uniform(-2.0, 2.0) for _ in ARM)))
        goal = TrajectoryGoal(ARM, (GoalPoint(pose, chance.uniform(0.0, 3.0)),))
        if self.rig.arm.check(goal) is None:
            self.handles.append(self.rig.arm.submit(goal))

    def cancel_one(self) -> None:
        if self.handles:
            self.rig.arm.cancel(self.chance.choice(self.handles))

    def tell_hand(self) -> None:
        self.rig.hand.submit([self.chance.choice((0.0, 0.05, 0.5, -1.0, float("nan")))])


@pytest.mark.soak
@pytest.mark.parametrize("rogue", [False, True], ids=["sane", "rogue"])
@pytest.mark.parametrize("seed", range(CYCLES // 100))
def test_no_unsafe_command_reaches_the_bus(seed: int, rogue: bool) -> None:
    scenario = Scenario(seed, rogue)
    scenario.play()
    assert scenario.monitor.broken == []
    assert scenario.monitor.torque_on_seen == 7
    assert scenario.monitor.goals_seen >= 7
    assert all(handle.done for handle in scenario.handles)
    assert scenario.rig.hardware.state is LifecycleState.UNCONFIGURED


def test_monitor_detects_unsafe_writes() -> None:
    """The monitor detects every write that bypasses the layers of the stack."""
    scenario = Scenario(3, rogue=False)
    rig = scenario.rig
    rig.after_cycle = lambda: None
    rig.up()
    rig.run(0.1)
    joint = rig.files.robot.joints[0]
    bus = Bus(rig.port, rig.clock)
    assert scenario.monitor.broken == []
    bus.write_goals({joint.servo_id: ServoGoal(joint.counts(0.0))})  # the servo moves as fast as it can
    bus.write_goals({joint.servo_id: ServoGoal(joint.counts(0.0) + 400, 500)})  # the goal jumps
    bus.write_goals(
        {joint.servo_id: ServoGoal(joint.counts_range()[1] + 1, 500)}
    )  # the goal jumps and is outside the limits
    bus.torque_off([joint.servo_id])
    bus.torque_on(joint.servo_id)  # the goal is at a different position
    assert [one.text.split(" ")[:2] for one in scenario.monitor.broken] == [
        ["goal", "speed"],
        ["goal", "jumps"],
        ["goal", f"{joint.counts_range()[1] + 1}"],
        ["goal", "jumps"],
        ["torque", "enabled"],
    ]


@pytest.mark.parametrize("relax", [False, True], ids=["hold", "relax"])
def test_shutdown_stops_the_arm_and_follows_the_exit_policy(relax: bool) -> None:
    rig = SimulatedStack().up()
    rig.go(PICK, 1.0)
    rig.run(0.7)
    assert np.abs(rig.world.velocity()[:6]).max() > 0.5
    park = rig.files.robot.file.park
    assert park is not None
    assert shut_down(rig.loop, relax, park.pose, park.velocity_scale) == []
    assert [servo.memory.get(sts.torque_enable) for servo in rig.bus.servos] == [0 if relax else 1] * 7
    rig.bus.advance(rig.clock.now() + 1.0)
    assert np.abs(rig.world.velocity()[:6]).max() < 0.02
    if relax:
        assert np.abs(rig.world.position()[:6] - [park.pose[name] for name in ARM]).max() < 0.1


def test_second_signal_releases_without_parking() -> None:
    rig = SimulatedStack().up()
    rig.go(PICK, 1.0)
    rig.run(0.7)
    assert shut_down(rig.loop, True, dict.fromkeys(ARM, 0.0), 0.25, hurry=lambda: True) == []
    assert [servo.memory.get(sts.torque_enable) for servo in rig.bus.servos] == [0] * 7
    assert np.abs(rig.world.position()[:6]).max() > 0.3


def test_torque_stays_off_while_a_servo_is_silent_at_activation() -> None:
    rig = SimulatedStack()
    monitor = WireMonitor(rig.files.robot.joints, rig.bus, rig.loop.period_s)
    rig.port.on_write = monitor.see
    rig.hardware.configure()
    rig.bus.faults.silence(4)
    with pytest.raises(ActivationError, match=r"joint4.*servo 4 does not respond"):
        rig.loop.activate()
    assert monitor.torque_on_seen == 0


def test_silent_servo_is_in_the_goal_result_and_others_are_still_read() -> None:
    rig = SimulatedStack().up()
    handle = rig.go(PICK)
    rig.run(0.5)
    rig.bus.faults.silence(3)
    rig.run(0.6)
    assert handle.status is GoalStatus.ABORTED
    assert "joint3: servo 3 does not respond" in handle.error_text
    state = rig.hardware.read()
    assert set(state.faults) == {"joint3"}
    others = [i for i in range(6) if i != 2]
    assert np.abs(state.position - rig.world.position())[others].max() < 0.01
    assert np.abs(rig.world.velocity()[:6]).max() < 0.1


def test_one_corrupt_reply_has_no_effect() -> None:
    rig = SimulatedStack().up()
    handle = rig.go(PICK)
    rig.run(0.5)
    rig.bus.faults.corrupt_next(3)
    rig.run(2.0)
    assert handle.status is GoalStatus.SUCCEEDED
    assert np.abs(rig.world.position()[:6] - PICK).max() < 0.03


@pytest.mark.parametrize("servo_id", range(1, 8))
@pytest.mark.parametrize("corrupt", [1, 2, 3, 4, 5, 6])
def test_corrupt_replies_during_start_leave_the_arm_holding_or_off(servo_id: int, corrupt: int) -> None:
    """However many replies are lost during the start, the arm is either safe or reports an error."""
    rig = SimulatedStack()
    monitor = WireMonitor(rig.files.robot.joints, rig.bus, rig.loop.period_s)
    rig.port.on_write = monitor.see
    rig.bus.faults.corrupt_next(servo_id, corrupt)
    try:
        rig.up()
    except (DriverError, HalError) as error:
        assert f"servo {servo_id}" in str(error)
    else:
        rig.run(0.2)
        assert np.isfinite(rig.loop.command).all()
    assert monitor.broken == []


@pytest.mark.parametrize(("late_s", "missed", "found"), [(0.01, False, False), (0.01, True, True), (0.05, False, True)])
def test_torque_enabled_long_after_the_measurement_or_without_the_goal_is_detected(
    late_s: float, missed: bool, found: bool
) -> None:
    """A servo horn may slip at any moment, which no stack can detect. A servo may have missed its goal."""
    rig = SimulatedStack()
    monitor = WireMonitor(rig.files.robot.joints, rig.bus, rig.loop.period_s)
    servo = rig.bus.servo(1)

    def told(register: Register, value: int) -> None:
        content = v1.place(register.address) + register.encode(value, "little")
        monitor.see(bytes(v1.packet(1, WRITE, content)))

    told(sts.goal_position, round(servo.firmware.position))
    if not missed:
        servo.memory.put(sts.goal_position, round(servo.firmware.position))
    rig.bus.rig.plant.slip(0, 0.1)
    rig.bus.advance(rig.clock.now() + late_s)
    told(sts.torque_enable, 1)
    assert monitor.torque_on_seen == 1
    assert bool(monitor.broken) == found
