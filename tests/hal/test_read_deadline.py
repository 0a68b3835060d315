"""Tests that a read ends in time on every kind of bus, even when a servo answers again."""

import math

import numpy as np
import pytest

from drivers.driver_errors import ServoSilent
from drivers.types import ServoFault
from hal.joint import Joint
from hal.servos.servo_hardware import READ_SHARE, ServoHardware
from hal.types import JointCommand, JointLimits
from sim_backend.faults import Disturbance
from tests.drivers.fault_lines import CYCLES, IDS, KINDS, Kind, Line
from tests.drivers.ports import WatchedPort
from tests.hal.faults import fault_texts

ROUNDING_S = 1e-6
every_kind = pytest.mark.parametrize(
    "kind", [kind for kind in KINDS if not kind.with_goals], ids=lambda kind: kind.name
)


class Arm:
    """Active arm with joints j1 to j7 on a bus of a given kind, with the period for this kind."""

    def __init__(self, kind: Kind) -> None:
        self.line = Line(kind)
        self.period_s = kind.table.period_s
        limits = JointLimits(-5.0, 5.0, 3.0, 5.0, 50.0)
        joints = [Joint(f"j{i}", i, kind.models[i], limits, zero_counts=kind.table.middle) for i in IDS]
        self.hardware = ServoHardware("arm", joints, lambda: self.line.bus, self.line.clock)
        self.hardware.configure()
        self.hardware.activate()
        self.cycle()

    def cycle(self) -> dict[str, str]:
        """Run one cycle, whose read must end in time. Return the faults."""
        clock = self.line.clock
        self.hardware.write(JointCommand(np.zeros(len(IDS)), self.period_s))
        next_s = clock.now() + self.period_s
        deadline_s = clock.now() + READ_SHARE * self.period_s
        state = self.hardware.read()
        assert clock.now() <= deadline_s + ROUNDING_S
        clock.sleep_until(next_s)
        return fault_texts(state)


@pytest.mark.soak
@every_kind
def test_no_read_ends_after_its_deadline_on_a_bad_bus(kind: Kind) -> None:
    arm = Arm(kind)
    arm.line.faults.disturbance = Disturbance(seed=3, drop=0.08, flip=0.02, noise=0.02)
    seen = sum(bool(arm.cycle()) for _ in range(CYCLES // 5))
    assert seen, "no servo was silent, so none answered again"
    arm.line.faults.disturbance = None
    for _ in range(math.ceil(1.0 / arm.period_s)):
        faults = arm.cycle()
    assert faults == {}


@every_kind
def test_without_time_left_no_request_is_sent(kind: Kind) -> None:
    line = Line(kind, WatchedPort)
    assert isinstance(line.port, WatchedPort)
    assert line.bus.torque_is_on(4) is False
    begin_s = line.clock.now()
    line.faults.silence(4)
    line.port.sent = ()
    for deadline_s in (begin_s - 1.0, begin_s):
        assert line.bus.torque_states((4,), deadline_s) == {}
        readings = line.bus.read_states(IDS, deadline_s)
        assert {r.kind for r in readings.values() if isinstance(r, ServoFault)} == {"no_time"}
    assert (line.clock.now(), line.port.sent) == (begin_s, ())
    assert line.bus.torque_states((4,), begin_s + 0.003) == {}
    assert begin_s < line.clock.now() <= begin_s + 0.0031
    with pytest.raises(ServoSilent):
        line.bus.torque_is_on(4)
    assert line.clock.now() > begin_s + 0.03, "the limit of one call must not bind the next"


def test_servos_that_answer_again_are_checked_in_one_cycle() -> None:
    arm = Arm(KINDS[0])
    for servo_id in (2, 5, 6):
        arm.line.faults.silence(servo_id)
    assert arm.cycle().keys() == {"j2", "j5", "j6"}
    arm.line.servos.servo(2).power_cycle()
    for servo_id in (2, 5, 6):
        arm.line.faults.restore(servo_id)
    arm.line.clock.sleep_until(arm.line.clock.now() + 1.0)  # silent servos are read again
    assert [set(arm.cycle()) for _ in range(4)] == [{"j2"}] * 4


@pytest.mark.parametrize("period_s", [0.01, 0.02], ids=str)
@pytest.mark.parametrize("servo_id", [1, 4, 7])
def test_a_silent_dynamixel_hides_others_for_at_most_one_cycle(period_s: float, servo_id: int) -> None:
    """At 100 Hz, the cycle has no time to read the servos that are listed after the silent servo again."""
    kind = next(kind for kind in KINDS if kind.mapped)
    arm = Arm(kind)
    arm.hardware.write(JointCommand(np.zeros(len(IDS)), period_s))  # sets the period on which the read deadline depends
    arm.period_s = period_s
    arm.line.faults.silence(servo_id)
    assert f"j{servo_id}" in arm.cycle()
    for _ in range(20):
        assert arm.cycle().keys() == {f"j{servo_id}"}
