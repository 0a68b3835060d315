"""The Feetech tables: internal consistency, and agreement with an independent driver if it is installed."""

import os
import pty
import select
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise

import pytest

from drivers.servos import feetech as models
from drivers.servos import scs, sts
from drivers.servos.catalog import MODELS, series_of
from drivers.servos.feetech import SERIES
from drivers.servos.register import Access, Register, ServoModel
from drivers.servos.series import Series

EVERY_REGISTER = [pytest.param(s, r, id=f"{s.name}.{r.name}") for s in SERIES for r in s.registers]
series = pytest.mark.parametrize("series", SERIES, ids=lambda s: s.name)


@series
def test_names_and_addresses_are_unique_and_nothing_overlaps(series: Series) -> None:
    assert len({r.name for r in series.registers}) == len(series.registers)
    for before, after in pairwise(series.registers):
        assert before.address + before.size <= after.address, (before.name, after.name)


@pytest.mark.parametrize(("series", "register"), EVERY_REGISTER)
def test_a_register_fits_the_table(series: Series, register: Register) -> None:
    assert register.size in (1, 2)
    assert 0 <= register.address < 87
    # The last registers of an STS are factory values that its firmware accepts and keeps.
    factory_value = series == models.STS and register.address >= 78
    assert register.persistent == (register.address < 40 or factory_value)
    assert register.sign_bit is None or register.sign_bit < register.size * 8
    if register.address >= 56 and not factory_value:
        assert register.access is Access.READ


@pytest.mark.parametrize(("module", "of"), [(sts, models.STS), (scs, models.SCS)])
def test_the_table_has_every_register_of_its_module(module: object, of: Series) -> None:
    written = [value for value in vars(module).values() if isinstance(value, Register)]
    assert len(written) == len(of.registers)
    assert set(written) == set(of.registers)


@series
def test_the_state_is_the_same_eight_bytes_in_both_series(series: Series) -> None:
    table = sts if series is models.STS else scs
    assert [(r.address, r.size) for r in table.STATE_BLOCK] == [(56, 2), (58, 2), (60, 2), (62, 1), (63, 1)]
    for block in (table.STATE_BLOCK, series.goal_block):
        for before, after in pairwise(block):
            assert before.address + before.size == after.address


def test_the_address_of_the_lock() -> None:
    assert (models.STS.lock, models.SCS.lock) == (sts.lock, scs.lock)
    assert (sts.lock.address, scs.lock.address) == (55, 48)


@series
def test_every_model_has_the_protocol_of_its_series(series: Series) -> None:
    for model in series.models:
        assert model.byte_order == series.protocol.byte_order
        assert MODELS[model.name] is model
        assert series_of(model) is series
        assert min(model.rated_voltage_v, model.stall_torque_nm, model.no_load_speed_rad_s) > 0.0


@pytest.mark.parametrize(
    ("name", "model_bytes"),
    [
        ("sts3215", (9, 3)),
        ("sts3215_c001", (9, 3)),
        ("sts3215_c044", (9, 3)),
        ("sts3215_c046", (9, 3)),
        ("sts3250", (9, 11)),
        ("sts3032", (9, 2)),
        ("scs15", (5, 15)),
        ("scs0009", (5, 4)),
    ],
)
def test_the_model_number_is_the_two_bytes_in_the_order_of_the_series(name: str, model_bytes: tuple[int, int]) -> None:
    model = MODELS[name]
    assert model.number == int.from_bytes(bytes(model_bytes), model.byte_order)


def test_a_model_of_an_unknown_make_has_no_series() -> None:
    with pytest.raises(ValueError, match=r"other is not a supported servo model: .* lists all models"):
        series_of(ServoModel("other", 1, "little", 4096, 12.0, 1.0, 1.0))


def test_a_potentiometer_covers_less_than_a_turn() -> None:
    for model in models.SCS.models:
        assert model.positions == scs.POSITIONS < model.counts_per_turn


# rustypot has its own tables with different register names. The bytes that rustypot sends show the addresses.

UNCOMPARED = {
    # In rustypot, 24 is a word of two bytes, as in older editions of the memory table.
    "sts": ["endianness", "minimum_startup_force", "integral_limit", "async_write_flag", "present_target"],
    "scs": list[str](),
}
THEIR_NAMES = {
    "firmware_major": "firmware_major_version",
    "firmware_minor": "firmware_minor_version",
    "return_delay": "return_delay_time",
    "status_level": "response_status_level",
    "min_position": "min_position_limit",
    "max_position": "max_position_limit",
    "max_temperature": "max_temperature_limit",
    "max_voltage": "max_voltage_limit",
    "min_voltage": "min_voltage_limit",
    "max_torque": "max_torque_limit",
    "position_p": "p_coefficient",
    "position_d": "d_coefficient",
    "position_i": "i_coefficient",
    "async_write_flag": "sync_write_flag",
    "overcurrent_time": "over_current_protection_time",
    "velocity_p": "speed_closed_loop_p_coefficient",
    "velocity_i": "velocity_closed_loop_i_coefficient",
    "moving_threshold": "moving_velocity_threshold",
    "velocity_unit": "velocity_unit_factor",
    "min_velocity": "minimum_velocity_limit",
    "max_velocity": "maximum_velocity_limit",
    "max_acceleration": "maximum_acceleration",
    "pwm_max_step": "pwm_maximum_step",
}
"""Names of registers in rustypot that differ from ours."""


@contextmanager
def answering_servo(requests: list[bytes]) -> Iterator[str]:
    """Yield a pseudo-terminal with a servo that answers each read with zeros."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    done = threading.Event()

    def serve() -> None:
        while not done.is_set():
            if select.select([master], [], [], 0.02)[0]:
                request = os.read(master, 64)
                requests.append(request)
                body = bytes((request[2], request[6] + 2, 0)) + bytes(request[6])
                os.write(master, b"\xff\xff" + body + bytes((~sum(body) & 0xFF,)))

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield os.ttyname(slave)
    finally:
        done.set()
        thread.join()
        os.close(master)
        os.close(slave)


@pytest.mark.parametrize(
    ("of", "controller"), [(models.STS, "Sts3215PyController"), (models.SCS, "Scs0009PyController")]
)
def test_rustypot_reads_the_same_addresses(of: Series, controller: str) -> None:
    rustypot = pytest.importorskip("rustypot")
    requests: list[bytes] = []
    missing = []
    with answering_servo(requests) as device:
        theirs = getattr(rustypot, controller)(device, 1_000_000, 1.0)
        for register in of.registers:
            read = getattr(theirs, f"read_{THEIR_NAMES.get(register.name, register.name)}", None)
            if read is None or register.name in UNCOMPARED[of.name]:
                missing.append(register.name)
                continue
            read(1)
            assert tuple(requests[-1][5:7]) == (register.address, register.size), register.name
    assert missing == UNCOMPARED[of.name]
