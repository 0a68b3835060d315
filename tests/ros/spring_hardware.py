"""User hardware whose joints return to 0 in each cycle without a command.

The hardware counts the cycles in which it is read, and reports the count as the effort of all joints.
"""

from dataclasses import replace

import numpy as np

from drivers.clock import Clock
from hal.mock_hardware import MockHardware
from hal.robot_description.hardware_info import HardwareInfo
from hal.types import JointState


class SpringHardware(MockHardware):
    """Mock whose joints are at the positions that were commanded since the last read, or at 0."""

    cycles = 0

    def read(self) -> JointState:
        state = super().read()
        self._position[:] = 0.0
        self.cycles += 1
        return replace(state, effort=np.full_like(state.position, self.cycles))


def make(component: HardwareInfo, clock: Clock) -> SpringHardware:
    """Create the component. The entry point refers to this function."""
    return SpringHardware(component.name, component.joints, clock)
