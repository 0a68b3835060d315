"""Group packets equal those of the official SDK, byte for byte."""

import importlib
from typing import Any

from hypothesis import example, given
from hypothesis import strategies as st

from drivers.bus.bus import Bus
from drivers.bus.retry import ATTEMPTS
from drivers.clock import MonotonicClock
from drivers.protocol import v1 as wire
from drivers.servos import sts
from drivers.types import ServoGoal
from tests.drivers.tape import SdkPackets, SilentTape, Tape

# The module is imported by name, because it has no types.
sdk: Any = importlib.import_module("scservo_sdk")
SDK = SdkPackets(sdk, sdk.PacketHandler(0))

ids = st.lists(st.integers(0, 0xFD), min_size=1, max_size=20, unique=True)
positions = st.integers(0, 4095) | st.integers(-32767, 32767)
"""Positions within a turn, or in several turns, which may be negative."""


@given(ids, st.integers(0, 255), st.integers(1, 255))
def test_sync_read(servo_ids: list[int], address: int, size: int) -> None:
    assert wire.sync_read(servo_ids, address, size) == SDK.sync_read(servo_ids, address, size)


@given(ids, st.integers(0, 255), st.integers(1, 10), st.data())
def test_sync_write(servo_ids: list[int], address: int, size: int, data: st.DataObject) -> None:
    contents = {i: data.draw(st.binary(min_size=size, max_size=size)) for i in servo_ids}
    assert wire.sync_write(
        address, size, b"".join(bytes((i,)) + data for i, data in contents.items())
    ) == SDK.sync_write(address, size, contents)


@example({1: (-1, 0)})
@example({1: (-32767, 32767)})
@given(st.dictionaries(st.integers(0, 0xFD), st.tuples(positions, st.integers(0, 32767)), min_size=1))
def test_goals_equal_those_of_the_sdk(goals: dict[int, tuple[int, int]]) -> None:
    if len(goals) > 24:  # the SDK's longest packet
        goals = dict(list(goals.items())[:24])
    tape = Tape()
    bus = Bus(tape, MonotonicClock())
    bus.write_goals({i: ServoGoal(position, velocity) for i, (position, velocity) in goals.items()})
    low, high = sdk.SCS_LOBYTE, sdk.SCS_HIBYTE
    contents = {}
    for i, (position, velocity) in goals.items():
        raw = sdk.SCS_TOSCS(position, 15)
        contents[i] = bytes((sts.GOAL_ACCELERATION, low(raw), high(raw), 0, 0, low(velocity), high(velocity)))
    assert tape.sent == SDK.sync_write(sts.acceleration.address, 7, contents)


@given(ids)
def test_state_requests_equal_those_of_the_sdk(servo_ids: list[int]) -> None:
    tape = Tape()
    Bus(tape, MonotonicClock()).read_states(servo_ids)
    assert tape.sent == SDK.sync_read(servo_ids, sts.present_position.address, 8)


@given(ids)
def test_torque_off_equals_that_of_the_sdk(servo_ids: list[int]) -> None:
    """One packet to all servos is followed by one packet to each servo, which is repeated if the servo does not
    answer."""
    ours, theirs = SilentTape(), SilentTape()
    assert len(Bus(ours, ours.clock).torque_off(servo_ids)) == len(servo_ids)
    for _ in range(ATTEMPTS):
        for servo_id in servo_ids:
            sdk.PacketHandler(0).write1ByteTxOnly(theirs, servo_id, 40, 0)
    assert ours.sent == SDK.sync_write(40, 1, dict.fromkeys(servo_ids, b"\0")) + theirs.sent
