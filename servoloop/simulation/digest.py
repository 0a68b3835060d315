"""The digest of a simulated run: one number that is another as soon as anything went otherwise."""

import hashlib
from collections.abc import Iterable

import numpy as np

from hal.types import JointState
from servoloop.simulation.recording import RecordingPort


class Digest:
    """SHA-256 of every byte on every wire, and of every joint state, in their order."""

    def __init__(self) -> None:
        self._states = hashlib.sha256()

    def add_state(self, state: JointState) -> None:
        """Take one cycle's measurement in: all its numbers as doubles, the lowest byte first."""
        for values in (state.position, state.velocity, state.effort):
            self._states.update(np.asarray(values, dtype="<f8").tobytes())
        self._states.update(repr(sorted(state.faults)).encode())

    def of(self, ports: Iterable[RecordingPort]) -> str:
        """The digest with all that went over these ports, in hexadecimal digits."""
        whole = self._states.copy()
        for port in ports:
            for traffic in (port.sent, port.received):
                whole.update(f"{port.name} {len(traffic)}\n".encode())
                for _, data in traffic:
                    whole.update(data)
        return whole.hexdigest()
