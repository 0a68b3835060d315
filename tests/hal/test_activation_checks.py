"""Every check of the configuration runs again at each activation: servos are changed, reset and exchanged meanwhile."""

from dataclasses import replace

import pytest

from drivers.servos import sts
from drivers.servos.register import Register
from hal.errors import ActivationError
from hal.lifecycle import LifecycleState
from tests.hal.bench import IDS, JOINTS, Bench

CALIBRATED = (replace(JOINTS[0], homing_offset=600, settings=(("position_p", 16),)), *JOINTS[1:])

CHANGES = [
    (sts.homing_offset, 0, "has homing_offset 0, and shoulder was calibrated with 600"),
    (sts.operating_mode, 1, "is not in position mode"),
    (sts.model_number, 1, r"is model 1 \(unknown\), not 777"),
    (sts.max_position, 2100, "has position limits of its own, 0 to 2100 counts"),
    (sts.status_level, 0, "acknowledges no writes"),
]


def calibrated() -> Bench:
    bench = Bench(joints=CALIBRATED)
    bench.servos.servo(1).memory.put(sts.homing_offset, 600)
    return bench.configured()


@pytest.mark.parametrize("held", [False, True], ids=["limp", "held"])
@pytest.mark.parametrize(("register", "value", "says"), CHANGES, ids=[register.name for register, _, _ in CHANGES])
def test_a_servo_that_was_changed_while_inactive_gets_no_torque(
    register: Register, value: int, says: str, held: bool
) -> None:
    bench = calibrated()
    if held:
        bench.hardware.activate()
        bench.hardware.deactivate(relax=False)
    bench.servos.servo(1).memory.put(register, value)
    with pytest.raises(ActivationError, match=f"^not activated: shoulder: servo 1: {says}"):
        bench.hardware.activate()
    assert bench.hardware.state is LifecycleState.INACTIVE
    assert bench.torque() == (list(IDS) if held else []), "a servo that holds goes on holding"


def test_a_servo_that_was_reset_to_the_factory_s_settings_has_those_of_the_file_before_its_torque() -> None:
    bench = calibrated()
    memory = bench.servos.servo(1).memory
    memory.put(sts.position_p, 32)
    bench.hardware.activate()
    assert (bench.held(1, sts.position_p), bench.torque()) == (16, list(IDS))


def test_a_servo_that_holds_torque_with_other_settings_is_refused_and_goes_on_holding() -> None:
    bench = calibrated()
    bench.hardware.activate()
    bench.hardware.deactivate(relax=False)
    bench.servos.servo(1).memory.put(sts.position_p, 32)
    with pytest.raises(ActivationError, match=r"^not activated: shoulder: servo 1: position_p .*holds torque"):
        bench.hardware.activate()
    assert bench.torque() == list(IDS)
