"""Virtual servos of a robot in simulated time within this process, including their buses and world."""

from collections.abc import Callable, Mapping, Sequence

from drivers.clock import Clock
from drivers.port import Port
from servoloop.stack.emulator import couplings, virtual_lines
from servoloop.stack.robot_files import ServoFiles
from sim_backend.buses.build import Build
from sim_backend.buses.port import VirtualPort
from sim_backend.mechanics.plant import WorldPlant
from sim_backend.scene.feeder import Feeder
from sim_backend.scene.scene_check import require_scene
from sim_backend.scene.world import World
from sim_backend.scene.world_feed import Pose


class VirtualLines:
    """Virtual buses for a robot file, all in one world. The device of each bus has the same name as the bus."""

    def __init__(
        self,
        files: ServoFiles,
        build: Build,
        start: Sequence[float] | None = None,
        on_step: Callable[[float], None] = lambda time_s: None,
    ) -> None:
        """Create the world and the virtual buses.

        Args:
            files: Files of the robot.
            build: Backlash, random seeds and other options of the virtual arm.
            start: Initial joint positions, in rad or m. If None, the servos hold the positions of the scene until they
                are driven.
            on_step: Function called after each physics step.

        Raises:
            ArmFileError: The scene lacks joints of the robot.
        """
        ways = build.mounted(couplings(files.robot))
        require_scene(files.scene, [one.joint for one in ways])
        self.world = World(files.scene, start, build.spread, build.gaps(ways), build.apples)
        if start is None:
            self.world.hold_until_driven()
        feeder = Feeder()

        def after_step(time_s: float) -> None:
            feeder.update(self.world, time_s)
            on_step(time_s)

        self.lines = virtual_lines(files.robot, WorldPlant(self.world, ways, after_step), build.spread)
        """Virtual buses, keyed by bus name."""

    @property
    def devices(self) -> dict[str, str]:
        """Devices, keyed by bus name."""
        return {name: name for name in self.lines}

    def open(self, device: str, baud: int, clock: Clock) -> Port:
        """Open a port to one of the virtual buses."""
        return VirtualPort(self.lines[device], clock, baud=baud, name=f"virtual {device}".rstrip())

    def advance(self, now_s: float) -> None:
        """Advance the servos and the world to a time, even if the servos were not read."""
        for line in self.lines.values():
            line.advance(now_s)

    def scene(self) -> Mapping[str, Pose]:
        """Return the poses of all objects in the world, keyed by name."""
        return {n: (p.position_m, p.quaternion_xyzw) for n, p in self.world.poses().items()}
