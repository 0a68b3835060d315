"""Group packets equal those of the manufacturers' SDKs, byte for byte, for every model."""

import importlib
import math
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.bus import Bus
from drivers.clock import MonotonicClock
from drivers.protocol.v1 import READ, bulk_read, packet
from drivers.servos import ax_mx as dxl
from drivers.servos import scs
from drivers.servos.register import ServoModel
from drivers.types import ServoGoal
from tests.drivers.tape import SdkPackets, Tape

# The modules are imported by name, because they have no types.
feetech: Any = importlib.import_module("scservo_sdk")
dynamixel: Any = importlib.import_module("dynamixel_sdk")

HANDLERS = {
    "scs": (feetech, lambda: feetech.PacketHandler(1)),
    "dynamixel 1": (dynamixel, dynamixel.Protocol1PacketHandler),
}
ids = st.lists(st.integers(0, 0xFD), min_size=1, max_size=20, unique=True)
every_sdk = pytest.mark.parametrize("sdk", HANDLERS)


@pytest.fixture(autouse=True, scope="module")
def words_of_the_sdk() -> Iterator[None]:
    """Restore the byte order of the Feetech SDK, which applies to the whole process."""
    yield
    feetech.SCS_SETEND(0)


def sdk_sync_write(sdk: str, address: int, size: int, data: dict[int, bytes]) -> bytes:
    module, handler = HANDLERS[sdk]
    return SdkPackets(module, handler()).sync_write(address, size, data)


def bus_of(models: dict[int, ServoModel]) -> tuple[Bus, Tape]:
    tape = Tape()
    return Bus(tape, MonotonicClock(), models), tape


@pytest.mark.parametrize("model", scs.MODELS.values(), ids=lambda m: m.name)
@given(goals=st.dictionaries(st.integers(0, 0xFD), st.tuples(st.integers(0, 1023), st.integers(0, 32767)), min_size=1))
def test_scs_goals(model: ServoModel, goals: dict[int, tuple[int, int]]) -> None:
    goals = dict(list(goals.items())[:20])  # the SDK's longest packet
    feetech.SCS_SETEND(0)
    bus, tape = bus_of(dict.fromkeys(goals, model))
    bus.write_goals({i: ServoGoal(position, velocity) for i, (position, velocity) in goals.items()})
    assert feetech.SCS_GETEND() == 0  # the bus does not change it
    feetech.SCS_SETEND(1)
    low, high = feetech.SCS_LOBYTE, feetech.SCS_HIBYTE
    data = {i: bytes((low(p), high(p), 0, 0, low(v), high(v))) for i, (p, v) in goals.items()}
    assert tape.sent == sdk_sync_write("scs", scs.goal_position.address, 6, data)


UNITS = {
    **dict.fromkeys(("ax-12a", "ax-12w", "ax-18a", "rx-24f", "rx-28", "rx-64"), (0.111, 1023)),
    "ex-106+": (0.111, 4095),
    "mx-12w": (0.916, 4095),
    **dict.fromkeys(("mx-28", "mx-64", "mx-106"), (0.114, 4095)),
}
"""Unit of the speed in rpm, and the largest position, as the e-manual states them."""


@pytest.mark.parametrize("model", dxl.MODELS.values(), ids=lambda m: m.name)
@given(data=st.data())
def test_dynamixel_goals(model: ServoModel, data: st.DataObject) -> None:
    rpm, last = UNITS[model.name]
    wanted = st.tuples(st.integers(0, last), st.integers(0, 9000))
    goals = data.draw(st.dictionaries(st.integers(0, 0xFD), wanted, min_size=1, max_size=20))
    bus, tape = bus_of(dict.fromkeys(goals, model))
    bus.write_goals({i: ServoGoal(position, velocity) for i, (position, velocity) in goals.items()})
    low, high = dynamixel.DXL_LOBYTE, dynamixel.DXL_HIBYTE
    contents = {}
    for servo_id, (position, velocity) in goals.items():
        speed = min(1023, math.ceil(velocity / (rpm * model.counts_per_turn / 60.0)))
        contents[servo_id] = bytes((low(position), high(position), low(speed), high(speed)))
    assert tape.sent == sdk_sync_write("dynamixel 1", dxl.goal_position.address, 4, contents)


@every_sdk
@given(servo_ids=ids)
def test_torque_off(sdk: str, servo_ids: list[int]) -> None:
    model, address = (scs.SCS0009, 40) if sdk == "scs" else (dxl.AX_12A, 24)
    bus, tape = bus_of(dict.fromkeys(servo_ids, model))
    bus.write = lambda *_: None
    bus.torque_off(servo_ids)
    assert tape.sent == sdk_sync_write(sdk, address, 1, dict.fromkeys(servo_ids, b"\0"))


@given(ids, st.integers(0, 0xFF), st.integers(1, 100))
def test_bulk_read(servo_ids: list[int], address: int, size: int) -> None:
    tape = Tape()
    handler = dynamixel.Protocol1PacketHandler()
    parameters = [number for servo_id in servo_ids for number in (size, servo_id, address)]
    # GroupBulkRead passes an argument that this handler does not accept.
    assert handler.bulkReadTx(tape, parameters, len(parameters)) == dynamixel.COMM_SUCCESS
    assert tape.sent == bulk_read(dict.fromkeys(servo_ids, (address, size)))


@given(ids)
def test_states_of_mx_servos_are_read_by_a_bulk_read(servo_ids: list[int]) -> None:
    bus, tape = bus_of(dict.fromkeys(servo_ids, dxl.MX_28))
    bus.request(servo_ids, math.inf)
    assert tape.sent == (
        bulk_read(dict.fromkeys(servo_ids, (36, 8)))
        if len(servo_ids) > 1
        else packet(servo_ids[0], READ, bytes((36, 8)))
    )


@every_sdk
@given(st.integers(0, 0xFD), st.integers(0, 0xFF), st.integers(1, 100))
def test_read(sdk: str, servo_id: int, address: int, size: int) -> None:
    module, handler = HANDLERS[sdk]
    tape = Tape()
    assert handler().readTx(tape, servo_id, address, size) == module.COMM_SUCCESS
    assert tape.sent == packet(servo_id, READ, bytes((address, size)))
