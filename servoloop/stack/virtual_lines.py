"""The virtual servos of a robot on simulated time: their lines and their world, in this process."""

from collections.abc import Callable, Mapping, Sequence

from drivers.clock import Clock
from drivers.port import Port
from servoloop.stack.emulator import Pose, couplings, virtual_lines
from servoloop.stack.robot_files import ServoFiles
from sim_backend.buses.build import Build
from sim_backend.buses.port import VirtualPort
from sim_backend.mechanics.plant import WorldPlant
from sim_backend.scene.feeder import Feeder
from sim_backend.scene.scene_check import require_scene
from sim_backend.scene.world import World


class VirtualLines:
    """A virtual line for each bus of the robot file, all in one world; a device is the name of its bus."""

    def __init__(
        self,
        files: ServoFiles,
        build: Build,
        start: Sequence[float] | None = None,
        on_step: Callable[[float], None] = lambda time_s: None,
    ) -> None:
        """``start``: where the joints stand, rad or m; ``on_step`` is called after each step of the physics.

        Raises ArmFileError where the scene does not have the joints.
        """
        ways = couplings(files.robot)
        require_scene(files.scene, [one.joint for one in ways])
        self.world = World(files.scene, initial_position=start, spread=build.spread, backlash=build.gaps(ways))
        if start is None:
            self.world.hold_until_driven()
        feeder = Feeder()

        def after_step(time_s: float) -> None:
            feeder.update(self.world, time_s)
            on_step(time_s)

        self.lines = virtual_lines(files.robot, WorldPlant(self.world, ways, after_step), build.spread)
        """By bus."""

    @property
    def devices(self) -> dict[str, str]:
        """By bus."""
        return {name: name for name in self.lines}

    def open(self, device: str, baud: int, clock: Clock) -> Port:
        """A port to one of the lines."""
        return VirtualPort(self.lines[device], clock, baud=baud, name=f"virtual {device}".rstrip())

    def advance(self, now_s: float) -> None:
        """Let time pass for servos and world though nobody may have asked them anything."""
        for line in self.lines.values():
            line.advance(now_s)

    def scene(self) -> Mapping[str, Pose]:
        """The poses of all things in the world."""
        return {n: (p.position_m, p.quaternion_xyzw) for n, p in self.world.poses().items()}
