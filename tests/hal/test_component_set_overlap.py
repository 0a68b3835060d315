"""Tests that components with separate ports are read at the same time and do not affect each other."""

from dataclasses import replace

import numpy as np

from drivers.driver_errors import PortLost
from hal.components.component_lifecycle import configure_all
from hal.components.component_set import ComponentSet
from hal.mock_hardware import MockHardware
from sim_backend.clock import SimulatedClock
from tests.hal.bench import JOINTS, Bench


def side_by_side(count: int) -> tuple[ComponentSet, list[Bench]]:
    """Create benches with a common clock, after a mock that does not have to wait."""
    clock = SimulatedClock(1000.0)
    benches = [Bench(joints=[replace(j, name=f"{j.name}_{n}") for j in JOINTS], clock=clock) for n in range(count)]
    for number, bench in enumerate(benches):
        bench.hardware.name = f"arm_{number}"
    mock = MockHardware("mock", ("wheel",), clock)
    components = ComponentSet([mock, *(bench.hardware for bench in benches)], clock)
    configure_all(components)
    return components, benches


def reading_s(components: ComponentSet, clock: SimulatedClock) -> float:
    begin_s = clock.now()
    components.read()
    return clock.now() - begin_s


def test_reading_all_takes_as_long_as_the_slowest_bus() -> None:
    """Times on the simulated clock are exact."""
    alone, (bench,) = side_by_side(1)
    alone_s = reading_s(alone, bench.clock)
    assert alone_s > 0.0003
    three, (bench, *_) = side_by_side(3)
    assert reading_s(three, bench.clock) < 1.2 * alone_s


def test_the_state_has_the_values_of_every_component() -> None:
    components, benches = side_by_side(2)
    benches[1].place((2148, 2000, 1500))
    components.read()
    position = components.read().position
    np.testing.assert_allclose(position[1:4], [0.0, 0.0, 0.0219], atol=2e-3)
    np.testing.assert_allclose(position[4:7], [100 * 2 * np.pi / 4096, 0.0, 0.0219], atol=2e-3)


def test_a_lost_bus_does_not_affect_the_others() -> None:
    for lost, kept in ((0, 1), (1, 0)):
        components, benches = side_by_side(2)
        benches[lost].port.port.unplug()
        benches[kept].place((2248, 2000, 1500))
        state = components.read()
        (failed,) = components.failures
        assert failed.name == f"arm_{lost}" and isinstance(failed.error, PortLost)
        assert set(state.faults) == set(benches[lost].hardware.joints)
        shoulder = components.joints.index(f"shoulder_{kept}")
        assert abs(state.position[shoulder] - 200 * 2 * np.pi / 4096) < 2e-3
