"""Virtual SCS servos: a different table, big endian, a potentiometer, no sync read, and the common physics."""

from math import pi

import pytest

from drivers.eeprom import eeprom
from drivers.protocol import v1 as wire
from drivers.servos import feetech as models
from drivers.servos import scs
from drivers.types import ServoGoal
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.servos.generic.scs_servo import VirtualScsServo
from tests.sim_backend.read_each_bench import ReadEachBench

IDS = (1, 2)


class Bench(ReadEachBench):
    """Two servos without load."""

    def __init__(self, model: str = "scs0009") -> None:
        super().__init__(scs.MODELS[model], IDS, BenchPlant(IDS))


def test_only_single_reads_are_answered() -> None:
    bench = Bench()
    assert bench.ask(wire.sync_read(IDS, 56, 8)) == b""
    assert len(bench.ask(wire.packet(1, 2, bytes((56, 8))))) == 14
    assert len(bench.ask(wire.packet(1, 2, bytes((56, 8))))) == 14


def test_words_have_their_high_byte_first() -> None:
    bench = Bench()
    assert bench.ask(wire.packet(1, 2, bytes((3, 2))))[5:7] == bytes((5, 4))
    bench.ask(wire.packet(1, 3, bytes((42, 2, 1))))
    assert bench.servos.servo(1).memory.get(scs.goal_position) == 0x0201


@pytest.mark.parametrize("model", scs.MODELS)
def test_a_goal_is_reached_at_the_requested_speed(model: str) -> None:
    bench = Bench(model)
    start = bench.run(0.05).position_counts
    bench.bus.write_goals({1: ServoGoal(start)})
    bench.bus.torque_on(1)
    bench.bus.write_goals({1: ServoGoal(start - 200, 200)})
    halfway = bench.run(0.5)
    assert halfway.position_counts == pytest.approx(start - 100, abs=12)
    assert halfway.velocity_counts_s == pytest.approx(-200, abs=120)  # one count is a third of a degree
    assert bench.run(1.0).position_counts == pytest.approx(start - 200, abs=2)
    assert bench.bus.read(1, scs.moving) == 0


@pytest.mark.parametrize(("angle_rad", "reading"), [(-0.5, 0), (0.001, 0), (1.9 * pi, 1023)])
def test_readings_end_where_the_potentiometer_ends(angle_rad: float, reading: int) -> None:
    bench = Bench()
    bench.plant.place([angle_rad, 1.0])
    assert bench.run(0.1).position_counts == reading


def test_scs_servos_have_no_middle_command_and_no_torque_limit_in_ram() -> None:
    bench = Bench()
    before = bench.run(0.05).position_counts
    bench.bus.write(1, scs.torque_enable, 128)
    assert bench.run(0.05).position_counts == before
    assert not bench.bus.torque_is_on(1)
    bench.bus.write(1, scs.lock, 0)  # register 48, which is the torque limit of an STS
    servo = bench.servos.servo(1)
    assert isinstance(servo, VirtualScsServo) and servo.firmware._limit == 1.0


def test_max_torque_limits_the_drive_and_survives_power_off_only_unlocked() -> None:
    bench = Bench()
    with eeprom(bench.bus, 1, models.SCS.lock) as memory:
        memory.write(scs.max_torque, 400)
    bench.bus.write(2, scs.max_torque, 400)
    for servo, lasting in zip(bench.servos.servos, (400, 1000), strict=True):
        assert servo.firmware._limit == pytest.approx(0.4)
        servo.power_cycle()
        assert servo.memory.get(scs.max_torque) == lasting


def test_motor_mode_does_not_drive_to_positions() -> None:
    bench = Bench()
    for register in (scs.min_position, scs.max_position):
        bench.bus.write(1, register, 0)
    bench.bus.write_goals({1: ServoGoal(900)})
    bench.bus.torque_on(1)
    assert bench.run(0.5).velocity_counts_s == 0
