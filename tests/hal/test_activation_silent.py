"""An activation succeeds although a servo is silent for 0.2 s, whichever request it misses first."""

import itertools

import pytest

from drivers.servos import sts, x
from drivers.servos.register import ServoModel
from hal.servos.servo_hardware import ServoHardware
from tests.commissioning.interrupted import IDS, Interrupted


@pytest.mark.parametrize(
    "model", [pytest.param(sts.STS3215, id="sts"), pytest.param(x.XL430_W250, id="x", marks=pytest.mark.slow)]
)
def test_a_servo_may_be_silent_for_a_moment(model: ServoModel) -> None:
    for packet in itertools.count():
        bench = Interrupted(model)
        hardware = ServoHardware("arm", bench.joints, lambda bench=bench: bench.bus, bench.clock)
        bench.silence_at(packet)
        hardware.configure()
        hardware.activate()
        assert all(bench.bus.torque_is_on(servo_id) for servo_id in IDS)
        if bench.packets <= packet:
            break
