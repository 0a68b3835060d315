"""Record the measurements, commands and bus packets of a simulated stack in each cycle."""

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from drivers.port import Port
from hal.types import FloatArray, JointState
from servoloop.recording.bus_tap import BusTaps, Transfer
from servoloop.recording.sampler import CycleSample, Sampler
from servoloop.simulation.faulty_stack import FaultyStack
from servoloop.stack.robot_files import servo_ids
from sim_backend.faults.event import Event

ROUNDING_S = 1e-9


@dataclass(frozen=True, slots=True)
class CycleRecord:
    """Record of one cycle, created after the commands of that cycle are written."""

    time_s: float
    """Time on the stack's clock, in seconds."""
    sample: CycleSample
    """Measurement, commands and bus traffic, as in a recording."""
    injected: tuple[Event, ...]
    """Active injected faults."""
    hardware: str
    """Most advanced lifecycle state of all hardware components."""
    controllers: dict[str, str]
    """Lifecycle state of each controller, keyed by name."""

    @property
    def command(self) -> tuple[float, ...]:
        """Commands in the order of the hardware's command interfaces, in units such as rad, m and rad/s."""
        return _numbers(self.sample.command)

    @property
    def position(self) -> tuple[float, ...]:
        """Measured positions in the order of the joints, in rad or m."""
        return _numbers(self.sample.state.position)

    @property
    def velocity(self) -> tuple[float, ...]:
        """Measured velocities in the order of the joints, in rad/s or m/s."""
        return _numbers(self.sample.state.velocity)

    @property
    def faults(self) -> dict[str, str]:
        """Type of each fault that the stack has detected, keyed by joint name."""
        return {joint: fault.kind for joint, fault in self.sample.state.faults.items()}

    @property
    def packets(self) -> tuple[Transfer, ...]:
        """Bytes on the bus since the previous record, without reads that returned no bytes."""
        return tuple(one for one in self.sample.transfers if one.data)


@dataclass(frozen=True, slots=True)
class CycleRecording:
    """Recorded cycles of a run, with the names of its interfaces and joints."""

    interfaces: tuple[str, ...]
    joints: tuple[str, ...]
    cycles: tuple[CycleRecord, ...]
    buses: Mapping[str, str]
    """Name of each bus, keyed by port name."""

    def around(self, time_s: float, before_s: float, cycles_after: int) -> "CycleRecording":
        """Return the cycles in the ``before_s`` seconds before a time, and ``cycles_after`` cycles after that time."""
        times = [cycle.time_s for cycle in self.cycles]
        begin = bisect_left(times, time_s - before_s - ROUNDING_S)
        end = bisect_left(times, time_s + ROUNDING_S) + cycles_after
        return replace(self, cycles=self.cycles[begin:end])


class CycleRecorder:
    """Recorder of all cycles of a stack until the stack's program exits. A record is added each time commands are
    written."""

    def __init__(self, stack: FaultyStack) -> None:
        """``stack`` must not be active yet."""
        self._stack, self._taps = stack, BusTaps()
        self._sampler = Sampler(stack.loop, stack.files.component.name, servo_ids(stack.files), self._taps)
        self._records: list[CycleRecord] = []
        self._state: JointState | None = None
        stack.tap = self._tap
        stack.components.on_read, stack.components.on_written = self._read, self._written

    @property
    def recording(self) -> CycleRecording:
        """All cycles so far. Packets after the last write are in an extra record at the end."""
        if self._state is not None:
            rest = self._record(self._sampler.sample(self._state))
            self._records += [rest] if rest.packets else []
        stack, hardware = self._stack, self._stack.loop.hardware
        buses = {port.name: bus for bus, port in stack.ports.items()}
        return CycleRecording(hardware.command_interfaces, hardware.joints, tuple(self._records), buses)

    def _tap(self, port: Port) -> Port:
        return self._taps.tap(port, self._stack.clock)

    def _read(self, state: JointState) -> None:
        self._state = state

    def _written(self) -> None:
        if self._state is not None:
            self._records.append(self._record(self._sampler.sample(self._state)))

    def _record(self, sample: CycleSample) -> CycleRecord:
        loop = self._stack.loop
        return CycleRecord(
            self._stack.clock.now(),
            sample,
            tuple(self._stack.player.active.values()),
            loop.hardware.state.name.lower(),
            {name: entry.state.name.lower() for name, entry in loop.manager.registry.loaded.items()},
        )


def _numbers(values: FloatArray) -> tuple[float, ...]:
    return tuple(np.asarray(values, dtype=float).tolist())
