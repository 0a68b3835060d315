"""Faults specific to the Dynamixel bus: alarms that need a second read, checksums and byte stuffing."""

from drivers.bus.read_plan import state_plan
from drivers.protocol import v2 as wire
from drivers.servos.dynamixel import PROTOCOL_2, X
from drivers.servos.x import hardware_error_status
from drivers.types import ServoState
from sim_backend.line.line import DelayedReply
from sim_backend.packets.dynamixel import status_packet
from tests.drivers.fault_lines import IDS, KINDS, Line
from tests.drivers.tape import one_bit_flipped

BLOCK = X.blocks[0]


def test_reading_the_name_of_an_alarm_keeps_the_deadline() -> None:
    line = Line(KINDS[1])
    budget_s = KINDS[1].table.budget_s
    line.servos.servo(3).firmware.protection.status |= 1 << 5
    receive = line.servos.receive

    def deaf(data: bytes, now_s: float, baud: int = 1_000_000) -> list[DelayedReply]:
        return [] if data[8] == hardware_error_status.address else receive(data, now_s, baud)

    line.servos.receive = deaf  # type: ignore[method-assign]
    begin_s = line.clock.now()
    reading = line.bus.read_states(IDS, begin_s + budget_s)[3]
    assert isinstance(reading, ServoState)
    assert reading.alarms == ("hardware error",)
    assert line.clock.now() <= begin_s + budget_s + 1e-4


def test_both_decoders_agree_and_detect_every_flipped_bit() -> None:
    blocks = [bytes((i * 37 + n * 11) & 0x7F for n in range(BLOCK.size)) for i in IDS]
    data = b"".join(status_packet(i, 0x80 * (i == 3), block) for i, block in zip(IDS, blocks, strict=True))
    whole = state_plan(PROTOCOL_2, dict.fromkeys(IDS, BLOCK), dict.fromkeys(IDS)).decode_all
    fast = whole(data)
    replies = wire.ReplyDecoder(BLOCK.size).feed(data)
    assert fast == {r.servo_id: BLOCK.decode(None, r.error, r.data) for r in replies}
    assert all(whole(flipped) is None for flipped in one_bit_flipped(data))


def test_a_stuffed_reply_and_a_longer_block_are_decoded() -> None:
    longer = X.blocks[2]
    content = b"\xff\xff\xfd" + bytes(longer.size - 3)
    data = status_packet(1, 0, content)
    assert state_plan(PROTOCOL_2, {1: longer}, {1: None}).decode_all(data) is None
    (reply,) = wire.ReplyDecoder(longer.size).feed(data)
    assert longer.decode(None, reply.error, reply.data) == (0, 0, 0.0, 0.0, 0.0, (), None)
