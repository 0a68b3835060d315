"""Table and instructions of an STS3215 as seen over the virtual wire, byte for byte.

docs/simulation.md lists the behavior that each test checks. Numbers in these tests are register addresses.
"""

import pytest

from sim_backend.line.power import feed
from tests.sim_backend.sts_wire import Wire, packet, word

# The table.


def test_registers_80_to_86_are_saved_only_with_the_lock_open() -> None:
    wire = Wire()
    values = bytes((3, 21, 40, 2, 140, 90, 2))
    wire.write(80, values)
    assert wire.read(80, 7) == int.from_bytes(values, "little")
    feed(wire.bus, 0.0)
    feed(wire.bus, 12.0)
    wire.wait(1.0)
    assert wire.read(80, 7) == int.from_bytes(bytes((2, 20, 50, 1, 150, 100, 1)), "little")
    wire.write(55, b"\x00")
    wire.write(80, values)
    feed(wire.bus, 0.0)
    feed(wire.bus, 12.0)
    wire.wait(1.0)
    assert wire.read(80, 7) == int.from_bytes(values, "little")


def test_register_16_is_copied_to_48_at_power_on() -> None:
    wire = Wire()
    wire.write(55, b"\x00")
    wire.write(16, word(300))
    wire.held = 2048
    wire.go(3000)
    wire.wait(0.5)
    assert (wire.read(48, 2), wire.read(60, 2) & 0x3FF) == (1000, 970)
    feed(wire.bus, 0.0)
    feed(wire.bus, 12.0)
    wire.wait(1.0)
    wire.go(3000)
    wire.wait(0.5)
    assert (wire.read(48, 2), wire.read(60, 2) & 0x3FF) == (300, 300)


def test_register_values_after_power_on() -> None:
    wire = Wire()
    wire.go(2500, 100)
    feed(wire.bus, 0.0)
    feed(wire.bus, 12.0)
    wire.wait(1.0)
    assert [wire.read(at) for at in (40, 41, 55)] == [0, 0, 1]
    assert [wire.read(at, 2) for at in (42, 46, 48)] == [0, 0, 1000]


def test_reads_at_the_tables_end() -> None:
    wire = Wire()
    assert wire.send(packet(1, 2, 84, 8)) == [bytes((0xFF, 0xFF, 1, 5, 0, 150, 100, 1, ~(1 + 5 + 251) & 0xFF))]
    assert wire.send(packet(1, 2, 87, 1)) == []
    assert wire.send(packet(1, 2, 60, 0)) == [packet(1, 0)]
    assert wire.send(packet(1, 3, 87, 9)) == [packet(1, 0)]


@pytest.mark.parametrize(("address", "torque"), [(85, 1), (87, 1), (200, 1)])
def test_a_write_beyond_the_table_has_no_effect_and_cancels_no_goal(address: int, torque: int) -> None:
    wire = Wire()
    before = wire.send(packet(1, 2, 0, 0))
    assert wire.send(packet(1, 3, 87, 9) + packet(1, 3, 200, *range(50))) == [packet(1, 0) * 2]
    assert wire.send(packet(1, 2, 0, 0)) == before
    wire.send(packet(1, 3, 42, *word(2500)) + packet(1, 3, address, 9))
    wire.wait(0.5)
    assert wire.read(40) == torque * (address >= 87)


# The instructions.


@pytest.mark.parametrize("instruction", [(0x55,), (7, 1, 2), (5,), (3,)])
def test_unknown_instructions_are_answered_with_an_empty_status(instruction: tuple[int, ...]) -> None:
    assert Wire().send(packet(1, *instruction)) == [packet(1, 0)]


def test_register_8_at_0_answers_only_pings_and_reads() -> None:
    wire = Wire()
    assert wire.send(packet(1, 3, 8, 0)) == []
    assert wire.send(packet(1, 3, 41, 5)) == wire.send(packet(1, 0x55)) == []
    assert len(wire.send(packet(1, 1))) == 1
    assert wire.read(41) == 5
    assert len(wire.send(packet(0xFE, 0x82, 56, 2, 1))) == 1
    assert wire.send(packet(1, 3, 8, 1)) == [packet(1, 0)]


def test_a_broadcast_read_is_answered_and_a_broadcast_write_is_not() -> None:
    wire = Wire()
    assert wire.send(packet(0xFE, 3, 41, 7)) == []
    assert wire.send(packet(0xFE, 2, 41, 1)) == [packet(1, 0, 7)]


def test_two_servos_answer_a_broadcast_read_at_once() -> None:
    (answer,) = Wire(1, 2).send(packet(0xFE, 2, 41, 1))
    assert answer == bytes(a & b for a, b in zip(packet(1, 0, 0), packet(2, 0, 0), strict=True))


def test_a_reg_write_without_data_sets_64_but_writes_nothing() -> None:
    for parameters in ((), (41,)):
        wire = Wire()
        assert wire.send(packet(1, 4, *parameters)) == [packet(1, 0)]
        assert wire.read(64) == 1
        assert wire.send(packet(1, 5)) == [packet(1, 0)]
        assert (wire.read(64), wire.read(41)) == (0, 0)


@pytest.mark.parametrize(
    ("parameters", "reading"),
    [((), 2048), (word(0), 0), (word(1000), 1000), (word(4095), 4095), (word(0xFFFE), 4094), (word(4096), 3000)],
)
def test_instruction_11_sets_the_count_and_keeps_the_torque(parameters: bytes, reading: int) -> None:
    wire = Wire()
    wire.turn_to(3000)
    wire.wait(0.1)
    wire.write(40, b"\x01")
    assert wire.send(packet(1, 11, *parameters)) == [packet(1, 0)]
    wire.wait(0.2)
    assert wire.read(40) == 1
    assert (wire.read(56, 2) - reading + 4) % 4096 <= 8
    assert (3000 - offset_of(wire.read(31, 2)) - reading + 4) % 4096 <= 8


def test_instruction_11_with_one_parameter_changes_nothing() -> None:
    wire = Wire()
    assert wire.send(packet(1, 11, 0)) == [packet(1, 0)]
    assert (wire.read(31, 2), wire.read(56, 2)) == (0, 2048)


def offset_of(value: int) -> int:
    size = (value & 0x7FF) + (value >> 12 & 1) * 2048
    return -size if value >> 11 & 1 else size


@pytest.mark.parametrize(
    ("value", "reading"),
    [
        (100, 2947), (2048 + 100, 3147), (2048, 3047), (4096, 999), (4096 + 100, 899), (6144, 999), (6144 + 100, 1099),
        (1 << 13, 3047), (3 << 13, 3047), (0xFFFE, 3049),
    ],
)  # fmt: skip
def test_bits_12_to_15_of_the_homing_offset(value: int, reading: int) -> None:
    wire = Wire()
    wire.turn_to(3047)
    wire.write(31, word(value))
    wire.wait(0.1)
    assert wire.read(56, 2) == pytest.approx(reading, abs=1)


def test_a_servo_named_twice_in_a_sync_read_answers_once() -> None:
    wire = Wire(1, 2, paced=True)
    asked = packet(0xFE, 0x82, 56, 8, 1, 1, 2)
    first, second = wire.bus.receive(asked, 5.0)
    assert (first.data[2], second.data[2]) == (1, 2)
    assert second.due_s - first.due_s == pytest.approx((2 * 17 - 1) * 1e-5)


@pytest.mark.parametrize(("index", "baud", "byte_us"), [(6, 57_600, 174), (5, 76_800, 131), (4, 115_200, 87)])
def test_a_slot_counts_whole_microseconds_per_byte(index: int, baud: int, byte_us: int) -> None:
    wire = Wire(1, 2, paced=True)
    for servo_id in (1, 2):
        wire.bus.receive(packet(servo_id, 3, 6, index), float(servo_id))
    asked = packet(0xFE, 0x82, 56, 8, 1, 2)
    _, second = wire.bus.receive(asked, 5.0, baud)
    assert second.due_s - 5.0 == pytest.approx((len(asked) + 14) * 10 / baud + 17 * byte_us * 1e-6, abs=1e-7)


def test_a_slot_shortens_with_a_reply_at_the_end_of_the_table() -> None:
    wire = Wire(1, 2, paced=True)
    asked = packet(0xFE, 0x82, 84, 20, 1, 2)
    _, second = wire.bus.receive(asked, 5.0)
    assert second.due_s - 5.0 == pytest.approx((len(asked) + 9 + 3 + 9) * 1e-5)


def test_ff_ff_within_a_packet_starts_a_new_packet() -> None:
    wire = Wire()
    assert wire.send(packet(1, 3, 42, 0xFF, 0xFF)) == []  # the goal -32767 does not arrive
    assert wire.read(42, 2) == 0
    assert wire.send(packet(1, 3, 42, 1, 1)[:5] + packet(1, 1)) == [packet(1, 0)]


@pytest.mark.parametrize(
    ("entries", "written"),
    [
        ((1, 7, 8, 1, 9, 10), (9, 10)),
        ((1, 7, 8, 2, 5, 6, 1, 9), (9, 0)),  # the last entry counts, as far as it is complete
        ((1, 7, 8, 1), (0, 0)),
        ((1, 7, 8, 2), (7, 8)),
    ],
)
def test_the_last_of_two_entries_in_a_sync_write_wins(entries: tuple[int, ...], written: tuple[int, int]) -> None:
    wire = Wire(1, 2)
    assert wire.send(packet(0xFE, 0x83, 50, 2, *entries)) == []
    assert wire.servo.memory.read(50, 2) == bytes(written)


@pytest.mark.parametrize(("servos", "size"), [(16, 7), (31, 7), (83, 2)])
def test_a_sync_write_can_have_the_maximum_length(servos: int, size: int) -> None:
    goals = {servo_id: word(2048 + servo_id) for servo_id in range(1, servos + 1)}
    wire = Wire(*goals)
    entries = [value for servo_id, goal in goals.items() for value in (servo_id, *goal.ljust(size, b"\0"))]
    assert wire.send(packet(0xFE, 0x83, 42, size, *entries)) == []
    assert {servo_id: wire.bus.servo(servo_id).memory.read(42, 2) for servo_id in goals} == goals


def test_other_instructions_have_at_most_128_parameters() -> None:
    wire = Wire()
    assert wire.send(packet(1, 3, 41, *range(1, 128))) == [packet(1, 0)]
    assert wire.send(packet(1, 3, 41, *range(2, 130))) == []
    assert wire.read(41) == 1
    assert wire.send(packet(0xFE, 0x82, 56, 2, *range(2, 128), 1)) == []


@pytest.mark.parametrize("damaged", [packet(1, 3, 42, 0, 8), packet(1, 2, 56, 2), packet(9, 3, 41, 1), packet(1, 1)])
def test_the_request_after_a_damaged_one_is_answered(damaged: bytes) -> None:
    asked, answer = packet(1, 2, 5, 1), packet(1, 0, 1)
    for place in range(len(damaged)):
        for left in (damaged[:place] + damaged[place + 1 :], damaged[:place]):
            wire = Wire()
            wire.send(left)
            assert wire.send(asked)[-1:] == [answer], left.hex()


def test_a_checksum_of_ff_counts_as_the_first_byte_of_a_header() -> None:
    wire = Wire()
    whole = next(sent for sent in (packet(1, 3, 50, value) for value in range(256)) if sent[-1] == 0xFF)
    assert wire.send(whole) == [packet(1, 0)]
    assert wire.send(packet(1, 1)[1:]) == [packet(1, 0)]


def test_a_sync_read_slot_is_a_reply_plus_three_bytes() -> None:
    wire = Wire(1, 2, paced=True)
    asked = packet(0xFE, 0x82, 56, 8, 1, 9, 2)
    first, second = wire.bus.receive(asked, 5.0)
    end_s, answer = 5.0 + len(asked) * 1e-5, 14
    assert first.due_s == pytest.approx(end_s + (1 + answer) * 1e-5)
    assert second.due_s == pytest.approx(end_s + (2 * (answer + 3) + answer) * 1e-5)


def test_a_new_baud_rate_and_id_apply_from_the_next_packet() -> None:
    wire = Wire()
    assert wire.send(packet(1, 3, 5, 9)) == [packet(1, 0)]
    assert wire.send(packet(1, 1)) == []
    assert wire.send(packet(9, 3, 6, 1)) == [packet(9, 0)]
    assert wire.send(packet(9, 1)) == []
    assert [reply.data for reply in wire.bus.receive(packet(9, 1), wire.now_s, 500_000)] == [packet(9, 0)]


# Packets without a gap.


def test_packets_without_gaps_are_answered_together_after_the_last() -> None:
    wire = Wire(paced=True)
    sent = packet(1, 3, 21, 40) + packet(1, 3, 22, 41) + packet(1, 1)
    (reply,) = wire.bus.receive(sent, 5.0)
    assert reply.data == packet(1, 0) * 3
    assert reply.due_s == pytest.approx(5.0 + (len(sent) + 1 + 18) * 1e-5)
    wire.now_s = 5.1
    assert wire.read(21, 2) == 40 + 256 * 41


def test_a_read_discards_the_replies_that_wait() -> None:
    wire = Wire()
    assert wire.send(packet(1, 3, 41, 9) + packet(1, 2, 41, 1)) == [packet(1, 0, 9)]
    assert wire.send(packet(1, 2, 41, 1) + packet(1, 3, 41, 8)) == [packet(1, 0, 9) + packet(1, 0)]
    assert wire.send(packet(1, 2, 41, 1) + packet(1, 2, 42, 1)) == [packet(1, 0, 0)]
    assert wire.send(packet(1, 3, 41, 7) + packet(0xFE, 0x82, 41, 1, 1)) == [packet(1, 0, 7)]


def test_replies_of_two_servos_to_packets_without_a_gap_collide() -> None:
    (answer,) = Wire(1, 2).send(packet(1, 1) + packet(2, 1))
    assert answer == bytes(a & b for a, b in zip(packet(1, 0), packet(2, 0), strict=True))


def test_packets_with_a_gap_are_answered_separately() -> None:
    wire = Wire()
    assert wire.send(packet(1, 3, 41, 9)) + wire.send(packet(1, 2, 41, 1)) == [packet(1, 0), packet(1, 0, 9)]
