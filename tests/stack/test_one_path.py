"""The bus benchmark is realistic: ``servoloop bench bus`` makes the same port calls as the control loop."""

from collections.abc import Mapping

import pytest

from controller.loop import ControlLoop
from controller.manager.manager import ControllerManager
from drivers.bus.bus import Bus
from drivers.servos.register import ServoModel
from drivers.types import ServoGoal
from hal.components.component_lifecycle import configure_all
from hal.components.component_set import ComponentSet
from hal.joint import Joint
from hal.servos.servo_hardware import ServoHardware
from hal.types import JointLimits
from servoloop.bench.bus import measure
from sim_backend.buses.port import VirtualPort
from tests.drivers.fault_lines import IDS, KINDS, Kind, Line

CYCLES = 5
LIMITS = JointLimits(-3.0, 3.0, 4.0, 12.0, 120.0)
Call = tuple[str, bytes | int]


class RecordingPort(VirtualPort):
    """Port that records its calls, except for the deadlines."""

    calls: tuple[Call, ...] = ()

    def write(self, data: bytes) -> None:
        self.calls += (("write", data),)
        super().write(data)

    def read(self, size: int, deadline_s: float) -> bytes:
        self.calls += (("read", size),)
        return super().read(size, deadline_s)

    def discard_input(self) -> None:
        self.calls += (("discard_input", 0),)
        super().discard_input()


def identified(kind: Kind) -> tuple[Line, RecordingPort]:
    """Return a line after all servos have been identified and have answered."""
    line = Line(kind, RecordingPort)
    assert isinstance(line.port, RecordingPort)
    for servo_id in IDS:
        line.bus.identify(servo_id, kind.models[servo_id])
    line.bus.read_states(IDS)
    return line, line.port


def joints(models: Mapping[int, ServoModel]) -> list[Joint]:
    return [Joint(f"j{i}", i, model, LIMITS, zero_counts=model.last_count // 2) for i, model in models.items()]


def calls_of_the_loop(kind: Kind, monkeypatch: pytest.MonkeyPatch) -> tuple[tuple[Call, ...], Mapping[int, ServoGoal]]:
    """Return the port calls and the goals of a number of cycles that hold the arm."""
    line, port = identified(kind)
    # The loop also reads the torque of one servo at a time, a few times per second. This read is not compared here.
    monkeypatch.setattr("hal.servos.servo_faults.WATCH_S", 1e9)
    told: list[Mapping[int, ServoGoal]] = []
    write_goals = Bus.write_goals

    def watched(bus: Bus, goals: Mapping[int, ServoGoal]) -> None:
        told.append(goals)
        write_goals(bus, goals)

    monkeypatch.setattr(Bus, "write_goals", watched)
    hardware = ComponentSet([ServoHardware("arm", joints(kind.models), lambda: line.bus, line.clock)], line.clock)
    limits = dict.fromkeys(hardware.joints, LIMITS)
    loop = ControlLoop(hardware, ControllerManager(hardware, limits), limits, line.clock, 0.05)
    configure_all(hardware)
    loop.activate()
    for number in range(2 * CYCLES):
        if number == CYCLES:  # in the first half, the bus detects how the servos can be read
            port.calls = ()
        loop.step()
        line.clock.sleep_until(line.clock.now() + 0.05)
    monkeypatch.undo()
    return port.calls, told[-1]


@pytest.mark.parametrize("kind", [kind for kind in KINDS if not kind.with_goals], ids=lambda kind: kind.name)
def test_benchmark_and_control_loop_make_the_same_port_calls(kind: Kind, monkeypatch: pytest.MonkeyPatch) -> None:
    driven, goals = calls_of_the_loop(kind, monkeypatch)
    line, port = identified(kind)
    line.bus.write_goals(goals)
    measure(line.bus, line.clock, IDS, goals, CYCLES)  # the bus detects how the servos can be read
    port.calls = ()
    measure(line.bus, line.clock, IDS, goals, CYCLES)
    assert port.calls == driven
    assert sum(name == "write" for name, _ in driven) >= 2 * CYCLES
