"""What a client sees of an STS3215, byte for byte on the virtual wire: bytes in, bytes out.

docs/simulation.md says which test holds which fact. Numbers are register addresses.
"""

from math import pi

import pytest

from drivers.servos import sts
from sim_backend.bus import VirtualBus
from sim_backend.plant import BenchPlant
from sim_backend.power import feed
from sim_backend.rig import Supply
from sim_backend.servo import VirtualServo

COUNTS_PER_RAD = 4096 / (2 * pi)
OFF, ON, DAMPED, MIDDLE = b"\x00", b"\x01", b"\x02", b"\x80"
VOLTAGE, ENCODER, HEAT, CURRENT, OVERLOAD = 1, 2, 4, 8, 32


def packet(servo_id: int, code: int, *parameters: int) -> bytes:
    body = bytes((servo_id, len(parameters) + 2, code, *parameters))
    return b"\xff\xff" + body + bytes((~sum(body) & 0xFF,))


def word(value: int) -> bytes:
    return value.to_bytes(2, "little")


class Wire:
    """Servos on shafts of a bench, and nothing but bytes between them and the test."""

    def __init__(self, *servo_ids: int, load_nm: float = 0.0, paced: bool = False) -> None:
        self.ids = servo_ids or (1,)
        self.plant = BenchPlant(self.ids)
        self.plant.load_nm = [load_nm] * len(self.ids)
        self.bus = VirtualBus.of(self.plant, sts.STS3215, supply=Supply(12.0, 0.0), paced=paced)
        self.now_s = 0.0
        self.held: float | None = None
        self.bus.advance(0.0)

    def send(self, data: bytes) -> list[bytes]:
        """Each answer as it comes out of the wire; a millisecond passes."""
        answers = [reply.data for reply in self.bus.receive(data, self.now_s)]
        self.wait(0.001)
        return answers

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds * 1000)):
            if self.held is not None:
                self.turn_to(self.held)
            self.now_s += 0.001
            self.bus.advance(self.now_s)

    def turn_to(self, count: float) -> None:
        """By hand."""
        self.plant.place([(count + 0.5) / COUNTS_PER_RAD] * len(self.ids))

    def write(self, address: int, data: bytes, servo_id: int = 1) -> None:
        assert len(self.send(packet(servo_id, 3, address, *data))) == 1

    def read(self, address: int, size: int = 1) -> int:
        """A number, low byte first."""
        (answer,) = self.send(packet(1, 2, address, size))
        assert answer[:4] == bytes((0xFF, 0xFF, 1, size + 2))
        assert ~sum(answer[2:-1]) & 0xFF == answer[-1]
        return int.from_bytes(answer[5:-1], "little")

    def error_byte(self) -> int:
        return self.send(packet(1, 1))[0][4]

    def go(self, count: int, speed: int = 0) -> None:
        self.write(42, word(count) + word(0) + word(speed))

    @property
    def servo(self) -> VirtualServo:
        servo = self.bus.servo(1)
        assert isinstance(servo, VirtualServo)
        return servo


# The loop and its drive.


def test_stiffness_and_offset_in_the_load_register() -> None:
    wire = Wire()
    wire.held = 2048
    wire.go(2048 + 51)  # 50 counts behind the dead zone of 1: 50 * 32 / 4 u, and 16 more
    wire.wait(0.5)
    assert wire.read(60, 2) == 50 * 8 + 16 | 1 << 10
    wire.write(24, b"\x00")
    wire.write(26, b"\x0b\x0b")
    wire.wait(0.1)
    assert wire.read(60, 2) == 40 * 8 | 1 << 10


def test_damping_is_the_change_of_each_20_ms() -> None:
    wire = Wire()
    wire.write(21, bytes((0, 32)))  # no P: what is left is D, and the offset in its direction
    wire.write(40, ON)
    drives = []
    for count in range(2048, 2148):
        wire.turn_to(count)
        drives.append(wire.read(60, 2))  # a millisecond for the read, and one more: 500 counts/s, 10 in a sample
        wire.wait(0.001)
    assert set(drives[50:]) <= {9 * 4 + 16, 10 * 4 + 16, 11 * 4 + 16}


def test_the_integral_grows_only_at_rest() -> None:
    wire = Wire()
    wire.held = 2048
    wire.write(24, b"\x00")
    wire.write(23, b"\x01")
    wire.go(2048 + 21)
    wire.wait(0.4)
    early = wire.read(60, 2) & 0x3FF
    wire.wait(1.0)
    late = wire.read(60, 2) & 0x3FF
    assert late - early == pytest.approx(20 * 1000 / 500, abs=2)  # 0.002 of the drive's 1000 u a count and second


def test_full_drive_is_0_97() -> None:
    wire = Wire()
    wire.held = 2048
    wire.go(3500)
    wire.wait(1.0)
    assert wire.read(60, 2) & 0x3FF == 970


def test_load_has_a_sign_and_current_has_none() -> None:
    seen = []
    for goal in (2048 + 60, 2048 - 60):
        wire = Wire()
        wire.held = 2048
        wire.go(goal)
        wire.wait(0.5)
        seen.append((wire.read(60, 2), wire.read(69, 2)))
    (up, current_up), (down, current_down) = seen
    assert up == down | 1 << 10
    assert current_up == current_down > 100


@pytest.mark.parametrize("mode", [4, 5, 255])
def test_modes_that_are_unknown_or_left_out_drive_nothing(mode: int) -> None:
    wire = Wire()
    wire.write(33, bytes((mode,)))
    wire.write(40, ON)
    wire.go(3000)
    wire.wait(0.5)
    assert (wire.read(60, 2), wire.read(56, 2)) == (0, 2048)


# The profile.


@pytest.mark.parametrize(("written", "counts_s2"), [((0, 0, 100, 1), 10_000), ((0, 0, 50, 4), 20_000)])
def test_acceleration_0_is_85_times_86(written: tuple[int, ...], counts_s2: int) -> None:
    wire = Wire()
    wire.write(83, bytes((1, 150, *written[2:])))
    wire.go(4000)
    wire.wait(0.05)
    assert wire.read(71, 2) == pytest.approx(counts_s2 * 0.052, rel=0.1)


def test_an_acceleration_above_85_reads_back_cut() -> None:
    wire = Wire()
    wire.write(41, bytes((254,)))
    assert wire.read(41) == 100


def test_speed_0_runs_ahead_of_the_motor() -> None:
    wire = Wire()
    wire.write(11, word(0))
    wire.write(9, word(0))
    wire.write(86, b"\x00")
    wire.go(20_000)
    wire.wait(0.1)
    assert wire.read(71, 2) == 7500
    ahead = wire.read(67, 2) - wire.read(56, 2)
    assert ahead % 4096 > 300


# Goals and torque.


def test_a_goal_switches_a_limp_servo_on_and_moves_it() -> None:
    wire = Wire()
    wire.write(40, OFF)
    wire.go(2148)
    assert wire.read(40) == 1
    wire.wait(1.0)
    assert wire.read(56, 2) == pytest.approx(2148, abs=5)


def test_torque_on_holds_where_it_is_and_leaves_the_goal_alone() -> None:
    wire = Wire()
    wire.turn_to(3000)
    wire.wait(0.1)
    wire.write(40, ON)
    wire.wait(0.5)
    assert (wire.read(56, 2), wire.read(42, 2)) == (pytest.approx(3000, abs=2), 0)


def test_128_calls_this_the_middle_and_lets_go() -> None:
    wire = Wire(load_nm=-1.0)
    wire.write(40, ON)
    wire.wait(0.3)
    wire.write(40, MIDDLE)
    assert wire.read(40) == 0
    assert wire.read(56, 2) == pytest.approx(2048, abs=3)
    wire.wait(0.3)
    assert (wire.read(56, 2) - 2048) % 4096 > 2000  # it falls


def test_a_goal_and_another_write_within_a_millisecond() -> None:
    wire = Wire()
    wire.wait(0.1)
    wire.send(packet(1, 3, 42, *word(2500)) + packet(1, 3, 21, 32))
    wire.wait(0.5)
    assert (wire.read(42, 2), wire.read(56, 2)) == (2500, 2048)


# Protection.


def stalled(limit: int = 0, **written: int) -> Wire:
    """A servo that pushes against something hard with full drive, current unwatched unless said."""
    wire = Wire()
    wire.write(28, word(limit))
    wire.write(86, b"\x00")
    wire.held = 2048
    wire.go(2048 + 500)
    return wire


def test_a_stall_ends_in_the_protective_torque_and_a_near_goal_ends_that() -> None:
    wire = stalled()
    wire.wait(1.9)
    assert (wire.error_byte(), wire.read(60, 2) & 0x3FF) == (0, 970)
    wire.wait(0.2)
    assert (wire.error_byte(), wire.read(60, 2) & 0x3FF) == (OVERLOAD, 200)
    wire.go(2048 + 500)
    wire.write(40, ON)
    wire.wait(0.1)
    assert wire.error_byte() == OVERLOAD
    wire.go(2048 + 10)
    wire.wait(0.1)
    assert wire.error_byte() == 0


def test_what_moves_never_overloads() -> None:
    wire = Wire(load_nm=-2.4)
    wire.write(28, word(0))
    wire.write(11, word(0))
    wire.write(40, ON)
    wire.write(86, b"\x00")
    wire.go(30_000)
    errors, loads = set(), []
    for _ in range(30):
        wire.wait(0.1)
        errors.add(wire.error_byte())
        loads.append(wire.read(60, 2) & 0x3FF)
    assert errors == {0}
    assert loads[-1] == 970


def test_too_much_current_takes_the_torque_and_the_next_goal_gives_it_back() -> None:
    wire = stalled(310)
    wire.wait(1.9)
    assert wire.read(40) == 1
    wire.wait(0.2)
    assert (wire.read(40), wire.error_byte()) == (0, CURRENT)
    wire.held = None
    wire.go(2100)
    wire.wait(0.5)
    assert (wire.read(40), wire.error_byte()) == (1, 0)
    assert wire.read(56, 2) == pytest.approx(2100, abs=5)


def test_heat_shorts_the_motor_and_the_goal_is_lost() -> None:
    wire = Wire(load_nm=-1.0)
    wire.go(2048)
    wire.wait(1.0)
    begin = wire.read(56, 2)
    wire.write(13, bytes((20,)))
    wire.wait(0.2)
    fallen = wire.read(56, 2)
    assert wire.error_byte() == HEAT
    assert (wire.read(40), wire.read(60, 2)) == (1, 0)
    assert 10 < begin - fallen < 600  # 1 N m against the short's 0.6 N m s: slowly
    wire.write(13, bytes((70,)))
    wire.wait(1.0)
    assert wire.error_byte() == 0
    assert wire.read(56, 2) < fallen  # it holds where it ended, and does not return


def test_voltage_is_told_and_acts_only_where_the_mask_says_so() -> None:
    wire = Wire()
    wire.go(2100)
    wire.write(15, bytes((125,)))
    wire.wait(0.1)
    assert wire.error_byte() == VOLTAGE
    assert wire.read(56, 2) > 2060
    wire.write(19, bytes((45,)))
    wire.held = 2090.0
    wire.go(2200)
    wire.wait(0.1)
    assert (wire.read(60, 2), wire.read(40)) == (0, 1)


@pytest.mark.parametrize(("mask", "drives"), [(44, True), (44 | ENCODER, False)])
def test_an_encoder_that_fails(mask: int, drives: bool) -> None:
    wire = Wire()
    wire.write(19, bytes((mask,)))
    wire.go(2200)
    wire.servo.firmware.encoder_fails = True
    wire.wait(0.2)
    assert wire.error_byte() == ENCODER
    assert (wire.read(60, 2) != 0) == drives
    assert wire.read(40) == 1
    stale = wire.read(56, 2)
    wire.turn_to(1000)
    wire.wait(0.05)
    assert wire.read(56, 2) == stale
    wire.servo.firmware.encoder_fails = False
    wire.turn_to(2190)
    wire.wait(0.8)
    assert wire.error_byte() == 0
    assert wire.read(56, 2) == pytest.approx(2200, abs=5)


# What it sees.


def test_a_shaft_pushed_over_the_seam_comes_back_the_way_it_went() -> None:
    wire = Wire()
    wire.turn_to(4000)
    wire.wait(0.1)
    wire.write(40, ON)
    for count in range(4000, 4200, 4):
        wire.held = count
        wire.wait(0.005)
    assert wire.read(56, 2) < 200
    wire.held = None
    wire.wait(1.0)
    assert wire.read(56, 2) == pytest.approx(4000, abs=5)


def test_speed_comes_in_fifties_and_nothing_below_a_hundred() -> None:
    wire = Wire()
    seen = {}
    for counts_s in (40, 90, 130, -300):
        start, speeds = 2048, set()
        for ms in range(300):
            wire.turn_to(start + counts_s * ms / 1000)
            wire.now_s += 0.001
            wire.bus.advance(wire.now_s)
            if ms > 100 and ms % 10 == 0:
                speeds.add(wire.read(58, 2))
        seen[counts_s] = speeds
        wire.turn_to(2048)
        wire.wait(0.1)
    assert seen[40] == {0}
    assert seen[90] <= {0, 100} and seen[130] <= {100, 150}
    assert all(speed >> 15 == 1 and (speed & 0x7FFF) % 50 == 0 for speed in seen[-300])


def test_67_and_71_are_the_profiles_own() -> None:
    wire = Wire()
    wire.write(41, bytes((10,)))
    wire.go(2548, 300)
    wire.wait(1.0)
    assert wire.read(71, 2) == 300
    assert wire.read(67, 2) == pytest.approx(2048 + 300 - 45, abs=20)
    wire.wait(2.0)
    assert (wire.read(67, 2), wire.read(71, 2)) == (2548, 0)


def test_a_shaft_turned_by_hand_is_not_moving() -> None:
    wire = Wire()
    for ms in range(100):
        wire.turn_to(2048 + ms)
        wire.now_s += 0.001
        wire.bus.advance(wire.now_s)
    assert wire.read(58, 2) > 500
    assert wire.read(66) == 0


# The table.


def test_80_to_86_are_kept_only_with_the_lock_open() -> None:
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


def test_16_acts_by_way_of_48_and_only_after_power_on() -> None:
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


def test_after_power_on() -> None:
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


# The instructions.


@pytest.mark.parametrize("instruction", [(0x55,), (7, 1, 2), (5,), (3,)])
def test_what_it_does_not_know_is_answered_by_an_empty_status(instruction: tuple[int, ...]) -> None:
    assert Wire().send(packet(1, *instruction)) == [packet(1, 0)]


def test_register_8_at_0_leaves_pings_and_reads() -> None:
    wire = Wire()
    wire.write(8, b"\x00")
    assert wire.send(packet(1, 3, 41, 5)) == wire.send(packet(1, 0x55)) == []
    assert len(wire.send(packet(1, 1))) == 1
    assert wire.read(41) == 5
    assert len(wire.send(packet(0xFE, 0x82, 56, 2, 1))) == 1


def test_a_read_to_all_is_answered_and_a_write_to_all_is_not() -> None:
    wire = Wire()
    assert wire.send(packet(0xFE, 3, 41, 7)) == []
    assert wire.send(packet(0xFE, 2, 41, 1)) == [packet(0xFE, 0, 7)]


def test_ff_ff_within_a_packet_begins_another() -> None:
    wire = Wire()
    assert wire.send(packet(1, 3, 42, 0xFF, 0xFF)) == []  # goal -32767 does not arrive
    assert wire.read(42, 2) == 0
    assert wire.send(packet(1, 3, 42, 1, 1)[:5] + packet(1, 1)) == [packet(1, 0)]


def test_sync_read_slots_are_an_answer_and_three_bytes_and_an_absent_servo_leaves_its_empty() -> None:
    wire = Wire(1, 2, paced=True)
    asked = packet(0xFE, 0x82, 56, 8, 1, 9, 2)
    first, second = wire.bus.receive(asked, 5.0)
    end_s, answer = 5.0 + len(asked) * 1e-5, 14
    assert first.due_s == pytest.approx(end_s + (1 + answer) * 1e-5)
    assert second.due_s == pytest.approx(end_s + (2 * (answer + 3) + answer) * 1e-5)


def test_a_new_baud_rate_and_a_new_id_act_from_the_next_packet() -> None:
    wire = Wire()
    assert wire.send(packet(1, 3, 5, 9)) == [packet(1, 0)]
    assert wire.send(packet(1, 1)) == []
    assert wire.send(packet(9, 3, 6, 1)) == [packet(9, 0)]
    assert wire.send(packet(9, 1)) == []
    assert [reply.data for reply in wire.bus.receive(packet(9, 1), wire.now_s, 500_000)] == [packet(9, 0)]


# Packets without a gap.


def test_packets_in_one_piece_are_all_obeyed_and_answered_in_one_piece_behind_the_last() -> None:
    wire = Wire(paced=True)
    sent = packet(1, 3, 21, 40) + packet(1, 3, 22, 41) + packet(1, 1)
    (reply,) = wire.bus.receive(sent, 5.0)
    assert reply.data == packet(1, 0) * 3
    assert reply.due_s == pytest.approx(5.0 + (len(sent) + 1 + 18) * 1e-5)
    wire.now_s = 5.1
    assert wire.read(21, 2) == 40 + 256 * 41


def test_what_is_read_overwrites_the_answers_that_wait() -> None:
    wire = Wire()
    assert wire.send(packet(1, 3, 41, 9) + packet(1, 2, 41, 1)) == [packet(1, 0, 9)]
    assert wire.send(packet(1, 2, 41, 1) + packet(1, 3, 41, 8)) == [packet(1, 0, 9) + packet(1, 0)]
    assert wire.send(packet(1, 2, 41, 1) + packet(1, 2, 42, 1)) == [packet(1, 0, 0)]
    assert wire.send(packet(1, 3, 41, 7) + packet(0xFE, 0x82, 41, 1, 1)) == [packet(1, 0, 7)]


def test_two_servos_asked_in_one_piece_answer_at_once_and_spoil_each_other() -> None:
    (answer,) = Wire(1, 2).send(packet(1, 1) + packet(2, 1))
    assert answer == bytes(a & b for a, b in zip(packet(1, 0), packet(2, 0), strict=True))


def test_a_gap_between_two_packets_gives_each_its_answer() -> None:
    wire = Wire()
    assert wire.send(packet(1, 3, 41, 9)) + wire.send(packet(1, 2, 41, 1)) == [packet(1, 0), packet(1, 0, 9)]
