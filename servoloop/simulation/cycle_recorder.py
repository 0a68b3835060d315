"""A recorder of a simulated stack: what it measured and commanded in each cycle, and what went over the wires."""

from bisect import bisect_left
from dataclasses import dataclass, replace

import numpy as np

from hal.types import FloatArray, JointState
from servoloop.simulation.faulty_stack import FaultyStack
from sim_backend.faults.event import Event

ROUNDING_S = 1e-9


@dataclass(frozen=True, slots=True)
class Packet:
    """Bytes that went over a line in one piece, sent by the stack or received."""

    time_s: float
    bus: str
    sent: bool
    data: bytes


@dataclass(frozen=True, slots=True)
class CycleRecord:
    """One cycle, seen when its commands were written; ``time_s`` of the stack's clock."""

    time_s: float
    command: tuple[float, ...]
    """In the order of the hardware's command interfaces: rad, m, rad/s, ..."""
    position: tuple[float, ...]
    """As measured, in the order of the joints: rad, m."""
    velocity: tuple[float, ...]
    """The same: rad/s, m/s."""
    faults: dict[str, str]
    """The kind of fault that the stack knows of, by joint."""
    injected: tuple[Event, ...]
    """The faults that are really there."""
    hardware: str
    """The life cycle state of the hardware component that has come furthest."""
    controllers: dict[str, str]
    """Life cycle states, by controller."""
    packets: tuple[Packet, ...]
    """Since the last record."""


@dataclass(frozen=True, slots=True)
class Recording:
    """Some cycles of a run, with the names of their numbers."""

    interfaces: tuple[str, ...]
    joints: tuple[str, ...]
    cycles: tuple[CycleRecord, ...]

    def around(self, time_s: float, before_s: float, cycles_behind: int) -> "Recording":
        """The cycles within ``before_s`` before a moment, and so many behind it."""
        times = [cycle.time_s for cycle in self.cycles]
        begin = bisect_left(times, time_s - before_s - ROUNDING_S)
        end = bisect_left(times, time_s + ROUNDING_S) + cycles_behind
        return replace(self, cycles=self.cycles[begin:end])


class CycleRecorder:
    """Looks on where the loop and the end of the program meet the hardware: each write is one record."""

    def __init__(self, stack: FaultyStack) -> None:
        """``stack`` is not up yet."""
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
    def recording(self) -> Recording:
        """All so far; packets behind the last write stand in a last record of their own."""
        if self._state is not None and any(self._unseen().values()):
            self._records.append(self._record(self._stack.loop.command, self._state))
        hardware = self._stack.loop.hardware
        return Recording(hardware.command_interfaces, hardware.joints, tuple(self._records))

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
        """How many packets no record has yet, by line."""
        ports = self._stack.ports
        return {bus: len(ports[bus].sent) + len(ports[bus].received) - sum(seen) for bus, seen in self._seen.items()}

    def _taken(self) -> list[Packet]:
        """The packets that no record has yet, by time; of one moment what came in is first: no reply takes no time."""
        packets: list[Packet] = []
        for bus, port in self._stack.ports.items():
            sent, received = self._seen[bus]
            packets += [Packet(at_s, bus, True, data) for at_s, data in port.sent[sent:]]
            packets += [Packet(at_s, bus, False, data) for at_s, data in port.received[received:] if data]
            self._seen[bus] = len(port.sent), len(port.received)
        return sorted(packets, key=lambda packet: (packet.time_s, packet.sent))


def _numbers(values: FloatArray) -> tuple[float, ...]:
    return tuple(np.asarray(values, dtype=float).tolist())
