"""Instructions to a single servo, for every model, equal the packets of the manufacturers' SDKs, byte for byte."""

import importlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.bus.bus import Bus
from drivers.driver_errors import DriverError, ServoRefused, ServoSilent
from drivers.protocol import v2 as wire
from drivers.servos import ax_mx as dxl
from drivers.servos import x as x_series
from drivers.servos import xl320
from drivers.servos.catalog import MODELS, series_of
from drivers.servos.register import Access, Register, ServoModel
from tests.drivers.fault_lines import CYCLES
from tests.drivers.tape import SilentTape

# The modules are imported by name, because they have no types.
feetech: Any = importlib.import_module("scservo_sdk")
dynamixel: Any = importlib.import_module("dynamixel_sdk")

HANDLERS: dict[str, Callable[[], Any]] = {
    # These functions set the byte order for the whole process.
    "Feetech STS": lambda: feetech.PacketHandler(0),
    "Feetech SCS": lambda: feetech.PacketHandler(1),
    "Dynamixel protocol 1.0": dynamixel.Protocol1PacketHandler,
    "Dynamixel protocol 2.0": dynamixel.Protocol2PacketHandler,
}
BROADCAST = 0xFE
ids = st.integers(0, wire.LARGEST_ID)
every_model = pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)
some = settings(max_examples=CYCLES // 40)
"""There are few examples for each model, because all models of a protocol share the code under test."""


@pytest.fixture(autouse=True, scope="module")
def words_of_the_sdk() -> Iterator[None]:
    yield
    feetech.SCS_SETEND(0)


def table_of(model: ServoModel) -> tuple[Register, ...]:
    """Return all registers of a model."""
    match model:
        case dxl.AxMxModel():
            return dxl.registers(model)
        case x_series.XModel():
            return x_series.registers(model)
        case xl320.XL320:
            return xl320.REGISTERS
    return series_of(model).registers


def ours(model: ServoModel, servo_id: int, tell: Callable[[Bus], object]) -> bytes:
    """Return the packets that the bus sends if no reply arrives."""
    feetech.SCS_SETEND(0)
    tape = SilentTape()
    with suppress(ServoSilent):
        tell(Bus(tape, tape.clock, {servo_id: model}))
    return tape.sent


def theirs(model: ServoModel, tell: Callable[[Any, SilentTape], object]) -> bytes:
    """Return the packets that the SDK sends."""
    tape = SilentTape()
    tell(HANDLERS[series_of(model).protocol.name](), tape)
    return tape.sent


def contents(model: ServoModel, register: Register, value: int) -> list[int]:
    """Return the bytes of a value, including its sign, as encoded by the SDK's own macros."""
    if series_of(model).make == "feetech":
        raw = value if register.sign_bit is None else feetech.SCS_TOSCS(value, register.sign_bit)
        return [raw] if register.size == 1 else [feetech.SCS_LOBYTE(raw), feetech.SCS_HIBYTE(raw)]
    words = [dynamixel.DXL_LOWORD(value), dynamixel.DXL_HIWORD(value)]
    return [byte for word in words for byte in (dynamixel.DXL_LOBYTE(word), dynamixel.DXL_HIBYTE(word))][
        : register.size
    ]


def same(sent: bytes, sdk_sent: bytes, content: list[int]) -> bool:
    """Compare packets without byte stuffing, because the SDK computes the stuffing but sends the packet without it."""
    return wire.PATTERN in bytes(content) or sent == sdk_sent != b""


@every_model
@pytest.mark.soak
@some
@given(servo_id=ids, data=st.data())
def test_read(model: ServoModel, servo_id: int, data: st.DataObject) -> None:
    register = data.draw(st.sampled_from(table_of(model)))
    packet = theirs(model, lambda sdk, tape: sdk.readTx(tape, servo_id, register.address, register.size))
    assert ours(model, servo_id, lambda bus: bus.read(servo_id, register)) == packet != b""


@every_model
@pytest.mark.parametrize(("call", "sdk_call"), [("write", "writeTxOnly"), ("reg_write", "regWriteTxOnly")])
@pytest.mark.soak
@some
@given(servo_id=ids, data=st.data())
def test_write_and_reg_write(model: ServoModel, call: str, sdk_call: str, servo_id: int, data: st.DataObject) -> None:
    register = data.draw(st.sampled_from([r for r in table_of(model) if r.access is Access.READ_WRITE]))
    value = data.draw(st.integers(register.smallest, register.largest))
    content: list[int] = []

    def write(sdk: Any, tape: SilentTape) -> None:
        content.extend(contents(model, register, value))
        getattr(sdk, sdk_call)(tape, servo_id, register.address, register.size, content)

    packet = theirs(model, write)
    assert same(ours(model, servo_id, lambda bus: getattr(bus, call)(servo_id, register, value)), packet, content)


@pytest.mark.parametrize(("call", "code"), [("write", wire.WRITE), ("reg_write", wire.REG_WRITE)])
@pytest.mark.parametrize("value", [-131073, -257])
def test_parameters_that_contain_a_header_are_stuffed(call: str, code: int, value: int) -> None:
    """The packet of -131073 contains a header, and the packet of -257 does not."""
    register = x_series.homing_offset
    content = register.address.to_bytes(2, "little") + register.encode(value, "little")
    sent = ours(x_series.XL430_W250, 3, lambda bus: getattr(bus, call)(3, register, value))
    assert sent == wire.packet(3, code, content)


@every_model
@pytest.mark.soak
@some
@given(servo_id=ids)
def test_ping(model: ServoModel, servo_id: int) -> None:
    packet = theirs(model, lambda sdk, tape: sdk.ping(tape, servo_id))
    assert ours(model, servo_id, lambda bus: bus.ping(servo_id)) == packet != b""


@every_model
def test_action(model: ServoModel) -> None:
    packet = theirs(model, lambda sdk, tape: sdk.action(tape, BROADCAST))
    assert ours(model, 1, lambda bus: bus.action()) == packet != b""


@every_model
def test_broadcast_ping(model: ServoModel) -> None:
    """Only protocol 2.0 supports this instruction. The instruction is not available in scservo_sdk and in the protocol
    1.0 of dynamixel_sdk."""
    if series_of(model).protocol.name == "Dynamixel protocol 2.0":
        packet = theirs(model, lambda sdk, tape: sdk.broadcastPing(tape))
        assert ours(model, 1, lambda bus: bus.broadcast_ping()) == packet != b""
        return
    tape = SilentTape()
    with pytest.raises(DriverError, match="ping each ID"):
        Bus(tape, tape.clock, {1: model}).broadcast_ping()
    assert tape.sent == b""


def by_the_manual(servo_id: int, instruction: int) -> bytes:
    """Encode a Feetech packet without parameters according to the manual."""
    return bytes((0xFF, 0xFF, servo_id, 2, instruction, 255 - (servo_id + 2 + instruction) % 256))


@every_model
@pytest.mark.soak
@some
@given(servo_id=ids)
def test_reboot(model: ServoModel, servo_id: int) -> None:
    """scservo_sdk has no reboot instruction. Protocol 1.0 has no reboot either, and dynamixel_sdk then sends
    nothing."""
    if series_of(model).protocol.name == "Dynamixel protocol 1.0":
        with pytest.raises(ServoRefused, match="cannot be rebooted"):
            ours(model, servo_id, lambda bus: bus.reboot(servo_id))
        assert theirs(model, lambda sdk, tape: sdk.reboot(tape, servo_id)) == b""
        return
    if series_of(model).make == "feetech":
        packet = by_the_manual(servo_id, 8)
    else:
        packet = theirs(model, lambda sdk, tape: sdk.reboot(tape, servo_id))
    assert ours(model, servo_id, lambda bus: bus.reboot(servo_id)) == packet != b""


@every_model
@pytest.mark.soak
@some
@given(servo_id=ids)
def test_factory_reset(model: ServoModel, servo_id: int) -> None:
    """scservo_sdk has no factory reset. In protocol 2.0, option 2 keeps the ID and the baud rate."""
    if series_of(model).make == "feetech":
        packet = by_the_manual(servo_id, 6)
    else:
        option = (2,) if series_of(model).protocol.name == "Dynamixel protocol 2.0" else ()
        packet = theirs(model, lambda sdk, tape: sdk.factoryReset(tape, servo_id, *option))
    assert ours(model, servo_id, lambda bus: bus.factory_reset(servo_id)) == packet != b""
