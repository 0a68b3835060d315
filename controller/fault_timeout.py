"""The fault timeout ends a goal whose servos have stopped answering; it counts cycles, never wall time."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from hal.types import JointFault

FAULT_CYCLES: Final = 7
"""So many cycles in a row a joint must have a fault before its goal is given up. At 20 Hz a stall of 0.2 s takes the
answers of five: the one under way and four more. What was asked meanwhile is answered first, which may cost a sixth."""
FAULT_S: Final = 0.35
"""So many seconds worth of cycles, too: at 100 Hz 35. A line that stalls for 0.2 s, at whatever rate, ends no goal. A
loop that stalls has no cycles meanwhile, and counts nothing."""


@dataclass(slots=True)
class FaultTimeout:
    """The timeout counts, joint by joint, cycles in a row with a fault."""

    joints: tuple[str, ...]
    cycles: dict[str, int] = field(default_factory=dict)
    """The counts of the joints that have a fault now; while there are none, ``lasting`` need not be called."""

    def lasting(self, faults: Mapping[str, JointFault], period_s: float) -> str | None:
        """One cycle; the faults that have lasted too long, in words, or None."""
        self.cycles = {name: self.cycles.get(name, 0) + 1 for name in self.joints if name in faults}
        allowed = max(FAULT_CYCLES, math.ceil(FAULT_S / period_s - 1e-9))
        texts = (faults[name].text for name, count in self.cycles.items() if count >= allowed)
        return "; ".join(dict.fromkeys(texts)) or None  # of a line that is dead, once
