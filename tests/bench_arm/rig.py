"""A virtual arm that lies on its table with torque off, in simulated time."""

from collections.abc import Callable

import numpy as np

from drivers.servos import sts
from servoloop.bench.arm import Measured, bench_arm
from servoloop.stack.arm_folders import ArmFolder, find_arm, read_arm_files
from servoloop.stack.virtual_lines import VirtualLines
from sim_backend.buses.build import Build
from sim_backend.clock import SimulatedClock


class Lying:
    """Arm in the initial pose of its scene. The arm records the highest joint speeds while torque is enabled."""

    def __init__(self, name: str = "so101", backlash_deg: float = 0.0) -> None:
        self.arm: ArmFolder = find_arm(name)
        self.files = read_arm_files(self.arm)
        self.clock = SimulatedClock()
        self.watch: Callable[[float], None] = lambda time_s: None
        self.lines = VirtualLines(self.files, Build(backlash_deg), on_step=self._on_step)
        self.fastest = np.zeros(len(self.lines.world.joints))
        self.clock.sleep_until(2.0)
        self.lines.advance(2.0)
        self.lay = self.lines.world.position()

    def _on_step(self, time_s: float) -> None:
        if time_s > 2.0 and self.held == len(self.servos):
            self.fastest = np.maximum(self.fastest, np.abs(self.lines.world.velocity()))
        self.watch(time_s)

    @property
    def servos(self) -> list:  # type: ignore[type-arg]
        return [servo for line in self.lines.lines.values() for servo in line.servos]

    @property
    def held(self) -> int:
        """Number of servos with torque enabled."""
        return sum(bool(servo.memory.get(sts.torque_enable)) for servo in self.servos)

    def bench(self, signals: Callable[[], int] = lambda: 0) -> Measured:
        return bench_arm(self.arm, self.lines.devices, self.clock, signals=signals, virtual=self.lines)
