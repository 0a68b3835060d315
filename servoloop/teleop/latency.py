"""The latency of teleoperation: from the leader's angle to the follower's goal, in every cycle."""

from collections.abc import Callable

import numpy as np

from drivers.clock import Clock
from hal.types import JointState


class Latency:
    """Counts, at the end of each cycle, how old the leader's angles are whose goals have just been sent."""

    def __init__(self, clock: Clock, measured_s: Callable[[], float]) -> None:
        """``measured_s``: when the leader was measured last, on the clock."""
        self._clock, self._measured_s = clock, measured_s
        self._last_s = 0.0
        self.state: JointState | None = None
        """The newest measurement of both arms."""
        self.ages_s: list[float] = []
        """One for each cycle in which the leader was measured: 50 Hz for an hour are 180,000."""

    def on_cycle(self, state: JointState) -> None:
        """The goals are on the wire by now."""
        self.state, measured_s = state, self._measured_s()
        if measured_s != self._last_s:
            self._last_s = measured_s
            self.ages_s.append(self._clock.now() - measured_s)

    @property
    def summary(self) -> str:
        """For people."""
        if not self.ages_s:
            return "the leader was never measured"
        ages_ms = np.array(self.ages_s) * 1e3
        return (
            f"from the leader's angles to the follower's goals: median {np.median(ages_ms):.1f} ms, "
            f"99 % within {np.percentile(ages_ms, 99):.1f} ms, at most {ages_ms.max():.1f} ms"
        )
