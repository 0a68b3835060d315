"""The position that a virtual X servo reports after whole turns, as the e-manual describes it."""

import pytest

from drivers.servos import x
from sim_backend.servos.dynamixel.modes import CURRENT_POSITION, VELOCITY
from sim_backend.servos.dynamixel.protocol2_servo import REBOOT_S
from tests.sim_backend.dynamixel_bench import Bench, handler, sdk

LIMIT = 6
TURN = 4096
by_hand = pytest.mark.parametrize("turned", [2 * TURN + 300, -2 * TURN - 300, TURN // 2 + 300], ids=str)


@by_hand
def test_without_torque_the_position_counts_turns_in_position_mode(turned: int) -> None:
    bench = Bench()
    bench.turn_by_hand(turned)
    assert bench.read(x.present_position) == pytest.approx(2048 + turned, abs=1)
    assert bench.write(x.goal_position, 2048 + turned) == LIMIT


@by_hand
def test_torque_in_position_mode_brings_the_position_within_one_turn_and_nothing_moves(turned: int) -> None:
    bench = Bench()
    bench.turn_by_hand(turned)
    within = (2048 + turned) % TURN
    bench.write_all({x.goal_position: within, x.torque_enable: 1})
    angle_rad = bench.plant.angles()[0]
    assert bench.read(x.present_position) == pytest.approx(within, abs=1)
    bench.run(1.0)
    assert bench.read(x.present_position) == pytest.approx(within, abs=3)
    assert bench.plant.angles()[0] == pytest.approx(angle_rad, abs=0.01)


@pytest.mark.parametrize("mode", [x.EXTENDED_POSITION_MODE, CURRENT_POSITION, VELOCITY])
def test_a_change_to_position_mode_brings_the_position_within_one_turn(mode: int) -> None:
    bench = Bench(x.XL330_M288)
    bench.write_all({x.operating_mode: mode})
    bench.turn_by_hand(2 * TURN + 300)
    assert bench.read(x.present_position) == pytest.approx(2048 + 2 * TURN + 300, abs=1)
    bench.write_all({x.operating_mode: x.POSITION_MODE})
    assert bench.read(x.present_position) == bench.read(x.goal_position) == pytest.approx(2348, abs=1)


@pytest.mark.parametrize("mode", [x.EXTENDED_POSITION_MODE, CURRENT_POSITION])
@pytest.mark.parametrize("offset", [0, 1500, -1500])
def test_turns_are_lost_at_a_reboot_and_the_homing_offset_is_kept(offset: int, mode: int) -> None:
    bench = Bench(x.XL330_M288)
    bench.write_all({x.operating_mode: mode, x.homing_offset: offset})
    bench.turn_by_hand(-2 * TURN - 300)
    assert bench.read(x.present_position) == pytest.approx(2048 - 2 * TURN - 300 + offset, abs=1)
    assert handler.reboot(bench.port, 1) == (sdk.COMM_SUCCESS, 0)
    bench.run(REBOOT_S + 0.01)
    assert bench.read(x.present_position) == bench.read(x.goal_position) == pytest.approx(1748 + offset, abs=1)


@pytest.mark.parametrize(("offset", "added"), [(1024, 1024), (-1024, -1024), (1025, 0), (-1025, 0), (30_000, 0)])
def test_position_mode_ignores_a_homing_offset_beyond_1024_altogether(offset: int, added: int) -> None:
    bench = Bench()
    bench.write_all({x.homing_offset: offset})
    assert bench.read(x.present_position) == 2048 + added
    bench.write_all({x.torque_enable: 1})
    assert bench.read(x.present_position) == 2048 + added
