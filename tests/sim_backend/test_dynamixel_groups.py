"""Group instructions of several virtual X series servos, sent by the group classes of the official SDK."""

import importlib
import random
from typing import Any

import pytest
from fastcrc.crc16 import umts as crc16

from drivers.bus.sdk_adapter import SdkAdapter
from drivers.port.line import Line
from drivers.protocol.v2 import BROADCAST_ID, SYNC_READ, packet, span
from drivers.servos import x
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.packets.dynamixel import BROADCAST, Code, fast_block, fast_head, fast_length

# Imported by name, because the SDK has no type hints.
sdk: Any = importlib.import_module("dynamixel_sdk")
handler = sdk.Protocol2PacketHandler()
MODELS = {1: x.XL430_W250, 2: x.XL330_M288, 3: x.XM430_W350}
ADDRESS = x.present_position.address


class Group:
    """Three servos of different models on one line."""

    def __init__(self) -> None:
        self.clock = SimulatedClock()
        self.bus = VirtualDynamixelBus.of(BenchPlant(tuple(MODELS)), MODELS)
        self.port = SdkAdapter(Line(VirtualPort(self.bus, self.clock), self.clock))

    def reader(self, address: int = ADDRESS, size: int = 4) -> Any:
        reader = sdk.GroupSyncRead(self.port, handler, address, size)
        assert all(reader.addParam(i) for i in MODELS)
        return reader

    def bulk_reader(self) -> Any:
        reader = sdk.GroupBulkRead(self.port, handler)
        for i, register in zip(MODELS, (x.present_position, x.present_voltage, x.present_temperature), strict=True):
            assert reader.addParam(i, register.address, register.size)
        return reader

    def sent(self, code: int, parameters: bytes) -> list[tuple[float, bytes]]:
        """Return the replies to a broadcast, each with the time from the end of the instruction in us."""
        request = packet(BROADCAST_ID, code, parameters)
        replies = self.bus.receive(request, now_s=1.0)
        return [(round((r.due_s - 1.0) * 1e6) - 10 * len(request), r.data) for r in replies]


def test_the_fast_sync_read_example_of_the_manual() -> None:
    wire = b""
    for servo_id, position in ((3, 166), (7, 2079), (4, 1023)):
        wire = wire or fast_head(fast_length((4, 4, 4)))
        wire += fast_block(wire, servo_id, 0, position.to_bytes(4, "little"))
    assert wire == bytes.fromhex(
        "ff ff fd 00 fe 19 00 55 00 03 a6 00 00 00 84 08  00 07 1f 08 00 00 16 ca  00 04 ff 03 00 00 d1 9e"
    )


def test_the_fast_bulk_read_example_of_the_manual() -> None:
    wire = fast_head(fast_length((4, 2, 1)))
    for servo_id, data in ((3, "a6000000"), (7, "a501"), (4, "1f")):
        wire += fast_block(wire, servo_id, 0, bytes.fromhex(data))
    assert wire == bytes.fromhex("ff ff fd 00 fe 14 00 55 00 03 a6 00 00 00 67 a4  00 07 a5 01 24 74  00 04 1f d9 c1")


def test_the_sdk_uses_fast_sync_reads() -> None:
    reader = Group().reader()
    assert reader.fastSyncRead() == sdk.COMM_SUCCESS
    assert [reader.getData(i, ADDRESS, 4) for i in MODELS] == [2048] * 3


def test_data_that_look_like_a_header_are_not_stuffed_in_a_fast_reply() -> None:
    group = Group()
    servo = group.bus.servo(2)
    servo.memory.put(x.homing_offset, 0x00FDFFFF - 0x01000000)
    data = servo.memory.read(x.homing_offset.address, 4)
    assert data.startswith(b"\xff\xff\xfd")
    reader = group.reader(x.homing_offset.address)
    assert reader.fastSyncRead() == sdk.COMM_SUCCESS
    assert reader.getData(2, x.homing_offset.address, 4) == int.from_bytes(data, "little")


def test_a_fast_read_is_one_packet_that_comes_in_pieces_without_pauses() -> None:
    group = Group()
    for servo in group.bus.servos:
        servo.memory.put(x.return_delay, 50)
    pieces = group.sent(Code.FAST_SYNC_READ, span(ADDRESS, 4) + bytes(MODELS))
    assert [us for us, _ in pieces] == [260, 340, 420]  # 100 us once, then 16, 8 and 8 bytes
    wire = b"".join(data for _, data in pieces)
    assert len(wire) == 32
    assert crc16(wire[:-2]) == int.from_bytes(wire[-2:], "little")


@pytest.mark.parametrize(("silent", "lengths"), [(1, []), (2, [16]), (3, [16, 8])])
def test_a_silent_servo_ends_a_fast_reply(silent: int, lengths: list[int]) -> None:
    group = Group()
    group.bus.faults.silence(silent)
    pieces = group.sent(Code.FAST_SYNC_READ, span(ADDRESS, 4) + bytes(MODELS))
    assert [len(data) for _, data in pieces] == lengths
    if pieces:
        assert pieces[0][1][5:7] == bytes((25, 0))  # the length also counts the missing blocks
    assert group.reader().fastSyncRead() != sdk.COMM_SUCCESS


def test_a_servo_that_receives_a_broken_block_adds_nothing() -> None:
    group = Group()
    group.bus.faults.corrupt_next(2)
    pieces = group.sent(Code.FAST_SYNC_READ, span(ADDRESS, 4) + bytes(MODELS))
    assert [len(data) for _, data in pieces] == [16, 8]
    assert len(group.sent(Code.FAST_SYNC_READ, span(ADDRESS, 4) + bytes(MODELS))) == 3


@pytest.mark.parametrize(("servo_id", "oldest"), [(1, 45), (2, 46), (3, 45)])
def test_older_firmware_does_not_support_fast_reads(servo_id: int, oldest: int) -> None:
    group = Group()
    memory = group.bus.servo(servo_id).memory
    memory.put(x.firmware_version, oldest)
    assert group.reader().fastSyncRead() == sdk.COMM_SUCCESS
    memory.put(x.firmware_version, oldest - 1)
    assert group.reader().fastSyncRead() != sdk.COMM_SUCCESS
    assert group.reader().txRxPacket() == sdk.COMM_SUCCESS


def test_a_fast_read_beyond_the_table_reports_the_error_and_keeps_its_length() -> None:
    wire = b"".join(data for _, data in Group().sent(Code.FAST_SYNC_READ, span(660, 4) + bytes((1, 2))))
    assert wire[8:14] == bytes((7, 1, 0, 0, 0, 0))
    assert wire[16:22] == bytes((7, 2, 0, 0, 0, 0))


def test_the_sdk_uses_bulk_reads_and_fast_bulk_reads() -> None:
    group = Group()
    for fast in (False, True):
        reader = group.bulk_reader()
        assert (reader.fastBulkRead() if fast else reader.txRxPacket()) == sdk.COMM_SUCCESS
        assert reader.getData(1, x.present_position.address, 4) == 2048
        assert reader.getData(2, x.present_voltage.address, 2) == 50  # 5 V
        temperature = group.bus.servo(3).memory.get(x.present_temperature)
        assert reader.getData(3, x.present_temperature.address, 1) == temperature > 0


READS = {
    "sync": (SYNC_READ, span(ADDRESS, 4) + bytes(MODELS)),
    "bulk": (Code.BULK_READ, b"".join(bytes((i,)) + span(ADDRESS, 4) for i in MODELS)),
}


def test_the_replies_to_a_bulk_read_come_one_after_the_other() -> None:
    wanted = b"".join(bytes((i,)) + span(ADDRESS, size) for i, size in ((1, 4), (2, 2), (3, 1)))
    sent = Group().sent(Code.BULK_READ, wanted)
    assert [(us, len(data)) for us, data in sent] == [(152, 15), (284, 13), (406, 12)]


@pytest.mark.parametrize("read", READS.values(), ids=READS)
@pytest.mark.parametrize("silent", MODELS)
def test_a_silent_servo_silences_the_servos_that_are_named_after_it(silent: int, read: tuple[int, bytes]) -> None:
    group = Group()
    group.bus.faults.silence(silent)
    assert [data[4] for _, data in group.sent(*read)] == [i for i in MODELS if i < silent]
    group.bus.faults.restore(silent)
    assert [data[4] for _, data in group.sent(*read)] == list(MODELS)


@pytest.mark.parametrize("read", READS.values(), ids=READS)
def test_a_reply_that_is_lost_on_the_wire_ends_a_group_read(read: tuple[int, bytes]) -> None:
    group = Group()
    group.bus.faults.on_reply.append(lambda servo_id, packet: b"" if servo_id == 2 else packet)
    assert [data[4] for _, data in group.sent(*read) if data] == [1]


@pytest.mark.parametrize("read", READS.values(), ids=READS)
def test_a_reply_that_the_adapter_holds_back_does_not_end_a_group_read(read: tuple[int, bytes]) -> None:
    group = Group()
    group.bus.faults.delay_next(2)
    assert [data[4] for _, data in group.sent(*read) if data] == [1, 3]


def test_a_servo_that_answers_only_pings_has_no_turn() -> None:
    group = Group()
    group.bus.servo(3).memory.put(x.status_return_level, 0)
    assert len(group.sent(SYNC_READ, span(ADDRESS, 4) + bytes(MODELS))) == 2
    assert len(group.sent(Code.FAST_SYNC_READ, span(ADDRESS, 4) + bytes(MODELS))) == 2


def test_the_sdk_uses_bulk_writes() -> None:
    group = Group()
    writer = sdk.GroupBulkWrite(group.port, handler)
    assert writer.addParam(1, x.led.address, 1, [1])
    assert writer.addParam(2, x.profile_velocity.address, 4, [7, 0, 0, 0])
    assert writer.addParam(3, x.position_p_gain.address, 2, [0, 2])
    assert writer.txPacket() == sdk.COMM_SUCCESS
    get = [group.bus.servo(i).memory.get for i in MODELS]
    assert (get[0](x.led), get[1](x.profile_velocity), get[2](x.position_p_gain)) == (1, 7, 512)
    assert get[2](x.led) == 0


@pytest.mark.parametrize("cut", [1, 5, 6, 8])
def test_an_incomplete_bulk_write_entry_is_ignored(cut: int) -> None:
    group = Group()
    whole = bytes((1,)) + span(x.led.address, 1) + b"\x01"
    half = bytes((2,)) + span(x.profile_velocity.address, 4) + b"\x07\0\0\0"
    assert group.sent(Code.BULK_WRITE, whole + half[:-cut]) == []
    assert group.bus.servo(1).memory.get(x.led) == 1
    assert group.bus.servo(2).memory.get(x.profile_velocity) == 0


@pytest.mark.parametrize(
    "code",
    [Code.FAST_SYNC_READ, Code.BULK_READ, Code.FAST_BULK_READ, Code.BULK_WRITE],
)
@pytest.mark.parametrize("parameters", [b"", b"\x01", bytes((1, 132, 0, 4)), bytes((132, 0, 4, 0))])
def test_a_group_instruction_without_servos_is_ignored(code: Code, parameters: bytes) -> None:
    assert Group().sent(code, parameters) == []


def test_two_servos_with_the_same_id_reply_at_once() -> None:
    group = Group()
    group.bus.servo(2).memory.put(x.servo_id, 1)
    pieces = group.sent(Code.FAST_SYNC_READ, span(x.model_number.address, 2) + bytes((1, 3)))
    assert len(pieces) == 1  # both blocks are combined by AND, so the next servo receives a wrong checksum
    assert pieces[0][1][10:12] == bytes((1060 & 0xFF & 1200, (1060 & 1200) >> 8))


@pytest.mark.parametrize("seed", [pytest.param(seed, marks=() if seed < 4 else pytest.mark.slow) for seed in range(20)])
def test_random_group_instructions_do_not_break_the_bus(seed: int) -> None:
    chance = random.Random(seed)
    group = Group()
    codes = [
        Code.SYNC_READ,
        Code.FAST_SYNC_READ,
        Code.BULK_READ,
        Code.FAST_BULK_READ,
        Code.SYNC_WRITE,
        Code.BULK_WRITE,
    ]
    for _ in range(20):
        few = [0, 1, 2, 3, 4, 64, 132, 168, 224, 254, 255]
        parameters = bytes(chance.choice(few) for _ in range(chance.randrange(40)))
        group.bus.receive(packet(BROADCAST, chance.choice(codes), parameters), now_s=1.0)
    group.bus.advance(1.01)
