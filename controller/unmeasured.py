"""Pause a goal while none of its joints is measured, because the servos may not receive the commands either."""

from collections.abc import Callable, Iterable, Mapping
from typing import Final

from hal.types import JointFault

LONGEST_WAY_S: Final = 0.5
"""Maximum time a goal waits for its joints once they are measured again, in seconds."""


class Unmeasured:
    """Counter of consecutive cycles in which none of the joints was measured.

    Call ``step_s`` in cycles with faults and in the following cycles, until ``cycles`` is 0.
    """

    def __init__(self, joints: Iterable[str]) -> None:
        self._joints = tuple(joints)
        self.reset()

    def reset(self) -> None:
        """Reset all counts when the controller restarts."""
        self.cycles = 0
        """Number of consecutive cycles in which no joint was measured. The count is kept until the joints reach the
        last command.
        """
        self.waits = False
        """Whether the goal waits in this cycle. A single lost reply does not pause the goal."""
        self._measured_s = 0.0
        """Time since the joints began to be measured again, in seconds."""

    def step_s(
        self, faults: Mapping[str, JointFault], step_s: float, arrived: Callable[[], bool] = lambda: True
    ) -> float:
        """Return the time by which the goal advances in a cycle that took ``step_s``, in seconds.

        ``arrived`` returns whether joints that are measured again have reached the last command. The servos may have
        received this command late.
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
