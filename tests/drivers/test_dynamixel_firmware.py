"""The firmware version that a servo reports determines which instructions and registers the driver uses."""

import pytest

from drivers.servos import x
from drivers.servos.firmware import reads_fast
from sim_backend.packets.dynamixel import Code
from sim_backend.servos.dynamixel.models import reads_fast as virtual_servo_reads_fast
from tests.drivers.dynamixel_lines import TrueLine

MODELS = {1: x.XL430_W250, 2: x.XL430_W250, 3: x.XL430_W250}


def sent_fast(line: TrueLine) -> bool:
    return any(instruction.code == Code.FAST_SYNC_READ for instruction in line.port.sent)


@pytest.mark.parametrize(
    ("firmware", "fast"),
    [({}, True), ({1: 45, 2: 45, 3: 45}, True), ({1: 44, 2: 44, 3: 44}, False), ({2: 41}, False)],
)
def test_old_firmware_gets_no_fast_read_not_even_a_trial(firmware: dict[int, int], fast: bool) -> None:
    line = TrueLine(MODELS, firmware)
    for servo_id, model in MODELS.items():
        line.bus.identify(servo_id, model)
    line.bus.read_states(line.ids)
    assert sent_fast(line) == fast
    for _ in range(5):
        assert line.faults() == {}
    assert sent_fast(line) == fast


@pytest.mark.parametrize(("version", "cells"), [(44, 208), (52, 208), (53, 224)])
def test_the_firmware_of_an_x330_selects_its_indirect_registers(version: int, cells: int) -> None:
    models = dict.fromkeys((1, 2), x.XL330_M288)
    line = TrueLine(models, dict.fromkeys(models, version)).identified()
    assert line.faults() == {}
    (asked, *_) = [i for i in line.port.sent if i.code in (Code.SYNC_READ, Code.FAST_SYNC_READ)]
    assert int.from_bytes(asked.parameters[:2], "little") == cells


def test_a_servo_that_is_replaced_by_an_older_one_ends_fast_reads() -> None:
    line = TrueLine(MODELS).identified()
    assert line.faults() == {} and sent_fast(line)
    line.servos.servo(2).memory.put(x.firmware_version, 41)
    line.bus.identify(2, MODELS[2])
    line.port.sent.clear()
    assert line.faults() == {} and not sent_fast(line)


@pytest.mark.parametrize("model", x.MODELS.values(), ids=lambda model: model.name)
def test_driver_and_virtual_servo_agree(model: x.XModel) -> None:
    for version in (40, 44, 45, 46, 52, 53):
        known = reads_fast(model, version)
        assert known in (None, virtual_servo_reads_fast(model, version))
    assert reads_fast(model, None) is None
