"""The virtual servos of ``servoloop up`` on simulated time: their lines and their world, in this process."""

from collections.abc import Mapping

from drivers.clock import Clock
from drivers.port import Port
from servoloop.emulator import couplings, virtual_lines
from servoloop.files import Files
from servoloop.hardware import Pose
from sim_backend.build import Build
from sim_backend.feeder import Feeder
from sim_backend.plant import WorldPlant
from sim_backend.port import VirtualPort
from sim_backend.world import World


class VirtualLines:
    """A virtual line for each bus of the robot file, all in one world; a device is the name of its bus."""

    def __init__(self, files: Files, build: Build) -> None:
        ways = couplings(files.robot)
        self._world = World(files.scene, spread=build.spread, backlash=build.gaps(ways))
        feeder = Feeder()
        plant = WorldPlant(self._world, ways, lambda time_s: feeder.update(self._world, time_s))
        self._lines = virtual_lines(files.robot, plant, build.spread)

    @property
    def devices(self) -> dict[str, str]:
        """By bus."""
        return {name: name for name in self._lines}

    def open(self, device: str, baud: int, clock: Clock) -> Port:
        """A port to one of the lines."""
        return VirtualPort(self._lines[device], clock, baud=baud, name=f"virtual {device}".rstrip())

    def advance(self, now_s: float) -> None:
        """Let time pass for servos and world though nobody may have asked them anything."""
        for line in self._lines.values():
            line.advance(now_s)

    def scene(self) -> Mapping[str, Pose]:
        """The poses of all things in the world."""
        return {n: (p.position_m, p.quaternion_xyzw) for n, p in self._world.poses().items()}
