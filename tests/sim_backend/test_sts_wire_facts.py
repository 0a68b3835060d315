"""Behavior of an STS3215 as seen over the virtual wire, byte for byte: motion, protection and reports.

docs/simulation.md lists the behavior that each test checks. Numbers in these tests are register addresses.
"""

import pytest

from sim_backend.line.power import feed
from tests.sim_backend.sts_wire import Wire, packet, word

OFF, ON, MIDDLE = b"\x00", b"\x01", b"\x80"
VOLTAGE, ENCODER, HEAT, CURRENT, OVERLOAD = 1, 2, 4, 8, 32


# Control loop and drive.


def test_stiffness_and_offset_in_the_load_register() -> None:
    wire = Wire()
    wire.held = 2048
    wire.go(2048 + 51)  # 50 counts beyond the dead zone of 1 give 50 * 32 / 4 u, plus 16
    wire.wait(0.5)
    assert wire.read(60, 2) == 50 * 8 + 16 | 1 << 10
    wire.write(24, b"\x00")
    wire.write(26, b"\x0b\x0b")
    wire.wait(0.1)
    assert wire.read(60, 2) == 40 * 8 | 1 << 10


def test_damping_uses_the_change_within_20_ms() -> None:
    wire = Wire()
    wire.write(21, bytes((0, 32)))  # P is 0, so only D and the startup force in its direction remain
    wire.write(40, ON)
    drives = []
    for count in range(2048, 2148):
        wire.turn_to(count)
        drives.append(
            wire.read(60, 2)
        )  # the read and the wait take one millisecond each: 500 counts/s, or 10 counts in 20 ms
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
    assert late - early == pytest.approx(20 * 1000 / 500, abs=2)  # 0.002 of the drive's 1000 u per count and second


def test_full_drive_is_0_97() -> None:
    wire = Wire()
    wire.held = 2048
    wire.go(3500)
    wire.wait(1.0)
    assert wire.read(60, 2) & 0x3FF == 970


def test_without_a_current_limit_register_60_shows_the_requested_drive() -> None:
    wire = stalled()
    wire.wait(1.0)
    assert wire.read(60, 2) == 1000 | 1 << 10
    wire.write(48, word(980))
    wire.wait(0.1)
    assert wire.read(60, 2) == 980 | 1 << 10


@pytest.mark.parametrize(("goal", "expected"), [(500, 3000), (2000, 3000), (3500, 1000)])
def test_reversed_limits_clip_a_goal_to_the_limit_that_it_exceeds(goal: int, expected: int) -> None:
    wire = Wire()
    wire.write(9, word(3000))
    wire.write(11, word(1000))
    wire.go(goal)
    wire.wait(1.5)
    assert wire.read(56, 2) == pytest.approx(expected, abs=5)


def test_the_load_has_a_sign_and_the_current_has_none() -> None:
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
def test_unknown_or_unsupported_modes_do_not_drive_the_motor(mode: int) -> None:
    wire = Wire()
    wire.write(33, bytes((mode,)))
    wire.write(40, ON)
    wire.go(3000)
    wire.wait(0.5)
    assert (wire.read(60, 2), wire.read(56, 2)) == (0, 2048)


@pytest.mark.parametrize(("goal", "drive"), [(2048 + 31, 20 * 8 | 1 << 10), (2048 - 31, 27 * 8)])
def test_the_dead_zone_has_two_sides(goal: int, drive: int) -> None:
    wire = Wire()
    wire.held = 2048
    wire.write(22, b"\x00")
    wire.write(24, b"\x00")
    wire.write(26, b"\x03\x0b")  # register 26 applies above the goal, 27 below it
    wire.go(goal)
    wire.wait(0.5)
    assert abs(wire.read(60, 2) - drive) <= 8  # a rising count is one short


@pytest.mark.parametrize(("period_ms", "smallest", "change"), [(20, 2, 10), (40, 2, 20), (20, 11, 0), (10, 2, 5)])
def test_registers_80_and_81_change_the_damping_at_once(period_ms: int, smallest: int, change: int) -> None:
    wire = Wire()
    wire.write(21, bytes((0, 32)))
    wire.write(24, b"\x00")
    wire.write(80, bytes((smallest, period_ms)))
    wire.write(40, ON)
    drives = []
    for count in range(2048, 2148):
        wire.turn_to(count)
        drives.append(wire.read(60, 2))
        wire.wait(0.001)
    assert set(drives[50:]) <= {max(0, change + more) * 4 for more in ((-1, 0, 1) if change else (0,))}


def test_an_integral_gain_of_0_clears_the_sum_of_the_speed_loop() -> None:
    wire = Wire()
    wire.write(33, b"\x01")
    wire.write(37, b"\x00")
    wire.write(24, b"\x00")
    wire.held = 2048
    wire.write(46, word(1000))
    wire.wait(0.15)
    assert wire.read(60, 2) & 0x3FF > 200
    wire.write(39, b"\x00")
    wire.wait(0.005)
    assert wire.read(60, 2) == 0
    wire.write(39, b"\xc8")
    assert wire.read(60, 2) & 0x3FF < 30


# Motion profile.


@pytest.mark.parametrize(("written", "counts_s2"), [((0, 0, 100, 1), 10_000), ((0, 0, 50, 4), 20_000)])
def test_acceleration_0_is_the_product_of_85_and_86(written: tuple[int, ...], counts_s2: int) -> None:
    wire = Wire()
    wire.write(83, bytes((1, 150, *written[2:])))
    wire.write(41, b"\x00")
    wire.go(4000)
    wire.wait(0.05)
    assert wire.read(71, 2) == pytest.approx(counts_s2 * 0.052, rel=0.1)


def test_an_acceleration_above_85_reads_back_clipped() -> None:
    wire = Wire()
    wire.write(41, bytes((254,)))
    assert wire.read(41) == 100


def test_at_speed_0_the_set_point_outruns_the_motor() -> None:
    wire = Wire()
    wire.write(11, word(0))
    wire.write(9, word(0))
    wire.write(86, b"\x00")
    wire.write(41, b"\x00")
    wire.go(20_000)
    wire.wait(0.1)
    assert wire.read(71, 2) == 7500
    ahead = wire.read(67, 2) - wire.read(56, 2)
    assert ahead % 4096 > 300


@pytest.mark.parametrize("units", [1, 5, 100])
def test_a_lower_speed_applies_at_once(units: int) -> None:
    wire = Wire()
    wire.write(41, bytes((units,)))
    wire.go(4000, 800)
    wire.wait(0.8 if units > 1 else 1.5)
    before = wire.read(71, 2)
    assert before > 130
    wire.write(46, word(100))
    wire.wait(0.01)
    assert wire.read(71, 2) == 100
    wire.wait(0.09)
    assert wire.read(58, 2) <= 150


@pytest.mark.parametrize(("speed", "units"), [(1000, 10), (2000, 50), (500, 3), (3000, 100)])
@pytest.mark.parametrize("goal", [2148, 2500, 3300, 1700])
def test_the_set_point_of_an_accelerated_goal_never_passes_it(speed: int, units: int, goal: int) -> None:
    wire = Wire()
    wire.write(41, bytes((units,)))
    wire.go(goal, speed)
    seen = []
    for _ in range(4500):
        wire.wait(0.001)
        seen.append(wire.servo.firmware.setpoint)
    assert min(seen) >= min(goal, 2047) and max(seen) <= max(goal, 2048)
    assert seen[-1] == goal


def test_registers_85_and_86_apply_at_the_next_write_of_41() -> None:
    wire = Wire()
    wire.write(85, bytes((20, 1)))
    wire.go(4000)
    wire.wait(0.05)
    assert wire.read(71, 2) == pytest.approx(100 * 100 * 0.052, rel=0.1)
    wire.go(2048)
    wire.wait(1.0)
    wire.write(41, b"\x00")
    wire.go(4000)
    wire.wait(0.05)
    assert wire.read(71, 2) == pytest.approx(20 * 100 * 0.052, abs=60)


def test_phase_bit_3_applies_at_the_next_write_of_46() -> None:
    wire = Wire()
    wire.write(18, bytes((4,)))
    wire.write(42, word(2300))
    wire.wait(1.0)
    assert wire.read(56, 2) == pytest.approx(2300, abs=5)
    wire.write(46, word(0))
    wire.write(42, word(2600))
    wire.wait(0.5)
    assert (wire.read(56, 2), wire.read(66)) == (pytest.approx(2300, abs=5), 0)
    wire.write(46, word(200))
    wire.wait(0.1)
    assert wire.read(66) == 1


@pytest.mark.parametrize(("address", "value"), [(41, bytes((5,))), (46, word(100))])
def test_a_second_write_within_a_millisecond_cancels_41_or_46(address: int, value: bytes) -> None:
    wire = Wire()
    wire.wait(0.1)
    wire.send(packet(1, 3, address, *value) + packet(1, 3, 21, 32))
    wire.write(42, word(3500))
    wire.wait(0.1)
    assert wire.read(71, 2) == pytest.approx(1000, abs=80)
    wire.write(address, value)
    wire.wait(0.01)
    assert wire.read(71, 2) == (100 if address == 46 else pytest.approx(1000, abs=80))


def test_register_30_divides_unfolded_positions_in_56_and_67() -> None:
    wire = Wire()
    wire.write(30, b"\x04")
    wire.write(42, word(600))
    wire.wait(0.5)
    assert (wire.read(56, 2), wire.read(67, 2)) == (pytest.approx(2400, abs=3), 2400)
    wire.write(18, bytes((12 | 16,)))
    assert (wire.read(56, 2), wire.read(67, 2)) == (pytest.approx(600, abs=1), 600)
    wire.write(18, bytes((12,)))
    wire.write(33, b"\x03")
    wire.write(42, word(100))
    wire.wait(1.0)
    assert (wire.read(56, 2) & 0x7FFF, wire.read(67, 2)) == (pytest.approx(0, abs=1), pytest.approx(700, abs=1))


# Goals and torque.


def test_a_goal_enables_the_torque_and_moves_the_servo() -> None:
    wire = Wire()
    wire.write(40, OFF)
    wire.go(2148)
    assert wire.read(40) == 1
    wire.wait(1.0)
    assert wire.read(56, 2) == pytest.approx(2148, abs=5)


def test_enabling_the_torque_holds_the_position_and_keeps_the_goal_register() -> None:
    wire = Wire()
    wire.turn_to(3000)
    wire.wait(0.1)
    wire.write(40, ON)
    wire.wait(0.5)
    assert (wire.read(56, 2), wire.read(42, 2)) == (pytest.approx(3000, abs=2), 0)


def test_128_sets_the_middle_and_releases_the_torque() -> None:
    wire = Wire(load_nm=-1.0)
    wire.go(2050)
    wire.wait(0.3)
    wire.write(40, MIDDLE)
    assert (wire.read(40), wire.read(42, 2)) == (0, 2050)
    assert wire.read(56, 2) == pytest.approx(2048, abs=3)
    wire.wait(0.3)
    assert (wire.read(56, 2) - 2048) % 4096 > 2000  # the load falls


def test_a_second_write_within_a_millisecond_cancels_a_goal() -> None:
    wire = Wire()
    wire.wait(0.1)
    wire.send(packet(1, 3, 42, *word(2500)) + packet(1, 3, 21, 32))
    wire.wait(0.5)
    assert (wire.read(42, 2), wire.read(56, 2)) == (2500, 2048)


@pytest.mark.parametrize("written", [(42, 0xC4), (43, 9), (40, 0, 5, 0xC4, 9), (42, 0xC4, 9, 0, 0, 0, 0)])
def test_a_write_of_one_byte_of_the_goal_counts_as_a_goal(written: tuple[int, ...]) -> None:
    wire = Wire()
    for torque in (0, 2):
        wire.write(40, bytes((torque,)))
        wire.write(*written[:1], bytes(written[1:]))
        assert wire.read(40) == 1


@pytest.mark.parametrize(
    ("mode", "enabling"), [(0, {42, 43}), (3, {42, 43}), (1, {46, 47}), (2, {44, 45}), (4, set()), (9, set())]
)
def test_only_the_goal_of_the_mode_enables_the_torque(mode: int, enabling: set[int]) -> None:
    wire = Wire()
    wire.write(33, bytes((mode,)))
    switched_on = set()
    for address in range(41, 50):
        wire.write(40, OFF)
        wire.write(address, b"\x00")
        if wire.read(40):
            switched_on.add(address)
    assert switched_on == enabling


@pytest.mark.parametrize(("value", "falls"), [(0, True), (2, False), (3, True), (64, True), (255, True)])
def test_register_40_damps_at_2_and_releases_the_shaft_from_3_on(value: int, falls: bool) -> None:
    wire = Wire(load_nm=-0.3)
    wire.write(40, bytes((value,)))
    wire.wait(0.3)
    assert wire.read(60, 2) == 0
    assert (abs(wire.plant.velocities()[0]) > 2.0) == falls


def test_rewriting_the_homing_offset_moves_the_set_point_to_the_shaft() -> None:
    wire = Wire(load_nm=-1.0)
    wire.write(41, b"\x01")
    wire.go(2048)
    wire.wait(1.0)
    sag = 2048 - wire.read(56, 2)
    assert sag > 30 and wire.read(67, 2) == 2048
    wire.write(31, word(0))
    assert wire.read(67, 2) == pytest.approx(2048 - sag, abs=3)
    wire.wait(2.0)
    assert wire.read(67, 2) == 2048


# Protection.


def stalled(limit: int = 0) -> Wire:
    """Return a servo that pushes against a hard stop with full drive, by default without a current limit."""
    wire = Wire()
    wire.write(28, word(limit))
    wire.write(86, b"\x00")
    wire.write(41, b"\x00")
    wire.held = 2048
    wire.go(2048 + 500)
    return wire


def test_a_near_goal_ends_the_protective_torque_after_a_stall() -> None:
    wire = stalled()
    wire.wait(1.9)
    assert (wire.error_byte(), wire.read(60, 2) & 0x3FF) == (0, 1000)
    wire.wait(0.2)
    assert (wire.error_byte(), wire.read(60, 2) & 0x3FF) == (OVERLOAD, 200)
    wire.go(2048 + 500)
    wire.write(40, ON)
    wire.wait(0.1)
    assert wire.error_byte() == OVERLOAD
    wire.go(2048 + 10)
    wire.wait(0.1)
    assert wire.error_byte() == 0


def test_a_moving_shaft_never_overloads() -> None:
    wire = Wire(load_nm=-2.4)
    wire.write(28, word(0))
    wire.write(11, word(0))
    wire.write(40, ON)
    wire.write(86, b"\x00")
    wire.write(41, b"\x00")
    wire.go(30_000)
    errors, loads = set(), []
    for _ in range(30):
        wire.wait(0.1)
        errors.add(wire.error_byte())
        loads.append(wire.read(60, 2) & 0x3FF)
    assert errors == {0}
    assert loads[-1] == 1000


def test_overcurrent_switches_the_torque_off_until_the_next_goal() -> None:
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


@pytest.mark.parametrize("address", [28, 38])
def test_disabling_the_current_limit_clears_its_alarm(address: int) -> None:
    wire = stalled(310)
    wire.wait(2.2)
    assert (wire.read(40), wire.error_byte()) == (0, CURRENT)
    wire.write(address, word(0)[: 2 if address == 28 else 1])
    assert (wire.read(40), wire.error_byte()) == (0, 0)


def test_overheating_shorts_the_motor_and_discards_the_goal() -> None:
    wire = Wire(load_nm=-1.0)
    wire.go(2048)
    wire.wait(1.0)
    begin = wire.read(56, 2)
    wire.write(13, bytes((20,)))
    wire.wait(0.2)
    fallen = wire.read(56, 2)
    assert wire.error_byte() == HEAT
    assert (wire.read(40), wire.read(60, 2)) == (1, 0)
    assert 10 < begin - fallen < 600  # the shorted motor (0.6 N m s) lets a load of 1 N m fall only slowly
    wire.write(13, bytes((70,)))
    wire.wait(1.0)
    assert wire.error_byte() == 0
    assert wire.read(56, 2) < fallen  # the servo holds its last position and does not return


def test_a_voltage_error_acts_only_if_the_mask_selects_it() -> None:
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
def test_a_failing_encoder_stops_the_drive_if_the_mask_selects_it(mask: int, drives: bool) -> None:
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


# Sensing.


@pytest.mark.parametrize(("start", "shown"), [(1950, 2047), (2150, 2048)])
def test_a_rising_position_reads_one_count_short(start: int, shown: int) -> None:
    wire = Wire()
    wire.turn_to(start)
    wire.wait(0.1)
    wire.turn_to(2048)
    wire.wait(0.1)
    assert wire.read(56, 2) == shown


def test_a_shaft_pushed_across_the_seam_comes_back_the_same_way() -> None:
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


def test_speeds_are_multiples_of_50_and_0_below_100() -> None:
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


def test_registers_67_and_71_show_the_profile() -> None:
    wire = Wire()
    wire.write(41, bytes((10,)))
    wire.go(2548, 300)
    wire.wait(1.0)
    assert wire.read(71, 2) == 300
    assert wire.read(67, 2) == pytest.approx(2048 + 300 - 45, abs=20)
    wire.wait(2.0)
    assert (wire.read(67, 2), wire.read(71, 2)) == (2548, 0)


@pytest.mark.parametrize(("asked", "shown"), [(130, 100), (149, 100), (150, 150), (1, 50)])
def test_register_71_has_multiples_of_50_like_58(asked: int, shown: int) -> None:
    wire = Wire()
    wire.write(86, b"\x00")
    wire.write(41, b"\x00")
    wire.go(2548, asked)
    wire.wait(0.05)
    assert wire.read(71, 2) == shown
    wire.go(1548, asked)
    wire.wait(0.05)
    assert wire.read(71, 2) == shown | 1 << 15


@pytest.mark.parametrize(
    ("speed_settings", "asked", "counts_s", "shown"),
    [
        ((50, 1, 150), 10, 500, 10),
        ((100, 1, 150), 10, 1000, 10),  # register 82 is the unit of 46 and the number of windows per second
        ((100, 3, 150), 1, 300, 3),
        ((50, 1, 10), 100, 500, 10),
    ],
)
def test_registers_82_to_84_apply_after_power_on(
    speed_settings: tuple[int, ...], asked: int, counts_s: int, shown: int
) -> None:
    wire = Wire()
    wire.write(55, b"\x00")
    wire.write(18, b"\x08")
    wire.write(82, bytes((*speed_settings, 0, 0)))
    wire.write(41, b"\x00")
    wire.go(3048, 4)
    wire.wait(0.1)
    assert wire.read(71, 2) == 4  # the unit is still 50 counts/s
    feed(wire.bus, 0.0)
    feed(wire.bus, 12.0)
    wire.wait(1.0)
    start = wire.servo.firmware.setpoint
    wire.go(4000, asked)
    wire.wait(0.099)
    assert wire.servo.firmware.setpoint - start == pytest.approx(counts_s * 0.1, abs=1)
    assert wire.read(71, 2) == shown


@pytest.mark.parametrize("windows_s", [20, 50, 100])
def test_a_speed_is_the_counts_of_one_window(windows_s: int) -> None:
    wire = Wire()
    wire.write(55, b"\x00")
    wire.write(82, bytes((windows_s,)))
    feed(wire.bus, 0.0)
    feed(wire.bus, 12.0)
    wire.wait(1.0)
    for ms in range(300):
        wire.turn_to(2048 + ms)
        wire.now_s += 0.001
        wire.bus.advance(wire.now_s)
    assert wire.read(58, 2) == pytest.approx(50 * 1000 / windows_s, abs=50)


def test_a_shaft_turned_by_hand_does_not_report_moving() -> None:
    wire = Wire()
    for ms in range(100):
        wire.turn_to(2048 + ms)
        wire.now_s += 0.001
        wire.bus.advance(wire.now_s)
    assert wire.read(58, 2) > 500
    assert wire.read(66) == 0
