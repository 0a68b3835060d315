"""Control tables of protocol 1.0: internal consistency, and agreement with the lists of ROBOTIS."""

from itertools import pairwise

import pytest

from drivers.servos import ax_mx as dxl
from drivers.servos.dynamixel1 import AX_MX
from drivers.servos.register import Access, Register

every_model = pytest.mark.parametrize("model", dxl.MODELS.values(), ids=lambda model: model.name)

ROBOTIS_COMMON = (
    "0 2, 2 1, 3 1, 4 1, 5 1, 6 2, 8 2, 11 1, 12 1, 13 1, 14 2, 16 1, 17 1, 18 1, "
    "24 1, 25 1, 30 2, 32 2, 34 2, 36 2, 38 2, 40 2, 42 1, 43 1, 44 1, 46 1, 47 1, 48 2"
)
ROBOTIS = {
    "ax-12a": ROBOTIS_COMMON + ", 26 1, 27 1, 28 1, 29 1",
    # Only the e-manual contains the tick (50).
    "mx-28": ROBOTIS_COMMON + ", 20 2, 22 1, 26 1, 27 1, 28 1, 50 2, 73 1",
}
"""Addresses and sizes according to dynamixel-workbench, ``dynamixel_item.cpp``, items_AX and items_MX."""


@every_model
def test_names_are_unique_and_nothing_overlaps(model: dxl.AxMxModel) -> None:
    table = dxl.registers(model)
    assert len({register.name for register in table}) == len(table)
    for before, after in pairwise(table):
        assert before.address + before.size <= after.address, (before.name, after.name)


@pytest.mark.parametrize("name", ROBOTIS)
def test_addresses_and_sizes_agree_with_the_list_of_robotis(name: str) -> None:
    theirs = sorted(tuple(map(int, item.split())) for item in ROBOTIS[name].split(", "))
    assert [(register.address, register.size) for register in dxl.registers(dxl.MODELS[name])] == theirs


@every_model
def test_properties_of_ax_and_mx_models(model: dxl.AxMxModel) -> None:
    compliance, gains = dxl.cw_compliance_slope in model.own, dxl.p_gain in model.own
    assert compliance != gains == model.bulk_read == (dxl.goal_acceleration in model.own)
    positions = dxl.EX_SPAN.positions if model is dxl.EX_106 else dxl.AX_POSITIONS
    assert model.positions == (positions if compliance else None)
    unit_rpm = 0.111 if compliance else 0.916 if model is dxl.MX_12W else 0.114
    assert model.speed_unit_counts_s == pytest.approx(unit_rpm * model.counts_per_turn / 60.0)
    assert model.byte_order == "little"
    assert AX_MX.bulk_read(model) == model.bulk_read


@every_model
def test_a_register_fits_the_table(model: dxl.AxMxModel) -> None:
    for register in dxl.registers(model):
        assert register.persistent == (register.address < 24)
        measured = (dxl.realtime_tick, dxl.sensed_current, dxl.model_number, dxl.firmware_version)
        state = 36 <= register.address <= 46 or register in measured
        assert (register.access is Access.READ) == state, register.name


def test_every_register_of_the_module_is_in_a_table() -> None:
    written = {value for value in vars(dxl).values() if isinstance(value, Register)}
    assert written == {register for model in dxl.MODELS.values() for register in dxl.registers(model)}


def test_blocks_have_no_gaps() -> None:
    assert [(r.address, r.size) for r in dxl.STATE_BLOCK] == [(36, 2), (38, 2), (40, 2), (42, 1), (43, 1)]
    assert [(r.address, r.size) for r in dxl.GOAL_BLOCK] == [(30, 2), (32, 2)]


def test_units() -> None:
    """E-manual: 300 is 33.3 rpm for an AX-12A and 34.2 rpm for an MX-28. 1024 counts of an AX are 300 degrees."""
    assert 300 * dxl.speed_unit_counts_s(dxl.AX_12A) * 60.0 / dxl.AX_12A.counts_per_turn == pytest.approx(33.3)
    assert 300 * dxl.speed_unit_counts_s(dxl.MX_28) * 60.0 / 4096 == pytest.approx(34.2)
    assert 1024 / dxl.AX_12A.counts_per_turn * 360.0 == pytest.approx(300.0, abs=0.1)


def test_error_bits_agree_with_the_sdk() -> None:
    import importlib

    handler = importlib.import_module("dynamixel_sdk.protocol1_packet_handler")
    theirs = {
        handler.ERRBIT_VOLTAGE: "voltage",
        handler.ERRBIT_ANGLE: "angle limit",
        handler.ERRBIT_OVERHEAT: "temperature",
        handler.ERRBIT_RANGE: "range",
        handler.ERRBIT_CHECKSUM: "checksum",
        handler.ERRBIT_OVERLOAD: "overload",
        handler.ERRBIT_INSTRUCTION: "instruction",
    }
    assert {1 << bit: name for bit, name in dxl.ERROR_BITS.items()} == theirs
    assert dxl.alarms(0x25) == ("voltage", "temperature", "overload")
    assert handler.ERRBIT_RANGE | handler.ERRBIT_CHECKSUM | handler.ERRBIT_INSTRUCTION == dxl.REFUSALS
