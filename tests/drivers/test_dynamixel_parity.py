"""Group packets for every model and random values equal those of the official SDK, byte for byte."""

import importlib
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.bus.bus import Bus
from drivers.bus.fast_read import fast_plan
from drivers.bus.retry import ATTEMPTS
from drivers.protocol import v2 as wire
from drivers.servos import x as x_series
from drivers.servos import xl320
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import XL, X
from drivers.servos.register import ServoModel
from drivers.types import ServoGoal
from sim_backend.clock import SimulatedClock
from tests.drivers.tape import SilentTape, Tape

# The module is imported by name, because it has no types.
sdk: Any = importlib.import_module("dynamixel_sdk")
has_fast_sync_read = pytest.mark.skipif(
    not hasattr(sdk.GroupSyncRead, "fastSyncReadTxPacket"), reason="this version of the SDK has no fast sync read"
)

MODELS = {model.name: model for series in (X, XL) for model in series.models}
every_model = st.sampled_from(sorted(MODELS.values(), key=lambda model: model.name))
lines = st.dictionaries(st.integers(0, wire.LARGEST_ID), every_model, min_size=1, max_size=20)
velocities = st.integers(0, 5000)


def same(ours: bytes, theirs: bytes) -> bool:
    """Compare packets without byte stuffing, because the SDK computes the stuffing but sends the packet without it."""
    return ours == theirs or wire.PATTERN in ours[3:]


def question(models: dict[int, ServoModel]) -> bytes:
    """Return the request with which the bus reads states."""
    tape = Tape()
    Bus(tape, SimulatedClock(), models).request(tuple(models), math.inf)
    return tape.sent


def block(model: ServoModel) -> tuple[int, int]:
    """Return address and size of the state, derived from the register names and not by the code under test."""
    if model is xl320.XL320:
        return xl320.present_position.address, 10
    return x_series.present_pwm.address, 23


@given(st.sets(st.integers(0, wire.LARGEST_ID), min_size=1, max_size=20), every_model)
def test_sync_read_of_one_series(ids: set[int], model: ServoModel) -> None:
    tape = Tape()
    group = sdk.GroupSyncRead(tape, sdk.PacketHandler(2.0), *block(model))
    assert all(group.addParam(i) for i in ids)
    group.txPacket()
    assert same(question(dict.fromkeys(ids, model)), tape.sent)


@has_fast_sync_read
@given(st.sets(st.integers(0, wire.LARGEST_ID), min_size=1, max_size=20), every_model)
def test_fast_sync_read(ids: set[int], model: ServoModel) -> None:
    series = series_of(model)
    tape = Tape()
    group = sdk.GroupSyncRead(tape, sdk.PacketHandler(2.0), *block(model))
    assert all(group.addParam(i) for i in ids)
    group.fastSyncReadTxPacket()
    assert same(fast_plan(series.blocks[0], dict.fromkeys(ids)).request, tape.sent)


@given(lines)
def test_bulk_read_of_a_mixed_line(models: dict[int, ServoModel]) -> None:
    if len({series_of(model) for model in models.values()}) < 2:
        return
    tape = Tape()
    group = sdk.GroupBulkRead(tape, sdk.PacketHandler(2.0))
    for servo_id, model in models.items():
        assert group.addParam(servo_id, *block(model))
    group.txPacket()
    assert same(question(models), tape.sent)


@given(st.dictionaries(st.integers(0, 252), st.tuples(st.integers(0, 0xFFFF), st.binary(max_size=9)), min_size=1))
def test_any_bulk_read(spans: dict[int, tuple[int, bytes]]) -> None:
    tape = Tape()
    group = sdk.GroupBulkRead(tape, sdk.PacketHandler(2.0))
    for servo_id, (address, content) in spans.items():
        assert group.addParam(servo_id, address, len(content))
    group.txPacket()
    assert same(wire.bulk_read({i: (address, len(content)) for i, (address, content) in spans.items()}), tape.sent)


@given(lines, st.data())
def test_a_sync_write_for_each_series(models: dict[int, ServoModel], data: st.DataObject) -> None:
    goals, theirs = {}, b""
    x_tape, xl_tape = Tape(), Tape()
    x_group = sdk.GroupSyncWrite(x_tape, sdk.PacketHandler(2.0), x_series.profile_velocity.address, 8)
    xl_group = sdk.GroupSyncWrite(xl_tape, sdk.PacketHandler(2.0), xl320.goal_position.address, 4)
    for servo_id, model in models.items():
        last = 4095 if series_of(model) is X else 1023
        position, velocity = data.draw(st.integers(0, last)), data.draw(velocities)
        goals[servo_id] = ServoGoal(position, velocity)
        if series_of(model) is X:
            units = -(-velocity * 60_000 // (229 * 4096))
            assert x_group.addParam(servo_id, list(units.to_bytes(4, "little") + position.to_bytes(4, "little")))
        else:
            units = min(-(-velocity * 60_000 // (111 * 1229)), 1023)
            assert xl_group.addParam(servo_id, list(position.to_bytes(2, "little") + units.to_bytes(2, "little")))
    x_group.txPacket()
    xl_group.txPacket()
    first = series_of(next(iter(models.values())))
    theirs = x_tape.sent + xl_tape.sent if first is X else xl_tape.sent + x_tape.sent
    tape = Tape()
    Bus(tape, SimulatedClock(), models).write_goals(goals)
    assert tape.sent == theirs or tape.sent.count(wire.PATTERN) > tape.sent.count(wire.HEADER)


@given(lines)
def test_torque_off_of_each_series_and_then_of_each_servo(models: dict[int, ServoModel]) -> None:
    """No part of the packets needs byte stuffing."""
    address = {i: 24 if model is xl320.XL320 else 64 for i, model in models.items()}
    ours, theirs = SilentTape(), SilentTape()
    assert len(Bus(ours, ours.clock, models).torque_off(tuple(models))) == len(models)
    for place in dict.fromkeys(address.values()):
        group = sdk.GroupSyncWrite(theirs, sdk.PacketHandler(2.0), place, 1)
        for servo_id in models:
            assert address[servo_id] != place or group.addParam(servo_id, [0])
        group.txPacket()
    for _ in range(ATTEMPTS):
        for servo_id in models:
            sdk.PacketHandler(2.0).write1ByteTxOnly(theirs, servo_id, address[servo_id], 0)
    assert ours.sent == theirs.sent
