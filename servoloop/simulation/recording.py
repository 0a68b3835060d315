"""Record the bus traffic and the motion of a simulated run."""

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from hal.types import FloatArray
from servoloop.recording.following_error import FollowingError, between_cycles
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock


@dataclass(slots=True)
class RecordingPort:
    """Port that records all bytes with their times."""

    port: VirtualPort
    clock: SimulatedClock
    sent: list[tuple[float, bytes]] = field(default_factory=list)
    received: list[tuple[float, bytes]] = field(default_factory=list)
    on_write: Callable[[bytes], None] = lambda data: None

    @property
    def name(self) -> str:
        return self.port.name

    @property
    def baud(self) -> int:
        return self.port.baud

    def write(self, data: bytes) -> None:
        now_s = self.clock.now()
        self.on_write(data)
        self.port.write(data)
        self.sent.append((now_s, data))

    def read(self, size: int, deadline_s: float) -> bytes:
        data = self.port.read(size, deadline_s)
        self.received.append((self.clock.now(), data))
        return data

    def discard_input(self) -> None:
        self.port.discard_input()

    def set_baud(self, baud: int) -> None:
        self.port.set_baud(baud)

    def close(self) -> None:
        self.port.close()


@dataclass(slots=True)
class Trace:
    """Actual positions of the arm in every millisecond, and its references in every cycle."""

    world_s: list[float] = field(default_factory=list)
    actual: list[FloatArray] = field(default_factory=list)
    cycle_s: list[float] = field(default_factory=list)
    position: list[FloatArray] = field(default_factory=list)
    velocity: list[FloatArray] = field(default_factory=list)

    def following_error(self) -> tuple[FloatArray, FloatArray]:
        """Return the largest error and the RMS error while moving of each joint, in rad, including between cycles."""
        error = self.following()
        return np.array(error.largest_rad), np.array(error.rms_moving_rad)

    def following(self, since_s: float = 0.0) -> FollowingError:
        """Return the following error since a time, including between cycles."""
        start = bisect_left(self.world_s, since_s)
        cycles, position, velocity = np.array(self.cycle_s), np.array(self.position), np.array(self.velocity)
        return between_cycles(self.world_s[start:], self.actual[start:], cycles, position, velocity)
