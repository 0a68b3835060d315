"""Every supported model on a virtual bus: identification, state and goals. The tests name no model."""

from typing import Any

import pytest

from drivers.bus.bus import Bus
from drivers.driver_errors import ServoRefused
from drivers.servos import ax_mx as dxl
from drivers.servos import sts
from drivers.servos import x as x_series
from drivers.servos.catalog import MODELS, series_of
from drivers.servos.register import Access, Register, ServoModel
from drivers.types import ServoGoal, ServoState
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus, servo_of
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.packets.sts import Code
from sim_backend.servos.sts.servo import VirtualServo

IDS = (1, 2)
every_model = pytest.mark.parametrize("model", MODELS.values(), ids=lambda m: m.name)


_SHORT_BY = {"xl320": 13}
"""Position error that the identified friction causes at a P gain that produces little drive."""


class Bench:
    def __init__(self, model: ServoModel) -> None:
        self.clock = SimulatedClock(10.0)
        # The value is proportional to the torque, because the largest model has fifty times the torque of the smallest.
        share = model.stall_torque_nm / sts.STS3215.stall_torque_nm
        plant = BenchPlant(IDS, inertia_kg_m2=share * 0.024, friction_nm=share * 0.06)
        models = dict.fromkeys(IDS, model)
        protocol2 = series_of(model).protocol.name == "Dynamixel protocol 2.0"
        line = VirtualDynamixelBus.of(plant, models) if protocol2 else VirtualBus.of(plant, models)
        self.bus = Bus(VirtualPort(line, self.clock), self.clock, models)

    def run(self, seconds: float) -> dict[int, ServoState]:
        self.clock.sleep_until(self.clock.now() + seconds)
        states = self.bus.read_states(IDS, self.clock.now() + 0.05)
        return {i: state for i, state in states.items() if isinstance(state, ServoState)}


_KEPT_BESIDES = (3 + 1, *range(50, 55), 78, 79)
"""Bytes that an STS stores although its table omits them or marks them as read-only. An STS refuses writes to 0 to 3
and 56 to 77."""


def table_of(model: ServoModel) -> tuple[tuple[Register, ...], Code | None]:
    """Return the registers of a Feetech or Dynamixel protocol 1.0 model, and the instruction of its group read."""
    if isinstance(model, dxl.AxMxModel):
        return dxl.registers(model), Code.BULK_READ if model.bulk_read else None
    series = series_of(model)
    return series.registers, Code.SYNC_READ if series.protocol.group_read == "sync" else None


@pytest.mark.parametrize(
    "model",
    [m for m in MODELS.values() if series_of(m).protocol.name != "Dynamixel protocol 2.0"],
    ids=lambda m: m.name,
)
def test_the_virtual_servo_has_the_table_and_group_read_of_its_series(model: ServoModel) -> None:
    servo: Any = servo_of(model, 1)
    table, group_read = table_of(model)
    assert group_read == servo.GROUP_READ
    listed = {place: r for r in table for place in range(r.address, r.address + r.size)}
    kept = []
    for place in (place for place in range(128) if listed.get(place) not in (dxl.lock, dxl.servo_id)):
        if not servo.memory.read(place, 1):
            break  # end of the table of an STS
        before = servo.memory.read(place, 1)[0]
        servo.memory.write(place, bytes((before ^ 2,)))
        if servo.memory.read(place, 1)[0] != before:
            kept.append(place)
        servo.memory.write(place, bytes((before,)))
    written = [place for place, r in sorted(listed.items()) if r.access is Access.READ_WRITE]
    unlisted = _KEPT_BESIDES if isinstance(servo, VirtualServo) else ()
    assert [place for place in kept if place not in unlisted] == [
        place for place in written if listed[place] not in (dxl.lock, dxl.servo_id)
    ]


@every_model
def test_the_model_is_found_by_its_number(model: ServoModel) -> None:
    bench = Bench(model)
    for servo_id in IDS:
        bench.bus.identify(servo_id, model)
    others = [other for other in MODELS.values() if other.number != model.number]
    stranger = next(
        (other for other in others if series_of(other).protocol.name == series_of(model).protocol.name), others[0]
    )
    with pytest.raises(ServoRefused, match=f"is model {model.number} "):
        bench.bus.identify(1, stranger)


@every_model
def test_the_servo_is_at_rest_without_alarms_and_then_reaches_its_goal(model: ServoModel) -> None:
    bench = Bench(model)
    for servo_id in IDS:
        bench.bus.identify(servo_id, model)
    states = bench.run(0.1)
    assert set(states) == set(IDS)
    start = states[1].position_counts
    assert 0 <= start <= model.last_count
    assert (states[1].load, states[1].alarms) == (0.0, ())
    measures = isinstance(model, x_series.XModel) and model.current_unit_a is not None
    assert (states[1].current_a is not None) == measures
    bench.bus.write_goals(dict.fromkeys(IDS, ServoGoal(start)))
    for servo_id in IDS:
        bench.bus.torque_on(servo_id)
    way = model.counts_per_turn // 12
    bench.bus.write_goals(dict.fromkeys(IDS, ServoGoal(start - way, way)))
    halfway, there = bench.run(0.5)[1], bench.run(2.5)
    assert start - way < halfway.position_counts < start
    assert halfway.velocity_counts_s < 0
    for state in there.values():
        assert state.position_counts == pytest.approx(start - way, abs=_SHORT_BY.get(model.name, max(2, way / 20)))
        assert state.alarms == ()
        assert 0 <= state.position_counts <= model.last_count
