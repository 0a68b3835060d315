"""The servo side of the bus: parsing a stream of bytes that is split at any place and contains garbage."""

import importlib
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_backend.packets.instructions import Instruction
from sim_backend.packets.sts import Code, InstructionParser, StsParser, checksum, status_packet

# Imported by name, because the SDK has no type hints.
sdk: Any = importlib.import_module("scservo_sdk")

instructions = st.builds(
    Instruction,
    servo_id=st.integers(0, 0xFE),
    code=st.sampled_from(list(Code)).map(int),
    parameters=st.binary(max_size=60),
)


def packet(instruction: Instruction) -> bytes:
    """Return an instruction as a master sends it."""
    parameters = instruction.parameters
    body = bytes((instruction.servo_id, len(parameters) + 2, instruction.code)) + parameters
    return b"\xff\xff" + body + bytes((checksum(body),))


def parsed(*portions: bytes) -> list[Instruction]:
    parser = InstructionParser()
    return [instruction for portion in portions for instruction in parser.feed(portion)]


@pytest.mark.parametrize(
    ("stream", "meant"),
    [
        # The examples of Feetech's protocol manual.
        ("FF FF 01 02 01 FB", Instruction(1, Code.PING)),
        ("FF FF 01 04 02 38 02 BE", Instruction(1, Code.READ, b"\x38\x02")),
        (
            "FF FF 01 09 03 2A 00 08 00 00 E8 03 D5",
            Instruction(1, Code.WRITE, bytes.fromhex("2A 00 08 00 00 E8 03")),
        ),
        ("FF FF FE 02 05 FA", Instruction(0xFE, Code.ACTION)),
        # A third FF before the packet; an unknown instruction.
        ("FF FF FF 01 02 01 FB", Instruction(1, Code.PING)),
        ("FF FF 01 02 0A F2", Instruction(1, 0x0A)),
    ],
)
def test_valid_packets_are_parsed(stream: str, meant: Instruction) -> None:
    assert parsed(bytes.fromhex(stream)) == [meant]


@pytest.mark.parametrize(
    "stream",
    [
        "FF FF 01 02 01 FA",  # wrong checksum
        "FF FF 01 02 01",  # half a packet
        "FF FF 01 01 FD",  # the length leaves no room for an instruction
        "FF 01 02 01 FB",  # half a header
        "",
    ],
)
def test_invalid_streams_yield_no_instruction(stream: str) -> None:
    assert parsed(bytes.fromhex(stream)) == []


def test_a_packet_after_a_half_packet_is_found() -> None:
    half = bytes.fromhex("FF FF 01 04 02 38")
    assert parsed(half + bytes.fromhex("FF FF 05 02 01 F7")) == [Instruction(5, Code.PING)]


def test_a_reset_discards_a_half_packet() -> None:
    parser = InstructionParser()
    assert list(parser.feed(bytes.fromhex("FF FF 01 FA 03"))) == []
    assert parser.pending == 5
    parser.reset()
    assert list(parser.feed(bytes.fromhex("FF FF 05 02 01 F7"))) == [Instruction(5, Code.PING)]


@settings(deadline=None)
@given(st.lists(instructions, max_size=5), st.data())
def test_any_split_of_the_stream_gives_the_same_packets(sent: list[Instruction], data: st.DataObject) -> None:
    stream = b"".join(map(packet, sent))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    ends = zip([0, *cuts], [*cuts, len(stream)], strict=True)
    assert parsed(*(stream[begin:end] for begin, end in ends)) == sent


@settings(deadline=None)
@given(st.binary(max_size=200), st.data())
def test_any_split_of_garbage_gives_the_same_packets(stream: bytes, data: st.DataObject) -> None:
    cut = data.draw(st.integers(0, len(stream)))
    assert parsed(stream[:cut], stream[cut:]) == parsed(stream)


# Headers and sizes in unexpected places.
pieces = st.one_of(
    st.sampled_from([b"\xff", b"\xff\xff", b"\x00", b"\x02", b"\x83", b"\xfc"]), instructions.map(packet)
)


@settings(deadline=None)
@given(st.lists(pieces, max_size=8).map(b"".join))
def test_an_sts_parses_a_portion_like_single_bytes(stream: bytes) -> None:
    at_once, piecemeal = StsParser(), StsParser()
    whole = [(instruction, at_once.pending) for instruction in at_once.feed(stream)]
    single = [
        (instruction, len(stream) - end)
        for end in range(1, len(stream) + 1)
        for instruction in piecemeal.feed(stream[end - 1 : end])
    ]
    assert whole == single


@settings(deadline=None)
@given(st.lists(st.tuples(st.binary(max_size=20), instructions), max_size=4))
def test_garbage_between_packets_is_skipped(sent: list[tuple[bytes, Instruction]]) -> None:
    stream = b"".join(garbage.replace(b"\xff", b"") + packet(i) for garbage, i in sent)
    assert parsed(stream) == [instruction for _, instruction in sent]


@settings(deadline=None)
@given(st.integers(0, 0xFD), st.integers(0, 0x7F), st.binary(max_size=100))
def test_a_status_packet_has_a_correct_checksum(servo_id: int, error: int, data: bytes) -> None:
    status = status_packet(servo_id, error, data)
    assert status[:5] == bytes((0xFF, 0xFF, servo_id, len(data) + 2, error))
    assert status[5:-1] == data
    assert sum(status[2:]) & 0xFF == 0xFF


class CapturingPort:
    """The part of a port that the official SDK needs to send packets; it never receives a reply."""

    is_using = False

    def __init__(self) -> None:
        self.sent = b""

    def clearPort(self) -> None: ...

    def writePort(self, packet: list[int]) -> int:
        self.sent += bytes(packet)
        return len(packet)

    def setPacketTimeout(self, length: int) -> None: ...

    def readPort(self, length: int) -> bytes:
        return b""

    def isPacketTimeout(self) -> bool:
        return True


def _sync_write(handler: Any, port: CapturingPort) -> None:
    group = sdk.GroupSyncWrite(port, handler, 42, 2)
    group.addParam(3, [0x10, 0x20])
    group.addParam(1, [0x30, 0x40])
    group.txPacket()


def _sync_read(handler: Any, port: CapturingPort) -> None:
    group = sdk.GroupSyncRead(port, handler, 56, 8)
    group.addParam(3)
    group.addParam(1)
    group.txPacket()


@pytest.mark.parametrize(
    ("send", "meant"),
    [
        (lambda h, p: h.ping(p, 7), Instruction(7, Code.PING)),
        (lambda h, p: h.read2ByteTx(p, 7, 56), Instruction(7, Code.READ, b"\x38\x02")),
        (
            lambda h, p: h.write2ByteTxOnly(p, 7, 42, 0x0203),
            Instruction(7, Code.WRITE, b"\x2a\x03\x02"),
        ),
        (
            lambda h, p: h.regWriteTxOnly(p, 7, 41, 1, [5]),
            Instruction(7, Code.REG_WRITE, b"\x29\x05"),
        ),
        (lambda h, p: h.action(p, 0xFE), Instruction(0xFE, Code.ACTION)),
        (_sync_write, Instruction(0xFE, Code.SYNC_WRITE, bytes.fromhex("2A 02 03 10 20 01 30 40"))),
        (_sync_read, Instruction(0xFE, Code.SYNC_READ, bytes.fromhex("38 08 03 01"))),
    ],
)
def test_packets_of_the_official_sdk_are_parsed(
    send: Callable[[Any, CapturingPort], object], meant: Instruction
) -> None:
    port = CapturingPort()
    send(sdk.protocol_packet_handler(), port)
    assert parsed(port.sent) == [meant]
