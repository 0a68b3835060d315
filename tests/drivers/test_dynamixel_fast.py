"""Fast sync reads: when the bus uses them and stops using them, and that it never accepts partial replies."""

import logging
from collections.abc import Callable, Mapping, Sequence

import pytest
from fastcrc.crc16 import umts as crc16

from drivers.bus.bus import Bus
from drivers.bus.fast_read import FAST_TRIES, fast_plan
from drivers.bus.late_replies import OPEN_S
from drivers.protocol import v2 as wire
from drivers.servos import x
from drivers.servos.dynamixel import X
from drivers.servos.series import StateBlock
from drivers.types import Reading, ServoFault, ServoGoal, ServoState
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.faults import Disturbance
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.packets.dynamixel import Code, InstructionParser
from sim_backend.packets.instructions import Instruction
from tests.drivers.cycles import exchange
from tests.drivers.tape import one_bit_flipped

IDS = (1, 2, 3, 4)
BLOCK = X.blocks[0]
SIZE = BLOCK.size
NONE = (None,) * len(IDS)
Spoil = Callable[[bytes], bytes]


def numbers(servo_id: int) -> bytes:
    """Return a state whose values encode the servo."""
    return BLOCK.fields.pack(servo_id, 2 * servo_id, -servo_id, 1000 * servo_id, 120, 30)


def fast_reply(size: int = SIZE, ids: tuple[int, ...] = IDS, error: int = 0) -> bytes:
    """Encode the common packet of all servos, with the checksums of all parts."""
    packet = wire.fast_head(len(ids), size)
    for servo_id in ids:
        packet += bytes((error, servo_id)) + bytes(size - SIZE) + numbers(servo_id)
        packet += crc16(packet).to_bytes(2, "little")
    return packet


def whole(data: bytes, ids: tuple[int, ...], block: StateBlock, units_a: Sequence[float | None] = NONE) -> object:
    """Decode all states, if the packet is complete."""
    return fast_plan(block, dict(zip(ids, units_a, strict=True))).decode_all(data)


class Line:
    """A port with servos that answer sync reads and, if a test enables them, fast sync reads."""

    name, baud = "line", 1_000_000

    def __init__(self, spoil: Spoil = lambda packet: packet) -> None:
        self.clock = SimulatedClock(1.0)
        self.sent: list[Instruction] = []
        self.spoil = spoil
        self.silent: set[int] = set()
        self.echo = False
        self._parser = InstructionParser()
        self.input = b""
        self.bus = Bus(self, self.clock, dict.fromkeys(IDS, x.XL430_W250))

    def discard_input(self) -> None:
        self.input = b""

    def close(self) -> None: ...
    def set_baud(self, baud: int) -> None: ...

    def read(self, size: int, deadline_s: float) -> bytes:
        data, self.input = self.input[:size], self.input[size:]
        if len(data) < size:
            self.clock.sleep_until(deadline_s)
        return data

    def write(self, data: bytes) -> None:
        if self.echo:
            self.input += data
        for instruction in self._parser.feed(data):
            self.sent.append(instruction)
            size, ids = int.from_bytes(instruction.parameters[2:4], "little"), tuple(instruction.parameters[4:])
            if instruction.code == Code.FAST_SYNC_READ:
                self.input += self.spoil(self._fast(size, ids))
            elif instruction.code == Code.SYNC_READ:
                for servo_id in ids:
                    if servo_id not in self.silent:
                        data = b"\0" + bytes(size - SIZE) + numbers(servo_id)
                        self.input += wire.packet(servo_id, wire.STATUS, data)

    def _fast(self, size: int, ids: tuple[int, ...]) -> bytes:
        """Encode the reply. Servos after a silent servo do not reply."""
        whole = fast_reply(size, ids)
        before = next((n for n, i in enumerate(ids) if i in self.silent), len(ids))
        return whole[: (wire.FAST_HEAD_SIZE if before else 0) + before * (size + wire.FAST_OVERHEAD)]

    def codes(self) -> list[int]:
        """Return the instructions sent since the last call."""
        codes, self.sent = [instruction.code for instruction in self.sent], []
        return codes

    def cycle(self) -> Mapping[int, Reading]:
        return self.bus.read_states(IDS, self.clock.now() + 0.02)


def ready() -> Line:
    """Return a bus that has detected support for fast reads."""
    line = Line()
    assert right(line.bus.read_states(IDS))
    assert line.codes() == [Code.SYNC_READ, Code.FAST_SYNC_READ]
    return line


def right(readings: Mapping[int, Reading], but: frozenset[int] = frozenset()) -> bool:
    """Return whether each servo has its own state, except for the servos in ``but``, which have a fault."""
    return list(readings) == list(IDS) and all(
        isinstance(r, ServoFault) if i in but else isinstance(r, ServoState) and r.position_counts == 1000 * i
        for i, r in readings.items()
    )


def test_a_cycle_is_one_request_followed_by_the_goals() -> None:
    line = ready()
    assert right(line.cycle())
    assert right(exchange(line.bus, {i: ServoGoal(0) for i in IDS}, IDS, line.clock.now() + 0.02))
    assert line.codes() == [Code.FAST_SYNC_READ, Code.FAST_SYNC_READ, Code.SYNC_WRITE]
    assert all(account.replies == 3 for account in line.bus.counters.servos.values())


def test_the_exchange_size_is_that_of_a_fast_read() -> None:
    line = ready()
    goals = {i: ServoGoal(0) for i in IDS[1:]}
    on_wire = len(wire.sync_write(X.goal_address, X.goal_size, bytes(9) * len(goals)))
    assert line.bus.exchange_size(goals, IDS) == on_wire + len(wire.fast_sync_read(IDS, 124, SIZE)) + len(fast_reply())


def test_fast_reads_work_with_an_echo() -> None:
    line = Line()
    line.echo = True
    for _ in range(3):
        assert right(line.bus.read_states(IDS))
    line.codes()
    assert right(line.cycle())
    assert line.codes() == [Code.FAST_SYNC_READ]


@pytest.mark.parametrize("spoil", [lambda packet: b"", lambda packet: packet[:-1], lambda packet: packet[:40]])
def test_unsupported_fast_reads_are_logged_once_and_not_repeated(
    spoil: Spoil, caplog: pytest.LogCaptureFixture
) -> None:
    line = Line(spoil)
    with caplog.at_level(logging.INFO, "servoloop.drivers"):
        for _ in range(3):
            assert right(line.bus.read_states(IDS))
            assert right(line.cycle())
    assert line.codes().count(Code.FAST_SYNC_READ) == 1
    assert [record.message for record in caplog.records] == [
        "line: using plain sync reads, because not every servo supports fast sync reads"
    ]
    assert all((a.replies, a.silent, a.corrupt, a.late) == (6, 0, 0, 0) for a in line.bus.counters.servos.values())


@pytest.mark.parametrize("silent", IDS)
def test_a_silent_servo_does_not_hide_others(silent: int) -> None:
    line = ready()
    line.silent = {silent}
    for _ in range(8):
        assert right(line.cycle(), frozenset({silent}))
    first, *rest = line.codes()
    assert first == Code.FAST_SYNC_READ
    assert rest[0] == Code.SYNC_READ
    account = line.bus.counters.of(silent)
    assert account.corrupt == account.late == account.replies - 1 == 0
    line.silent = set()
    line.clock.sleep_until(line.clock.now() + OPEN_S)
    assert right(line.cycle())
    line.clock.sleep_until(line.clock.now() + OPEN_S)
    line.codes()
    assert right(line.cycle())
    assert line.codes() == [Code.FAST_SYNC_READ]


def test_every_flipped_bit_is_detected_and_every_request_counted_once() -> None:
    packet = fast_reply()
    for spoiled in one_bit_flipped(packet):
        assert whole(spoiled, IDS, BLOCK) is None
        line = ready()
        before = {i: account.replies for i, account in line.bus.counters.servos.items()}
        line.spoil = lambda packet, spoiled=spoiled: spoiled  # type: ignore[misc]
        assert right(line.cycle())
        assert line.codes() == [Code.FAST_SYNC_READ, Code.SYNC_READ]
        assert line.bus.counters.noise == 1  # the fault cannot be attributed to a servo
        for servo_id, account in line.bus.counters.servos.items():
            assert account.replies == before[servo_id] + 1
            assert account.silent == account.corrupt == account.late == account.retries == 0


@pytest.mark.parametrize("noise", [b"\0", b"\xff\xff\xfd", b"\xff\xff\xfd\x00\xfe", bytes(30)])
def test_noise_causes_a_plain_read(noise: bytes) -> None:
    line = ready()
    line.spoil = lambda packet: noise + packet
    assert right(line.cycle())
    assert line.codes() == [Code.FAST_SYNC_READ, Code.SYNC_READ]
    line.spoil = lambda packet: packet
    assert right(line.cycle())
    assert line.codes() == [Code.SYNC_READ]  # a reply that has failed may still continue
    line.clock.sleep_until(line.clock.now() + OPEN_S)
    assert right(line.cycle())
    assert line.codes() == [Code.FAST_SYNC_READ]


def test_a_late_packet_is_never_a_reply_to_the_next_request() -> None:
    line = ready()
    held: list[bytes] = []
    line.spoil = lambda packet: held.append(packet) or b""  # type: ignore[func-returns-value]
    write = line.write

    def late(data: bytes) -> None:
        line.input += held.pop() if held else b""
        write(data)

    line.write = late  # type: ignore[method-assign]
    line.codes()
    assert right(line.cycle())
    first, *others = line.codes()
    assert first == Code.FAST_SYNC_READ
    assert set(others) == {Code.SYNC_READ}  # a plain read does not accept the common packet as the reply of one servo
    assert line.bus.counters.noise > 0


class DelayedReplies:
    """Replies that arrive some time after their request, as on a busy machine."""

    def __init__(self, line: Line, delay_s: float) -> None:
        self._line, self._delay_s, self._due_s, self._write = line, delay_s, 0.0, line.write
        line.write = self.write  # type: ignore[method-assign]
        line.read = self.read  # type: ignore[method-assign]

    def write(self, data: bytes) -> None:
        self._due_s = self._line.clock.now() + self._delay_s
        self._write(data)

    def read(self, size: int, deadline_s: float) -> bytes:
        line = self._line
        line.clock.sleep_until(min(max(self._due_s, line.clock.now()), deadline_s))
        if line.clock.now() < self._due_s:
            return b""
        data, line.input = line.input[:size], line.input[size:]
        return data


def test_a_fast_reply_that_is_late_by_some_milliseconds_is_awaited() -> None:
    line = ready()
    DelayedReplies(line, 0.006)
    assert right(line.bus.read_states(IDS, line.clock.now() + 0.03))
    assert line.codes() == [Code.FAST_SYNC_READ]


def test_a_late_reply_is_not_awaited_without_time_for_separate_replies() -> None:
    line = ready()
    DelayedReplies(line, 1.0)
    begun_s = line.clock.now()
    line.bus.request(IDS, begun_s + 0.008)
    line.bus.receive()
    assert line.codes()[:2] == [Code.FAST_SYNC_READ, Code.SYNC_READ]


def test_too_many_consecutive_failures_end_fast_reads(caplog: pytest.LogCaptureFixture) -> None:
    line = ready()
    line.spoil = lambda packet: packet[:-1] + bytes((packet[-1] ^ 1,))
    for _ in range(FAST_TRIES + 3):
        assert right(line.cycle())
        line.clock.sleep_until(line.clock.now() + 2.0 * OPEN_S)  # no request is open
    assert line.codes().count(Code.FAST_SYNC_READ) == FAST_TRIES
    assert [
        record.levelname for record in caplog.records if "consecutive fast sync reads failed" in record.message
    ] == ["WARNING"]


def test_a_packet_has_all_states_and_alarms_and_a_refusal_has_none() -> None:
    for block in X.blocks:
        packet = fast_reply(block.size, error=wire.ALERT)
        units_a = (None, 0.001, None, 0.00269)
        states = whole(packet, IDS, block, units_a)
        assert isinstance(states, dict)
        assert [reading.current_a for reading in states.values()] == [None, 0.004, None, 8 * 0.00269]
        assert [reading.alarms for reading in states.values()] == [("hardware error",)] * 4
        assert whole(packet + b"\0", IDS, block) is whole(packet, IDS[::-1], block) is None
        assert whole(fast_reply(block.size, error=2), IDS, block) is None


def test_the_example_of_the_manual_has_the_expected_length() -> None:
    assert wire.fast_head(3, 4) == bytes.fromhex("fffffd00 fe 1900 55")
    assert x.present_pwm.address == 124


def test_thousands_of_fast_cycles_with_line_errors() -> None:
    """Every value is correct, and a plain read recovers the states that a fast read has lost."""
    ids = (1, 2, 3, 4, 5, 6, 7)
    clock = SimulatedClock(5.0)
    servos = VirtualDynamixelBus.of(BenchPlant(ids), dict.fromkeys(ids, x.XL430_W250))
    bus = Bus(VirtualPort(servos, clock), clock, dict.fromkeys(ids, x.XL430_W250))
    good = bus.read_states(ids)
    servos.faults.disturbance = done = Disturbance(seed=5, drop=0.002, flip=0.001, noise=0.001)
    missing = 0
    for _ in range(2000):
        readings = bus.read_states(ids, clock.now() + 0.012)
        missing += sum(isinstance(reading, ServoFault) for reading in readings.values())
        assert all(reading == good[i] for i, reading in readings.items() if isinstance(reading, ServoState))
        clock.sleep_until(clock.now() + 0.015)
    assert bus._reader._group.fast.known
    assert missing < 50  # of 14,000 states: a lost reply also silences the servos after it
    faults = bus.counters.faults()
    assert faults["silent"] + faults["corrupt"] + faults["noise"] > sum(done.done.values()) / 2
    for servo_id in ids:
        account = bus.counters.of(servo_id)
        ended = account.replies + account.silent + account.corrupt + account.late + account.no_time
        assert ended == 2001 + account.retries
