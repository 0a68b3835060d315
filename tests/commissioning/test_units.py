"""Units match the comments in the control tables, and printed values can be parsed."""

import re
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from commissioning.commissioning_errors import CommissioningError
from commissioning.registers.tables import meaning, rates_of, register_named
from commissioning.registers.values import UNITS, Unit, parse, unit_of, value_of
from drivers.servos import ax_mx, scs, sts, x, xl320
from drivers.servos.catalog import MODELS, SERIES, registers_of, series_of
from drivers.servos.register import ServoModel

COMMENTS = {
    "counts": Unit("counts"),
    "counts/s": Unit("counts/s"),
    "50 counts/s": Unit("counts/s", 50),
    "100 counts/s^2": Unit("counts/s²", 100),
    "2 us": Unit("µs", 2),
    "deg C": Unit("°C"),
    "0.1 V": Unit("V", 0.1),
    "0.1 %": Unit("%", 0.1),
    "0.1 % of full drive": Unit("%", 0.1),
    "%": Unit("%"),
    "ms": Unit("ms"),
    "10 ms": Unit("ms", 10),
    "20 ms": Unit("ms", 20),
    "40 ms": Unit("ms", 40),
    "6.5 mA": Unit("A", 0.0065),
    "20.83 ns": Unit("ns", 20.83),
    "0.732 rpm": Unit("rpm", 0.732),
    "0.229 rpm": Unit("rpm", 0.229),
    "0.111 rpm": Unit("rpm", 0.111),
    "214.577 rev/min^2": Unit("rev/min²", 214.577),
    "1/885": Unit("%", 100 / 885),
    "1/885 of full drive": Unit("%", 100 / 885),
    "1/1023": Unit("%", 100 / 1023),
    "1/1023 of full drive": Unit("%", 100 / 1023),
    "8.583 deg/s^2": Unit("°/s²", 8.583),
    "the model's unit": Unit("A", 1.0),
    "the model's unit of speed": Unit("rpm"),
    "XL330, XC330": None,
    "MX-28": Unit("rev/min²", 214.577),
}
"""Units at the beginning of the comments."""
_LINE = re.compile(r'^\w+ = Register\("(\w+)".*\)(?:  # (.*))?$', re.MULTILINE)
TABLES = {sts: "sts", scs: "scs", x: "Dynamixel X", xl320: "Dynamixel XL-320", ax_mx: "Dynamixel protocol 1.0"}
every_model = pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)


def comments(table: ModuleType) -> dict[str, str]:
    text = Path(table.__file__ or "").read_text()
    return {name: re.split("[;,:(]", comment)[0].strip() for name, comment in _LINE.findall(text) if comment}


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.__name__.rpartition(".")[2])
def test_every_unit_matches_the_control_table(table: ModuleType) -> None:
    said = {name: COMMENTS.get(comment) for name, comment in comments(table).items()}
    ours = UNITS[TABLES[table]]
    known = {name: unit for name, unit in said.items() if unit and unit.symbol}
    by_model = {"present_current", "current_limit", "goal_current"} & set(said) if table is x else set()
    by_model |= {"moving_speed", "present_speed"} if table is ax_mx else set()
    if table is x:
        known["acceleration_limit"] = COMMENTS["MX-28"]  # type: ignore[assignment]
    assert {name: unit for name, unit in known.items() if name not in by_model} == ours


def test_units_exist_only_for_known_registers() -> None:
    for series in SERIES:
        names = {register.name for model in series.models for register in registers_of(model)}
        assert UNITS[series.name].keys() <= names


def test_units_that_depend_on_the_model() -> None:
    assert unit_of(x.XM430_W350, x.present_current) == Unit("A", 0.00269)
    assert unit_of(x.XL330_M288, x.goal_current) == Unit("A", 0.001)
    assert unit_of(ax_mx.AX_12A, ax_mx.moving_speed) == Unit("rpm", 0.111)
    assert unit_of(ax_mx.MX_28, ax_mx.present_speed) == Unit("rpm", 0.114)


@every_model
@given(data=st.data())
def test_printed_values_can_be_parsed(model: ServoModel, data: st.DataObject) -> None:
    register = data.draw(st.sampled_from(registers_of(model)))
    raw = data.draw(st.integers(max(register.smallest, -30_000), min(register.largest, 60_000)))
    assume(register.takes(raw))
    shown = value_of(model, register, raw)
    assert parse(model, register, str(raw)) == raw
    if shown.unit:
        quantity = f"{shown.value:.6f}{shown.unit}"
        assert parse(model, register, quantity) == raw
        assert parse(model, register, quantity.replace("°C", "C").replace("µs", "us")) == raw


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("65V", "max_temperature has the unit °C, not V"),
        ("65.5", "must be a whole number .the raw value. or a quantity with the unit °C"),
        ("warm", "must be a number"),
        ("", "must be a number"),
        ("0x41", "max_temperature must be a decimal number, not '0x41': write 65"),
        ("300", "max_temperature must be 0 to 100, not 300"),
        ("-1", "max_temperature must be 0 to 100, not -1"),
    ],
)
def test_an_invalid_value_is_reported(text: str, says: str) -> None:
    with pytest.raises(CommissioningError, match=says):
        parse(sts.STS3215, sts.max_temperature, text)


def test_a_register_without_a_unit_accepts_no_unit() -> None:
    with pytest.raises(CommissioningError, match="position_p has no unit, so it cannot be set in V"):
        parse(sts.STS3215, sts.position_p, "3V")


@pytest.mark.parametrize(
    ("text", "raw"), [("12V", 120), ("12.0 V", 120), ("12.04v", 120), ("120", 120), ("+7", 7), ("7.4V", 74)]
)
def test_usual_spellings_of_quantities_are_parsed(text: str, raw: int) -> None:
    assert parse(sts.STS3215, sts.max_voltage, text) == raw


def test_a_misspelled_register_gets_similar_names() -> None:
    with pytest.raises(CommissioningError, match="has no register presnt_voltage: did you mean present_voltage"):
        register_named(sts.STS3215, "presnt_voltage")


@every_model
def test_every_rate_of_a_model_has_its_own_value(model: ServoModel) -> None:
    rates = rates_of(model)
    assert len(set(rates.values())) == len(rates)
    register = register_named(model, "baud_rate")
    for value, rate in rates.items():
        register.check(value)
        assert meaning(model, register, value) == f"{rate} baud"
        if series_of(model).name == "Dynamixel protocol 1.0" and value < 250:
            assert rate == pytest.approx(2_000_000 / (value + 1), rel=0.025)


def test_x330_servos_lack_the_highest_rate() -> None:
    assert 4_500_000 not in rates_of(x.XL330_M288).values()
    assert 4_500_000 in rates_of(x.XL430_W250).values()


@pytest.mark.parametrize(
    ("model", "name", "raw", "said"),
    [
        (sts.STS3215, "operating_mode", 3, "step"),
        (sts.STS3215, "model_number", 777, "sts3215 or sts3215_c001 or sts3215_c044 or sts3215_c046"),
        (sts.STS3215, "status", 0b100001, "voltage, overload"),
        (x.XL430_W250, "hardware_error_status", 0b100, "temperature"),
        (x.XL430_W250, "operating_mode", 4, "extended position"),
        (ax_mx.AX_12A, "torque_enable", 1, "on"),
        (sts.STS3215, "position_p", 32, ""),
    ],
)
def test_coded_values_have_a_meaning(model: ServoModel, name: str, raw: int, said: str) -> None:
    assert meaning(model, register_named(model, name), raw) == said
