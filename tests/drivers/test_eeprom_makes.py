"""EEPROM writes to Dynamixel servos, which have no lock register and only need torque to be disabled."""

from collections.abc import Mapping
from dataclasses import dataclass

import pytest

from drivers.bus.bus import Bus
from drivers.driver_errors import ServoSilent
from drivers.eeprom import Change, EepromError, update
from drivers.servos import ax_mx as dxl
from drivers.servos import x
from drivers.servos.register import Register, ServoModel
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from tests.drivers.ports import WatchedPort

WRITE = 0x03


@dataclass(frozen=True)
class Case:
    """A model, its new settings (lowest address first), a setting that already has its value, and the ID register."""

    model: ServoModel
    new: Mapping[Register, int]
    kept: Register
    servo_id: Register = dxl.servo_id


CASES = (
    Case(x.XL430_W250, {x.homing_offset: -85, x.pwm_limit: 500}, x.temperature_limit, x.servo_id),
    Case(dxl.AX_12A, {dxl.cw_angle_limit: 300, dxl.max_torque: 500}, dxl.temperature_limit),
    Case(dxl.MX_28, {dxl.max_torque: 500, dxl.multi_turn_offset: -85}, dxl.ccw_angle_limit),
)
"""One model of each kind of control table. The XL-320 is not tested here."""
every_case = pytest.mark.parametrize("case", CASES, ids=lambda case: case.model.name)


class Bench:
    """Two servos, IDs 1 and 2."""

    def __init__(self, case: Case) -> None:
        clock = SimulatedClock(10.0)
        models = dict.fromkeys((1, 2), case.model)
        self.protocol2 = isinstance(case.model, x.XModel)
        of = VirtualDynamixelBus.of if self.protocol2 else VirtualBus.of
        self.servos = of(BenchPlant((1, 2)), models)
        self.port = WatchedPort(self.servos, clock)
        self.bus: Bus = Bus(self.port, clock, models)
        self.first = self.servos.servo(1)

    def held(self, register: Register) -> int:
        return self.first.memory.get(register)

    @property
    def written(self) -> list[int]:
        """Return the addresses of all write instructions, in order."""
        if self.protocol2:
            return [int.from_bytes(p[8:10], "little") for p in self.port.sent if p[7] == WRITE]
        return [p[5] for p in self.port.sent if p[4] == WRITE]


@every_case
def test_only_different_values_are_written_and_they_persist(case: Case) -> None:
    bench = Bench(case)
    before = {register: bench.held(register) for register in case.new}
    values = {case.kept: bench.held(case.kept), **dict(reversed(case.new.items()))}
    changes = update(bench.bus, 1, None, values)
    assert changes == tuple(Change(register, before[register], value) for register, value in case.new.items())
    assert bench.written == [register.address for register in case.new]
    bench.first.power_cycle()
    assert {register: bench.held(register) for register in values} == values
    assert update(bench.bus, 1, None, values) == ()
    assert len(bench.written) == len(case.new)


@every_case
def test_nothing_is_written_while_torque_is_enabled(case: Case) -> None:
    bench = Bench(case)
    bench.bus.torque_on(1)
    bench.port.sent = ()
    register = next(iter(case.new))
    place = rf"servo 1: {register.name} \(register {register.address}\)"
    with pytest.raises(
        EepromError, match=f"{place} was not written: the torque of the servo is enabled. Support the arm"
    ):
        update(bench.bus, 1, None, case.new)
    assert bench.written == []


@every_case
@pytest.mark.parametrize("number", [0, 1])
def test_a_value_that_the_servo_does_not_keep_is_reported_with_earlier_changes(
    case: Case, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(case)
    (first, *_), (register, value) = case.new, list(case.new.items())[number]
    old, write = bench.held(register), bench.port.write

    def forgetting(data: bytes) -> None:
        bench.first.memory.put(register, old)
        write(data)

    monkeypatch.setattr(bench.port, "write", forgetting)
    place = rf"servo 1: {register.name} \(register {register.address}\)"
    with pytest.raises(
        EepromError, match=f"{place} is still {old}, not {value}: the servo did not accept the value"
    ) as caught:
        update(bench.bus, 1, None, case.new)
    assert (caught.value.servo_id, caught.value.register) == (1, register)
    assert any(first.name in note for note in getattr(caught.value, "__notes__", [])) is (number == 1)


@every_case
def test_a_silent_servo_is_named_with_the_setting(case: Case) -> None:
    bench = Bench(case)
    bench.servos.faults.silence(1)
    register = next(iter(case.new))
    place = rf"servo 1: {register.name} \(register {register.address}\)"
    with pytest.raises(EepromError, match=f"{place} cannot be read: the servo does not respond") as caught:
        update(bench.bus, 1, None, case.new)
    assert isinstance(caught.value.__cause__, ServoSilent)


@every_case
def test_the_id_is_written_last_and_an_id_in_use_is_refused(case: Case) -> None:
    bench = Bench(case)
    register, value = next(iter(case.new.items()))
    with pytest.raises(EepromError, match=rf"servo 1: id \(register {case.servo_id.address}\) cannot be changed to 2"):
        update(bench.bus, 1, None, {case.servo_id: 2})
    assert bench.written == []
    changes = update(bench.bus, 1, None, {case.servo_id: 9, register: value})
    assert [change.register for change in changes] == [register, case.servo_id]
    assert (bench.first.servo_id, bench.held(register)) == (9, value)
