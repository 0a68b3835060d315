"""Servo models from a file beside the robot file: where they are used, and mistakes in the file."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from drivers.bus.bus import Bus
from drivers.servos import ax_mx, sts, x
from drivers.servos.catalog import MODELS, registers_of, series_of
from drivers.servos.dynamixel import X
from drivers.servos.feetech import STS
from drivers.servos.register import ByteOrder
from drivers.servos.voltage import voltage_range
from drivers.types import ServoGoal, ServoState
from hal.hal_errors import RobotFileError
from hal.robot_file.robot_file import load_robot_file
from hal.robot_file.servo_models import RegisterFile, load_servo_models
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from tests.hal.user_models import GOOD, forgotten

CONFIG = Path(__file__).parents[2] / "config"


@pytest.fixture(autouse=True)
def _forget() -> Iterator[None]:
    with forgotten():
        yield


def loaded(folder: Path, text: str) -> None:
    (folder / "servo_models.yaml").write_text(text)
    load_servo_models(folder)


def mistake(folder: Path, text: str) -> str:
    with pytest.raises(RobotFileError) as caught:
        loaded(folder, text)
    return str(caught.value).replace(f"{folder}/", "")


def test_a_model_has_the_table_of_another_and_its_own_figures_and_registers(tmp_path: Path) -> None:
    loaded(tmp_path, GOOD)
    sts3046, xm540, scs20 = MODELS["sts3046"], MODELS["my-xm540"], MODELS["scs20"]
    assert (series_of(sts3046), sts3046.number, sts3046.stall_torque_nm) == (STS, 1545, 3.92)
    assert sts3046 in sts.MODELS.values()
    assert voltage_range(sts3046) == (4.4, 8.9)
    assert series_of(xm540) is X and isinstance(xm540, x.XModel)
    assert xm540.no_load_speed_rad_s == x.XM430_W350.no_load_speed_rad_s
    added = {register.name: register for register in registers_of(xm540)}
    assert (added["external_port_mode_1"].address, added["external_port_mode_1"].largest) == (56, 3)
    assert set(added) == {r.name for r in registers_of(x.XM430_W350)} | {"external_port_mode_1", "external_port_data_1"}
    assert (scs20.last_count, scs20.counts_per_turn) == (1023, 1843)


def test_the_file_may_be_read_again_and_corrected(tmp_path: Path) -> None:
    loaded(tmp_path, GOOD)
    loaded(tmp_path, GOOD)
    loaded(tmp_path, GOOD.replace("number: 1545", "number: 1546"))
    assert MODELS["sts3046"].number == 1546
    assert [model.name for model in STS.models].count("sts3046") == 1


def folders(folder: Path, *texts: str) -> list[Path]:
    """Create one folder for each file of servo models."""
    made = [folder / str(number) for number in range(len(texts))]
    for own, text in zip(made, texts, strict=True):
        own.mkdir()
        (own / "servo_models.yaml").write_text(text)
    return made


def test_two_files_must_not_define_one_model_differently(tmp_path: Path) -> None:
    leader, follower = folders(tmp_path, GOOD, GOOD.replace("sensor_deg: 200.0", "sensor_deg: 300.0"))
    load_servo_models(leader)
    with pytest.raises(RobotFileError) as caught:
        load_servo_models(follower)
    assert str(caught.value) == (
        f"{follower}/servo_models.yaml:17: {leader}/servo_models.yaml defines another model scs20: "
        "rename one of the two models"
    )
    assert series_of(MODELS["scs20"]) and MODELS["scs20"].counts_per_turn == 1843


def test_two_files_may_define_one_model_equally(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = folders(tmp_path, GOOD, GOOD)
    load_servo_models(first)
    load_servo_models(second)
    monkeypatch.chdir(first)
    loaded(Path(), GOOD.replace("sensor_deg: 200.0", "sensor_deg: 300.0"))  # the file was corrected
    assert MODELS["scs20"].counts_per_turn == 1229


@pytest.mark.parametrize("name", ["sts3046", "my-xm540"])
def test_a_servo_of_the_model_is_identified_and_moved(tmp_path: Path, name: str) -> None:
    loaded(tmp_path, GOOD)
    model, clock = MODELS[name], SimulatedClock(0.0)
    line = (
        VirtualDynamixelBus.of(BenchPlant((1,)), {1: model})
        if isinstance(model, x.XModel)
        else VirtualBus.of(BenchPlant((1,)), model)
    )
    bus = Bus(VirtualPort(line, clock), clock, {1: model})
    bus.identify(1, model)
    bus.torque_on(1)
    bus.write_goals({1: ServoGoal(1024)})
    clock.sleep_until(3.0)
    state = bus.read_states((1,))[1]
    assert isinstance(state, ServoState)
    assert state.position_counts == pytest.approx(1024, abs=12)


def test_a_robot_file_may_name_a_model_of_the_file_beside_it(tmp_path: Path) -> None:
    robot = tmp_path / "robot.yaml"
    robot.write_text((CONFIG / "robot_arm.yaml").read_text().replace("model: sts3215", "model: sts3046"))
    with pytest.raises(RobotFileError, match="unknown model sts3046"):
        load_robot_file(robot)
    (tmp_path / "servo_models.yaml").write_text(GOOD)
    assert {joint.model for joint in load_robot_file(robot).joints.values()} == {"sts3046"}


REGISTER = "a:\n  like: sts3215\n  number: 1545\n  registers:\n    {}\n"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a:\n  like: sts9999\n  number: 1\n", "servo_models.yaml:2: unknown model sts9999: use one of "),
        (
            "a:\n  like: sts3215\n  number: 2825\n",
            "servo_models.yaml:3: model number 2825 belongs to sts3250: write `like: sts3250` for a variant of this",
        ),
        ("sts3215:\n  like: sts3250\n  number: 1\n", "servo_models.yaml:3: servoloop already has a model sts3215"),
        ("a:\n  like: sts3215\n  number: -1\n", "servo_models.yaml:3: a.number: "),
        ("a:\n  number: 5\n", "a.like: is missing: add the key"),
        (
            "a:\n  like: sts3215\n  number: 1\n  stall_current_a: 2.0\n",
            "servo_models.yaml:4: sts3215 has no stall_current_a: remove it",
        ),
        (
            "a:\n  like: sts3215\n  number: 1\n  sensor_deg: 200\n",
            "servo_models.yaml:4: the sensor of sts3215 covers a whole turn",
        ),
        (
            "a:\n  like: scs15\n  number: 1\n  supply_v: [9, 5]\n",
            "servo_models.yaml:4: a.supply_v: the range [9, 5] is empty: write the lowest voltage first",
        ),
        (
            REGISTER.format("extra: {address: 57, size: 1}"),
            "servo_models.yaml:5: extra overlaps present_position: correct its address or size",
        ),
        (
            REGISTER.format("extra: {address: 90, size: 3}"),
            "servo_models.yaml:5: a.registers.extra.size: 3 is not a valid register size: write 1, 2 or 4 (bytes)",
        ),
        (
            REGISTER.format("extra: {address: 90, size: 1, values: [5, 3]}"),
            "servo_models.yaml:5: a.registers.extra: the range [5, 3] is empty: write the smallest value first",
        ),
        (
            REGISTER.format("extra: {address: 90, size: 1, values: [0, 256]}"),
            "the range [0, 256] does not fit into 1 bytes: write values from 0 to 255",
        ),
        (
            REGISTER.format("extra: {address: 90, size: 1, sign_bit: 15}"),
            "servo_models.yaml:5: a.registers.extra: a register of 8 bits has no sign_bit 15: write 1 to 7",
        ),
        (
            REGISTER.format("extra: {address: 90, size: 2, sign_bit: 15, signed: true}"),
            "servo_models.yaml:5: a.registers.extra: signed and sign_bit exclude each other: remove one of them",
        ),
        (
            "a:\n  like: scs15\n  number: 1\n  sensor_deg: 1e-310\n",
            "servo_models.yaml:4: a.sensor_deg: must be at least 1",
        ),
        (
            REGISTER.format("lock: {address: 91, size: 1}"),
            "servo_models.yaml:5: servoloop uses lock of sts3215 at address 55 with 1 bytes: remove it, or add",
        ),
        (
            "a:\n  like: xm430-w350\n  number: 9\n  registers:\n    far: {address: 200, size: 1}\n",
            "servo_models.yaml:5: far ends after address 167, the end of the table",
        ),
        ("- a\n", "servo_models.yaml:1: "),
    ],
)  # fmt: skip
def test_a_mistake_is_one_sentence_with_file_and_line(tmp_path: Path, text: str, says: str) -> None:
    found = mistake(tmp_path, text)
    assert says in found
    assert len(found.splitlines()) == 1


@given(
    size=st.sampled_from([1, 2, 4]),
    sign_bit=st.none() | st.integers(1, 31),
    signed=st.booleans(),
    order=st.sampled_from(["little", "big"]),
)
def test_every_value_of_an_accepted_register_can_be_written(
    size: int, sign_bit: int | None, signed: bool, order: ByteOrder
) -> None:
    try:
        described = RegisterFile(address=90, size=size, sign_bit=sign_bit, signed=signed)
    except ValidationError:
        assert sign_bit is not None and (signed or sign_bit >= 8 * size)
        return
    register = described.register("extra")
    for value in (register.smallest, -1, 0, 1, register.largest):
        if register.takes(value):
            assert register.decode(register.encode(value, order), order) == value


def test_a_variant_may_have_the_number_of_its_model(tmp_path: Path) -> None:
    loaded(tmp_path, "slow:\n  like: mx-28\n  number: 29\n  no_load_speed_rad_s: 3.0\n")
    assert ax_mx.speed_unit_counts_s(MODELS["slow"]) == ax_mx.MX_28.speed_unit_counts_s


def test_the_supply_is_that_of_the_similar_model_unless_its_voltage_differs(tmp_path: Path) -> None:
    loaded(
        tmp_path,
        "same:\n  like: sts3215_c001\n  number: 1545\n"
        "other:\n  like: sts3215_c001\n  number: 1546\n  rated_voltage_v: 12.0\n",
    )
    assert voltage_range(MODELS["same"]) == voltage_range(sts.STS3215_C001)
    assert voltage_range(MODELS["other"]) == (9.0, 15.0)
