"""A servo that refuses a read is reported with its reason. Such a servo does not count as silent and never has a
value."""

from collections.abc import Callable
from typing import Any

import pytest

from drivers.bus.fast_read import FAST_TRIES
from drivers.bus.late_replies import OPEN_S
from drivers.driver_errors import ServoRefused
from drivers.protocol import v1 as wire
from drivers.servos import ax_mx as dxl
from drivers.servos import x
from drivers.types import ServoFault, ServoState
from sim_backend.buses.port import VirtualPort
from sim_backend.line.line import DelayedReply
from sim_backend.packets.dynamixel import status_packet
from tests.drivers.fault_lines import IDS, KINDS, Kind, Line, Truth, mixed
from tests.drivers.ports import WatchedPort

RESULT_FAIL, NO_ACCESS = 1, 7

AX = Kind("ax-12a", mixed(dxl.AX_12A), one_by_one=True)
MX = Kind("mx-28", mixed(dxl.MX_28))
X_KINDS = [kind for kind in KINDS if kind.model in x.MODELS.values()]


def refuse(line: Line, servo_id: int, error: int) -> Callable[[], None]:
    """Make a servo refuse every read with this error. Call the returned function to end the refusals."""
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
        *((kind, RESULT_FAIL, "it could not execute the instruction") for kind in X_KINDS),
        *((kind, NO_ACCESS, "it does not have this register") for kind in X_KINDS if not kind.mapped),
        (AX, 0x08, "it rejected the instruction (range error)"),
        (AX, 0x51, "it rejected the instruction (checksum and instruction error)"),
        (MX, 0x48, "it rejected the instruction (range and instruction error)"),
    ],
    ids=lambda value: getattr(value, "name", str(value)),
)
def test_a_refusal_is_reported_with_its_reason_and_does_not_hide_others(
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
        assert fault.text.startswith(f"servo {servo_id} rejects the read request: {why}")
        assert all(isinstance(readings[i], ServoState) for i in IDS if i != servo_id)
    account = line.account(servo_id)
    assert account.refused >= 8
    assert account.silent == account.corrupt == account.late == account.skipped == account.reset == 0
    assert line.bus.counters.noise == line.bus.counters.strange == 0
    end()
    assert line.missing() == {}


def test_an_acknowledgment_is_not_a_refusal() -> None:
    for kind in (X_KINDS[0], AX):
        line = Line(kind)
        refuse(line, 4, 0)
        assert line.missing() in ({4: "silent"}, {4: "corrupt"})
        assert line.account(4).refused == 0


@pytest.mark.parametrize("asked", [(4,), IDS], ids=["one", "all"])
@pytest.mark.parametrize("last", [True, False], ids=["refusal late", "answer late"])
@pytest.mark.parametrize("kind", [AX, MX, *X_KINDS], ids=lambda kind: kind.name)
def test_a_reply_after_a_late_refusal_is_never_an_old_state(kind: Kind, last: bool, asked: tuple[int, ...]) -> None:
    """The refusal arrives instead of the next reply, and that reply arrives instead of the one after it."""
    line = Line(kind)
    truth = Truth(line)
    for number in range(14):
        truth.number = 10 * number
        if number in (3, 4):
            line.faults.delay_next(4)
        end = refuse(line, 4, 0x10 if kind in (AX, MX) else RESULT_FAIL) if number == 3 and last else None
        begin_s = line.clock.now()
        # There is no time to repeat a request.
        budget_s = 0.0005 * len(asked) + 0.0035 if number in (3, 4) else kind.table.budget_s
        for servo_id, reading in line.bus.read_states(asked, begin_s + budget_s).items():
            assert not isinstance(reading, ServoState) or truth.holds(servo_id, reading), number
        if end:
            end()
            truth = Truth(line)
            truth.number = 10 * number
        truth.number += 1
        line.clock.sleep_until(begin_s + 0.02)
    account = line.account(4)
    assert account.replies >= 8
    assert account.silent + account.late + account.refused + account.corrupt >= 2


@pytest.mark.parametrize("arrives", [(2, 4), (3, 5), (3, 6), (4, 7), (5, 6)], ids=str)
@pytest.mark.parametrize("kind", [AX, MX, *X_KINDS[:2]], ids=lambda kind: kind.name)
def test_a_refusal_does_not_close_open_requests(kind: Kind, arrives: tuple[int, int]) -> None:
    """Replies keep their order, and two of them are delayed: a refusal in cycle 1 and the reply in cycle 2."""
    line = Line(kind, WatchedPort)
    port = line.port
    assert isinstance(port, WatchedPort)
    truth = Truth(line)
    line.bus.read_states((4,), line.clock.now() + 0.004)
    start_s = line.clock.now() + 0.02
    for number in range(1, 12):
        truth.number = 10 * number
        line.clock.sleep_until(start_s + 0.02 * number)
        comes = dict(enumerate(arrives, 1)).get(number, max(number, arrives[1] + 1) if number <= arrives[1] else number)
        port.hold_s = (comes - number) * 0.02
        end = refuse(line, 4, 0x10 if kind in (AX, MX) else RESULT_FAIL) if number == 1 else None
        reading = line.bus.read_states((4,), line.clock.now() + 0.003)[4]
        assert not isinstance(reading, ServoState) or truth.holds(4, reading), number
        if end:
            end()
            truth = Truth(line)


class BytePort(VirtualPort):
    """A port that receives bytes one by one, like a serial line."""

    def write(self, data: bytes) -> None:
        before = len(self._coming)
        super().write(data)
        new = [self._coming.pop() for _ in range(len(self._coming) - before)][::-1]
        byte_s = 10.0 / self.baud
        for reply in new:
            last = len(reply.data) - 1
            self._coming += [
                DelayedReply(max(reply.due_s - (last - at) * byte_s, self._clock.now()), reply.data[at : at + 1])
                for at in range(last + 1)
            ]


@pytest.mark.parametrize("asked", [(4,), IDS], ids=["one", "all"])
@pytest.mark.parametrize("kind", [AX, MX, *X_KINDS[:2]], ids=lambda kind: kind.name)
def test_the_reply_after_a_late_refusal_is_received(kind: Kind, asked: tuple[int, ...]) -> None:
    """A request repeated while the reply is on the wire would be lost together with the reply."""
    line = Line(kind, BytePort)
    write = line.port.write
    early: list[bytes] = []

    def watched(data: bytes) -> None:
        early.extend([data] if line.servos._free_s > line.clock.now() + 1e-9 else [])
        write(data)

    line.port.write = watched  # type: ignore[method-assign]
    for number in range(6):
        end = None
        if number == 3:
            line.faults.delay_next(4)
            end = refuse(line, 4, 0x10 if kind in (AX, MX) else RESULT_FAIL)
        begin_s = line.clock.now()
        line.bus.read_states(asked, begin_s + (0.0005 * len(asked) + 0.0035 if number == 3 else 0.016))
        if end:
            end()
        line.clock.sleep_until(begin_s + 0.02)
    assert early == []


def test_a_refused_fast_read_costs_no_other_state() -> None:
    line = Line(next(kind for kind in X_KINDS if kind.mapped and not kind.with_goals))
    line.bus.read_states(IDS)
    fast = line.bus._reader._group.fast
    assert fast.known
    end = refuse(line, 4, RESULT_FAIL)
    for _ in range(3 * FAST_TRIES):
        assert {i: kind for i, kind in line.missing().items() if i != 4} == {}
        line.clock.sleep_until(line.clock.now() + 2.0 * OPEN_S)  # so that every cycle can use a fast read
    end()
    assert line.missing() == {}


@pytest.mark.parametrize(("kind", "error"), [(X_KINDS[0], 3), (AX, 0x10)], ids=["x", "ax-12a"])
@pytest.mark.parametrize("number", range(4))
def test_one_corrupt_request_does_not_make_set_up_fail(kind: Kind, error: int, number: int) -> None:
    line = Line(kind)
    servo: Any = line.servos.servo(4)
    answer = servo.answer
    broken = status_packet(4, error) if kind in X_KINDS else wire.packet(4, error, b"")
    replies = iter([None] * number + [broken])
    servo.answer = lambda instruction: next(replies, None) or answer(instruction)
    line.bus.identify(4, kind.models[4])
    assert line.account(4).refused == 1


@pytest.mark.parametrize(("kind", "error"), [(X_KINDS[0], NO_ACCESS), (AX, 0x08)], ids=["x", "ax-12a"])
def test_a_refusal_to_a_single_request_is_counted_and_closes_the_request(kind: Kind, error: int) -> None:
    line = Line(kind)
    end = refuse(line, 4, error)
    with pytest.raises(ServoRefused):
        line.bus.torque_is_on(4)
    assert {name for name, count in line.account(4).as_dict().items() if count} == {"refused"}
    end()
    begin_s = line.clock.now()
    assert not line.bus.torque_is_on(4)
    assert line.clock.now() - begin_s < 0.005
