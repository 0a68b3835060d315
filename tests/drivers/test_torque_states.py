"""One read from each servo returns whether torque is enabled, and the torque limit, which a servo loses at a reset."""

import pytest

from drivers.servos.catalog import MODELS, series_of
from drivers.servos.dynamixel import X
from drivers.servos.feetech import SCS
from drivers.servos.series import Series
from tests.drivers.fault_lines import IDS, KINDS, Kind, Line, every_kind
from tests.drivers.ports import WatchedPort

SERIES = sorted({series_of(model) for model in MODELS.values()}, key=lambda series: series.name)
every_series = pytest.mark.parametrize("series", SERIES, ids=lambda series: series.name)


@every_series
def test_one_read_covers_switch_and_limit_if_a_goal_may_enable_torque(series: Series) -> None:
    state = series.torque_state
    assert (state.address, series.torque_enable.size) == (series.torque_enable.address, 1)
    if series.torque_limit is None or not series.torque_by_goal:
        assert state.size == 1 and series in (SCS, X)
        return
    assert state.address + state.size == series.torque_limit.address + series.torque_limit.size
    assert series.torque_limit.size == 2 and series.protocol.byte_order == "little"
    assert state.size <= 16, "a cycle's time is on the wire"


@every_series
@pytest.mark.parametrize(
    ("switch", "limit", "driven"),
    [(1, 500, True), (0, 500, False), (2, 500, False), (129, 500, False), (1, 501, False), (1, 0, False)],
)
def test_torque_is_on_with_the_switch_on_and_the_written_limit(
    series: Series, switch: int, limit: int, driven: bool
) -> None:
    size = series.torque_state.size
    between = b"\xff" * (size - 3)
    held = bytes((switch,)) + (between + limit.to_bytes(2, "little") if size > 1 else b"")
    state = series.torque_state.decode(held, series.protocol.byte_order)
    assert series.drives(state, 500) is (driven if size > 1 else switch == 1)
    assert series.drives(state, None) is (switch == 1)


def driving(kind: Kind) -> Line:
    line = Line(kind, WatchedPort)
    for servo_id in IDS:
        if series_of(kind.models[servo_id]).torque_limit:
            line.bus.limit_torque(servo_id, 0.5)
        line.bus.torque_on(servo_id)
    assert isinstance(line.port, WatchedPort)
    line.port.sent = ()
    return line


@every_kind
def test_every_servo_is_read_once(kind: Kind) -> None:
    line = driving(kind)
    assert line.bus.torque_states(IDS, line.clock.now() + 1.0) == dict.fromkeys(IDS, True)
    assert isinstance(line.port, WatchedPort)
    together = series_of(kind.model).protocol.group_read == "sync"  # in a bulk read, a silent servo hides the next ones
    assert len(line.port.sent) == (1 if together else len(IDS))


@pytest.mark.parametrize("kind", [kind for kind in KINDS if series_of(kind.model) not in (SCS, X)], ids=str)
def test_a_servo_with_a_different_limit_was_reset(kind: Kind) -> None:
    line = driving(kind)
    limit = series_of(kind.models[4]).torque_limit
    assert limit is not None
    line.servos.servo(4).memory.put(limit, line.held(4, limit) + 1)
    states = line.bus.torque_states(IDS, line.clock.now() + 1.0)
    assert [i for i, driven in states.items() if not driven] == [4]
