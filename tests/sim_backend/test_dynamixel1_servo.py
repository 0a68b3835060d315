"""Virtual AX-12A and MX-28 of protocol 1.0: tables, replies and units, with the common physics."""

import pytest

from drivers.driver_errors import ServoRefused
from drivers.protocol import v1 as wire
from drivers.servos import ax_mx as dxl
from drivers.servos.register import Register
from drivers.types import ServoGoal
from sim_backend.mechanics.plant import BenchPlant
from tests.sim_backend.read_each_bench import ReadEachBench

IDS = (1, 2, 3)
every_model = pytest.mark.parametrize("model", dxl.MODELS)
both_kinds = pytest.mark.parametrize("model", [dxl.AX_12A.name, dxl.MX_28.name])
"""One model with compliance and one with gains. ``test_every_model.py`` moves all models."""


class Bench(ReadEachBench):
    """Three servos, each with the inertia and the friction of a joint in an arm."""

    def __init__(self, model: str) -> None:
        plant = BenchPlant(IDS, inertia_kg_m2=0.024, friction_nm=0.06, damping_nm_s=0.0)
        super().__init__(dxl.MODELS[model], IDS, plant)
        self.servo = self.servos.servo(1)


def ids_in(replies: bytes, size: int) -> list[int]:
    return [reply.servo_id for reply in wire.ReplyDecoder(size).feed(replies)]


def test_an_mx_answers_a_bulk_read_and_an_ax_does_not() -> None:
    assert ids_in(Bench("mx-28").ask(wire.bulk_read(dict.fromkeys((3, 1, 2), (36, 8)))), 8) == [3, 1, 2]
    assert Bench("ax-12a").ask(wire.bulk_read(dict.fromkeys(IDS, (36, 8)))) == b""
    for model in dxl.MODELS:
        assert Bench(model).ask(wire.sync_read(IDS, 36, 8)) == b""


def test_a_silent_mx_hides_those_after_it_in_a_bulk_read() -> None:
    bench = Bench("mx-28")
    bench.servos.faults.silence(2)
    assert ids_in(bench.ask(wire.bulk_read(dict.fromkeys(IDS, (36, 8)))), 8) == [1]


@every_model
def test_factory_values_match_the_e_manual(model: str) -> None:
    bench = Bench(model)
    read = bench.bus.read
    assert read(1, dxl.model_number) == dxl.MODELS[model].number
    assert (read(1, dxl.cw_angle_limit), read(1, dxl.ccw_angle_limit)) == (0, dxl.MODELS[model].last_count)
    torque = 983 if model == dxl.AX_18A.name else 1023
    assert (read(1, dxl.max_torque), read(1, dxl.torque_limit), read(1, dxl.shutdown)) == (torque, torque, 36)
    assert bench.servo.baud == 1_000_000


@both_kinds
def test_a_goal_is_reached_at_the_requested_speed(model: str) -> None:
    bench = Bench(model)
    turn = dxl.MODELS[model].counts_per_turn
    start = bench.run(0.05).position_counts
    bench.bus.write_goals({1: ServoGoal(start)})
    bench.bus.torque_on(1)
    speed = turn // 6
    bench.bus.write_goals({1: ServoGoal(start - speed, speed)})
    halfway = bench.run(0.5)
    assert halfway.position_counts == pytest.approx(start - speed / 2, abs=turn / 100)
    assert halfway.velocity_counts_s == pytest.approx(-speed, rel=0.15)
    assert bench.run(1.0).position_counts == pytest.approx(start - speed, abs=max(2, turn // 400))


@pytest.mark.parametrize(("angle_rad", "reading"), [(-0.3, 0), (6.0, 1023)])
def test_readings_of_an_ax_end_where_the_potentiometer_ends(angle_rad: float, reading: int) -> None:
    bench = Bench("ax-12a")
    bench.plant.place([angle_rad, 1.0, 1.0])
    assert bench.run(0.1).position_counts == reading


def test_an_mx_reads_within_the_turn() -> None:
    bench = Bench("mx-28")
    bench.plant.place([-0.3, 1.0, 1.0])
    assert bench.run(0.1).position_counts == pytest.approx(4096 * (1 - 0.3 / 6.2832), abs=2)


@both_kinds
@pytest.mark.parametrize("level", [0, 1, 2])
def test_the_status_return_level_selects_the_replies(model: str, level: int) -> None:
    bench = Bench(model)
    bench.servo.memory.put(dxl.status_return_level, level)
    ping, read = wire.packet(1, 1, b""), wire.packet(1, 2, bytes((36, 8)))
    write = wire.packet(1, 3, bytes((dxl.led.address, 1)))
    assert [bool(bench.ask(packet)) for packet in (ping, read, write)] == [True, level >= 1, level == 2]
    assert bench.servo.memory.get(dxl.led) == 1


@both_kinds
def test_eeprom_can_be_written_until_locked_and_the_lock_ends_at_power_off(model: str) -> None:
    bench = Bench(model)
    bench.bus.write(1, dxl.max_torque, 500)
    bench.bus.write(1, dxl.lock, 1)
    bench.bus.write(1, dxl.max_torque, 900)
    bench.bus.write(1, dxl.lock, 0)
    assert (bench.bus.read(1, dxl.max_torque), bench.bus.read(1, dxl.lock)) == (500, 1)
    bench.servo.power_cycle()
    held = bench.servo.memory.get
    assert (held(dxl.max_torque), held(dxl.torque_limit), held(dxl.lock)) == (500, 500, 0)


@both_kinds
def test_a_factory_reset_sets_the_id_to_1_permanently(model: str) -> None:
    bench = Bench(model)
    bench.bus.factory_reset(3)
    servo = bench.servos.servos[2]
    servo.power_cycle()  # type: ignore[attr-defined]
    assert servo.servo_id == 1
    assert [one.servo_id for one in bench.servos.servos] == [1, 2, 1]


@both_kinds
def test_unknown_instructions_are_answered_with_an_error(model: str) -> None:
    reply = Bench(model).ask(wire.packet(1, 0x08, b""))
    assert (reply[2], reply[4]) == (1, 1 << 6)


@both_kinds
def test_wheel_mode_does_not_drive_to_positions(model: str) -> None:
    bench = Bench(model)
    bench.bus.write(1, dxl.ccw_angle_limit, 0)
    bench.bus.write_goals({1: ServoGoal(900)})
    bench.bus.torque_on(1)
    assert bench.run(0.5).velocity_counts_s == 0


@both_kinds
def test_an_overload_removes_the_drive_until_the_torque_switch_is_written(model: str) -> None:
    bench = Bench(model)
    start = bench.run(0.05).position_counts
    place = bench.plant.angles()
    bench.bus.write_goals({1: ServoGoal(start + dxl.MODELS[model].counts_per_turn // 4)})
    bench.bus.torque_on(1)
    for _ in range(25):  # the shaft is turned back by hand before it can arrive
        bench.plant.place(place)
        reading = bench.run(0.1)
    assert reading.alarms == ("overload",)
    assert reading.load == 0.0


@pytest.mark.parametrize(
    ("model", "register", "value"),
    [
        ("ax-12a", dxl.return_delay, 255),
        ("ax-12a", dxl.led, 2),
        ("ax-12a", dxl.max_torque, 1024),
        ("mx-28", dxl.resolution_divider, 5),
        ("mx-28", dxl.p_gain, 255),
    ],
    ids=lambda v: getattr(v, "name", None),
)
def test_a_value_outside_its_range_is_a_range_error(model: str, register: Register, value: int) -> None:
    bench = Bench(model)
    before = bench.bus.read(1, register)
    with pytest.raises(ServoRefused, match=r"rejected the instruction \(range error\)"):
        bench.bus.write(1, register, value)
    assert bench.bus.read(1, register) == before
    bench.bus.write(1, register, register.largest)
    assert bench.bus.read(1, register) == register.largest
