"""Tests of the Rust driver st3215-bus on virtual servos. The driver verifies its EEPROM writes."""

import importlib
from collections.abc import Iterator
from typing import Any

import pytest

from tests.peers.conftest import Serve
from tests.peers.waiting import eventually

pytestmark = pytest.mark.slow

# Import by name, because it is a compiled module whose types need another package.
library: Any = importlib.import_module("st3215_bus")


@pytest.fixture
def arm(serve: Serve) -> Iterator[Any]:
    with library.Buses({"arm": serve("sts3215", 1, 2, 3)}, timeout_ms=100) as arm:
        yield arm


def test_servos_are_found_and_read(arm: Any) -> None:
    assert arm.ping(4) == {"arm": [1, 2, 3]}
    assert arm.read_positions([1, 2, 3]) == {"arm": {1: 2048, 2: 2048, 3: 2048}}
    assert arm.read_register("PresentVoltage", [2]) == {"arm": {2: 120}}
    assert arm.read_eeprom("ID", [1, 3]) == {"arm": {1: 1, 3: 3}}


def test_an_absent_servo_is_omitted(arm: Any) -> None:
    assert set(arm.read_positions([1, 8])["arm"]) == {1}


def test_servos_are_moved_together(arm: Any) -> None:
    arm.set_torque(True, [1, 2, 3])
    goals = {1: 2000, 2: 2100, 3: 2200}
    arm.write_goals({"arm": goals})

    def arrived() -> bool:
        positions = arm.read_positions([1, 2, 3])["arm"]
        return positions.keys() == goals.keys() and all(abs(positions[i] - goals[i]) <= 5 for i in goals)

    eventually(arrived)
    arm.set_torque(False, [1, 2, 3])
    assert arm.read_register("TorqueEnable", [1, 2, 3]) == {"arm": {1: 0, 2: 0, 3: 0}}


def test_values_written_to_the_eeprom_are_verified(arm: Any) -> None:
    assert arm.write_eeprom("PCoef", {"arm": {1: 16, 2: 24}}) == {"arm": []}
    assert arm.read_eeprom("PCoef", [1, 2, 3]) == {"arm": {1: 16, 2: 24, 3: 32}}
    assert arm.read_register("Lock", [1, 2]) == {"arm": {1: 1, 2: 1}}
