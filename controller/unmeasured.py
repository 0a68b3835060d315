"""Where not one of its joints is measured a goal waits: nobody knows whether commands arrive."""

from collections.abc import Callable, Iterable, Mapping
from typing import Final

from hal.types import JointFault

LONGEST_WAY_S: Final = 0.5
"""So long, once they are measured again, a goal waits for joints at the most."""


class Unmeasured:
    """Cycles in a row in which not one of these joints was measured; to be asked in those with faults, and after."""

    def __init__(self, joints: Iterable[str]) -> None:
        self._joints = tuple(joints)
        self.forget()

    def forget(self) -> None:
        """The controller begins anew: no cycle without a measurement is known."""
        self.cycles = 0
        """For which joints have not been measured, or have not come to the last command since."""
        self.waits = False
        """Whether the goal waits in this cycle. One lost answer changes nothing."""
        self._measured_s = 0.0
        """How long they have been measured again."""

    def step_s(
        self, faults: Mapping[str, JointFault], step_s: float, arrived: Callable[[], bool] = lambda: True
    ) -> float:
        """The time (s) by which the goal moves on in a cycle that took ``step_s``.

        ``arrived``: whether joints that are measured again have come to the last command, which may have come late.
        """
        if all(joint in faults and faults[joint].kind != "no_torque" for joint in self._joints):
            self.cycles += 1
            self._measured_s = 0.0
        elif self.waits and self._measured_s < LONGEST_WAY_S and not arrived():
            self._measured_s += step_s
        else:
            self.cycles = 0
        self.waits = self.cycles > 1
        return 0.0 if self.waits else step_s
