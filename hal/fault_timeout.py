"""Abort a motion after its servos have stopped responding. The timeout counts cycles, not wall-clock time."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from hal.types import JointFault

FAULT_CYCLES: Final = 7
"""Minimum number of consecutive cycles with a fault before a motion is aborted.

At 20 Hz, a stall of 0.2 s causes the replies of five cycles to be lost: the current cycle and four more. If replies to
earlier requests arrive late, a sixth cycle may be lost.
"""
FAULT_S: Final = 0.35
"""Minimum duration of a fault before a motion is aborted, in seconds. The duration is measured in cycles (35 cycles at
100 Hz).

A bus stall of 0.2 s therefore never aborts a motion, at any loop rate. While the loop is stalled, no cycles run and
none are counted.
"""


@dataclass(slots=True)
class FaultTimeout:
    """Counter of consecutive cycles with a fault, for each joint of a motion."""

    joints: tuple[str, ...]
    cycles: dict[str, int] = field(default_factory=dict)
    """Number of consecutive cycles with a fault, keyed by joint name. If it is empty, ``lasting`` does not need to be
    called."""

    def lasting(self, faults: Mapping[str, JointFault], period_s: float) -> str | None:
        """Count one cycle. Return the messages of the faults that have lasted too long, or None."""
        self.cycles = {name: self.cycles.get(name, 0) + 1 for name in self.joints if name in faults}
        allowed = max(FAULT_CYCLES, math.ceil(FAULT_S / period_s - 1e-9))
        texts = (faults[name].text for name, count in self.cycles.items() if count >= allowed)
        return "; ".join(dict.fromkeys(texts)) or None  # On a dead bus, many joints have the same message.
