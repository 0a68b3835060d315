"""A servo that answers, but that there is no answer: it is there, and says why. Not silent, and never a value."""

from collections.abc import Callable
from typing import Any

import pytest

from drivers.bus import ServoFault, ServoState
from drivers.dynamixel import x_series as x
from drivers.dynamixel1 import tables as dxl
from drivers.errors import ServoRefused
from drivers.feetech import wire
from tests.drivers.fault_lines import IDS, KINDS, Kind, Line, mixed

RESULT_FAIL, NO_ACCESS = 1, 7

AX = Kind("ax-12a", mixed(dxl.AX_12A), one_by_one=True)
MX = Kind("mx-28", mixed(dxl.MX_28))
X_KINDS = [kind for kind in KINDS if kind.model in x.MODELS.values()]


def refuse(line: Line, servo_id: int, error: int) -> Callable[[], None]:
    """From now on, this servo answers every read so; what it returns ends that."""
    servo: Any = line.servos.servo(servo_id)
    if line.kind in X_KINDS:
        servo._read = lambda address, size: (error, b"")
    else:
        servo.answer = lambda instruction: wire.packet(servo_id, error, b"")
        servo.read_status = lambda address, size: wire.packet(servo_id, error, b"")
    return lambda: [servo.__dict__.pop(name, None) for name in ("_read", "answer", "read_status")] and None


@pytest.mark.parametrize("servo_id", [1, 4, 7])
@pytest.mark.parametrize(
    ("kind", "error", "why"),
    [
        *((kind, RESULT_FAIL, "it could not do it") for kind in X_KINDS),
        *((kind, NO_ACCESS, "it has no such register") for kind in X_KINDS if not kind.mapped),
        (AX, 0x08, "it names a range error"),
        (AX, 0x51, "it names a checksum and instruction error"),
        (MX, 0x48, "it names a range and instruction error"),
    ],
    ids=lambda value: getattr(value, "name", str(value)),
)
def test_who_refuses_to_be_read_is_named_with_its_reason_and_hides_nobody(
    kind: Kind, error: int, why: str, servo_id: int
) -> None:
    line = Line(kind)
    line.cycle()
    end = refuse(line, servo_id, error)
    for _ in range(8):
        readings = line.cycle()
        fault = readings[servo_id]
        assert isinstance(fault, ServoFault)
        assert fault.kind == "refused"
        assert fault.text.startswith(f"servo {servo_id} refuses to be read: {why}")
        assert all(isinstance(readings[i], ServoState) for i in IDS if i != servo_id)
    account = line.account(servo_id)
    assert account.refused >= 8
    assert account.silent == account.corrupt == account.late == account.skipped == account.reset == 0
    assert line.bus.counters.noise == line.bus.counters.strange == 0
    end()
    assert line.missing() == {}


def test_an_acknowledgement_in_a_replys_place_is_no_refusal() -> None:
    for kind in (X_KINDS[0], AX):
        line = Line(kind)
        refuse(line, 4, 0)
        assert line.missing() == {4: "silent"} or line.missing() == {4: "corrupt"}
        assert line.account(4).refused == 0


@pytest.mark.parametrize(("kind", "error"), [(X_KINDS[0], NO_ACCESS), (AX, 0x08)], ids=["x", "ax-12a"])
def test_one_servos_refusal_is_counted_and_leaves_nothing_owed(kind: Kind, error: int) -> None:
    line = Line(kind)
    end = refuse(line, 4, error)
    with pytest.raises(ServoRefused):
        line.bus.torque_is_on(4)
    assert {name for name, count in line.account(4).as_dict().items() if count} == {"refused"}
    end()
    begin_s = line.clock.now()
    assert not line.bus.torque_is_on(4)
    assert line.clock.now() - begin_s < 0.005
