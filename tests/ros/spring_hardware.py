"""A user's own hardware whose joints spring back to 0 in each cycle that does not tell them where to be.

It counts the cycles in which it is read, and shows the count as the effort of all joints.
"""

from dataclasses import replace

import numpy as np

from drivers.clock import Clock
from hal.mock_hardware import MockHardware
from hal.robot_description.hardware_info import HardwareInfo
from hal.types import JointState


class SpringHardware(MockHardware):
    """At the place that it was told since it was last read, or else at 0."""

    cycles = 0

    def read(self) -> JointState:
        state = super().read()
        self._position[:] = 0.0
        self.cycles += 1
        return replace(state, effort=np.full_like(state.position, self.cycles))


def make(component: HardwareInfo, clock: Clock) -> SpringHardware:
    """What the entry point names."""
    return SpringHardware(component.name, component.joints, clock)
