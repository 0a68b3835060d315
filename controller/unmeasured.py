"""Where not one of its joints is measured a goal waits: nobody knows whether commands arrive."""

from collections.abc import Iterable, Mapping

from controller.trajectory.sampler import TrajectorySampler
from hal.types import JointFault


class Unmeasured:
    """Cycles in a row in which not one of these joints was measured; to be asked in those with faults, and after."""

    def __init__(self, joints: Iterable[str], sampler: TrajectorySampler | None = None) -> None:
        """``sampler``: starts again from rest when the joints, whose goal has waited, are measured once more."""
        self.cycles = 0
        self._joints = tuple(joints)
        self._sampler = sampler

    def step_s(self, faults: Mapping[str, JointFault], step_s: float) -> float:
        """The time (s) by which the goal moves on in a cycle that took ``step_s``. One lost answer changes nothing."""
        if all(joint in faults and faults[joint].kind != "no_torque" for joint in self._joints):
            self.cycles += 1
            return step_s if self.cycles == 1 else 0.0
        if self.cycles > 1 and self._sampler is not None and self._sampler.on_goal:
            self._sampler.scaling.factor = self._sampler.rate = 0.0
        self.cycles = 0
        return step_s
