"""An interrupt at any time while the slow arm enables its torque releases the arm."""

import pytest

from commissioning.slow_arm import SlowArm
from drivers.servos import sts
from hal.joint import Joint
from hal.types import JointLimits
from tests.commissioning.loose import Cut, Loose, interrupt

LIMITS = JointLimits(-1.0, 1.0, 2.0, 10.0, 100.0)
ENTERED = 60
"""More packets than the activation needs."""


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
