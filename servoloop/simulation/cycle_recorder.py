"""Record the measurements, commands and bus packets of a simulated stack in each cycle."""

from bisect import bisect_left
from dataclasses import dataclass, replace

import numpy as np

from hal.types import FloatArray, JointState
from servoloop.simulation.faulty_stack import FaultyStack
from sim_backend.faults.event import Event

ROUNDING_S = 1e-9


@dataclass(frozen=True, slots=True)
class Packet:
    """Bytes that the stack sent or received in one call."""

    time_s: float
    bus: str
    sent: bool
    data: bytes


@dataclass(frozen=True, slots=True)
class CycleRecord:
    """Record of one cycle, made when its commands were written."""

    time_s: float
    """Time on the stack's clock, in seconds."""
    command: tuple[float, ...]
    """Commands in the order of the hardware's command interfaces, in rad, m, rad/s and so on."""
    position: tuple[float, ...]
    """Measured positions in the order of the joints, in rad or m."""
    velocity: tuple[float, ...]
    """Measured velocities in the order of the joints, in rad/s or m/s."""
    faults: dict[str, str]
    """Kind of the fault detected by the stack, by joint."""
    injected: tuple[Event, ...]
    """Injected faults that are active."""
    hardware: str
    """Most advanced lifecycle state of all hardware components."""
    controllers: dict[str, str]
    """Lifecycle state by controller."""
    packets: tuple[Packet, ...]
    """Packets since the previous record."""


@dataclass(frozen=True, slots=True)
class CycleRecording:
    """Recorded cycles of a run, with the names of its interfaces and joints."""

    interfaces: tuple[str, ...]
    joints: tuple[str, ...]
    cycles: tuple[CycleRecord, ...]

    def around(self, time_s: float, before_s: float, cycles_after: int) -> "CycleRecording":
        """Return the cycles of ``before_s`` seconds before a time, and ``cycles_after`` cycles after it."""
        times = [cycle.time_s for cycle in self.cycles]
        begin = bisect_left(times, time_s - before_s - ROUNDING_S)
        end = bisect_left(times, time_s + ROUNDING_S) + cycles_after
        return replace(self, cycles=self.cycles[begin:end])


class CycleRecorder:
    """Recorder that wraps the reads and writes of the hardware. Each write adds one record."""

    def __init__(self, stack: FaultyStack) -> None:
        """``stack`` must not be active yet."""
        self._stack = stack
        self._records: list[CycleRecord] = []
        self._seen = dict.fromkeys(stack.ports, (0, 0))
        self._state: JointState | None = None
        hardware = stack.loop.hardware
        read, write = hardware.read, hardware.write

        def recorded_read(deadline_s: float | None = None) -> JointState:
            self._state = read(deadline_s)
            return self._state

        def recorded_write(values: FloatArray, period_s: float) -> None:
            write(values, period_s)
            if self._state is not None:
                self._records.append(self._record(values, self._state))

        hardware.read, hardware.write = recorded_read, recorded_write  # type: ignore[method-assign]

    @property
    def recording(self) -> CycleRecording:
        """All cycles so far. Packets after the last write are in an extra record at the end."""
        if self._state is not None and any(self._unseen().values()):
            self._records.append(self._record(self._stack.loop.command, self._state))
        hardware = self._stack.loop.hardware
        return CycleRecording(hardware.command_interfaces, hardware.joints, tuple(self._records))

    def _record(self, command: FloatArray, state: JointState) -> CycleRecord:
        loop = self._stack.loop
        return CycleRecord(
            self._stack.clock.now(),
            _numbers(command),
            _numbers(state.position),
            _numbers(state.velocity),
            {joint: fault.kind for joint, fault in state.faults.items()},
            tuple(self._stack.player.active.values()),
            loop.hardware.state.name.lower(),
            {name: entry.state.name.lower() for name, entry in loop.manager.registry.loaded.items()},
            tuple(self._taken()),
        )

    def _unseen(self) -> dict[str, int]:
        """Return the number of packets not yet recorded, by bus."""
        ports = self._stack.ports
        return {bus: len(ports[bus].sent) + len(ports[bus].received) - sum(seen) for bus, seen in self._seen.items()}

    def _taken(self) -> list[Packet]:
        """Return the packets not yet recorded, sorted by time.

        Received packets come before packets sent at the same time, as every reply takes some time.
        """
        packets: list[Packet] = []
        for bus, port in self._stack.ports.items():
            sent, received = self._seen[bus]
            packets += [Packet(at_s, bus, True, data) for at_s, data in port.sent[sent:]]
            packets += [Packet(at_s, bus, False, data) for at_s, data in port.received[received:] if data]
            self._seen[bus] = len(port.sent), len(port.received)
        return sorted(packets, key=lambda packet: (packet.time_s, packet.sent))


def _numbers(values: FloatArray) -> tuple[float, ...]:
    return tuple(np.asarray(values, dtype=float).tolist())
