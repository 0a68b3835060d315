"""The slow arm: interrupts while it enables its torque, and servos that are silent for a moment."""

from typing import Any

import pytest

from commissioning.slow_arm import PERIOD_S, SlowArm, StoppedError
from drivers.bus.bus import Bus
from drivers.servos import sts, x
from drivers.servos.catalog import series_of
from drivers.servos.register import ServoModel
from hal.joint import Joint
from hal.types import JointLimits
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from tests.commissioning.loose import Cut, Loose, interrupt

LIMITS = JointLimits(-1.0, 1.0, 2.0, 10.0, 100.0)
ENTERED = 60
"""More packets than the activation needs."""
IDS = (1, 2, 3)
SILENT = 2
SILENT_S = 0.2
MOMENTS_S = [share * PERIOD_S for share in (0.0, 0.25, 0.5, 0.75)]
"""Beginnings of a silence within a cycle, in seconds."""


def test_an_interrupt_during_activation_releases_the_arm() -> None:
    for at in range(1, ENTERED):
        loose = Loose(sts.STS3215)
        loose.port.before_write = Cut(at, interrupt)
        try:
            with SlowArm(lambda bench=loose: bench.bus, [Joint("jaw", 1, sts.STS3215, LIMITS)], loose.clock) as arm:
                loose.port.before_write = lambda data: None
                assert loose.left[0] == 1
                arm.relax = True
            return
        except KeyboardInterrupt:
            assert loose.left[0] == 0, f"torque is on behind packet {at}"
    pytest.fail("it never began")


class Interrupted:
    """Three servos, of which the second is silent for a time."""

    def __init__(self, model: ServoModel) -> None:
        self.clock = SimulatedClock()
        models = dict.fromkeys(IDS, model)
        maker: Any = VirtualBus if model is sts.STS3215 else VirtualDynamixelBus
        self.line = maker.of(BenchPlant(IDS), models)
        self.bus = Bus(VirtualPort(self.line, self.clock), self.clock, models)
        self.joints = [Joint(f"joint{i}", i, model, LIMITS) for i in IDS]
        self.silent_s = (0.0, 0.0)
        self.line.faults.on_instruction.append(self._reaches)

    def _reaches(self, servo_id: int) -> bool:
        from_s, to_s = self.silent_s
        return servo_id != SILENT or not from_s <= self.clock.now() < to_s

    def go(self, after_s: float, silent_s: float) -> None:
        """Move the first joint while the second servo is silent."""
        with SlowArm(lambda: self.bus, self.joints, self.clock) as arm:
            from_s = self.clock.now() + after_s
            self.silent_s = from_s, from_s + silent_s
            arm.go(0, 0.2)


@pytest.mark.parametrize("after_s", MOMENTS_S)
@pytest.mark.parametrize("model", [sts.STS3215, x.XL430_W250], ids=lambda model: model.name)
def test_a_servo_may_be_silent_for_a_moment(model: ServoModel, after_s: float) -> None:
    Interrupted(model).go(after_s, SILENT_S)


@pytest.mark.parametrize("model", [sts.STS3215, x.XL430_W250], ids=lambda model: model.name)
def test_a_servo_that_stays_silent_stops_the_arm(model: ServoModel) -> None:
    arm = Interrupted(model)
    with pytest.raises(StoppedError, match=r"joint2: servo 2"):
        arm.go(0.0, 2.0)
    torque = series_of(model).torque_enable
    assert not any(servo.memory.get(torque) for servo in arm.line.servos)
