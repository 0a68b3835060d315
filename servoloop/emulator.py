"""``servoloop emulate``: the virtual bus with its world."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from hal.robot import Robot
from sim_backend.bus import VirtualBus
from sim_backend.dynamixel_bus import VirtualDynamixelBus
from sim_backend.emulator import serve
from sim_backend.feeder import Feeder
from sim_backend.line import ServoLine
from sim_backend.picture import Recorder
from sim_backend.plant import Coupling, Plant, WorldPlant
from sim_backend.world import World
from sim_backend.world_feed import WorldFeed, feed_path


def couplings(robot: Robot) -> list[Coupling]:
    """The virtual arm is built as the robot file says."""
    return [
        Coupling(
            servo_id=joint.servo_id,
            joint=joint.name,
            sign=joint.sign,
            zero_counts=joint.zero_counts,
            transmission=joint.transmission,
            counts_per_turn=joint.model.counts_per_turn,
        )
        for joint in robot.joints
    ]


def virtual_bus(robot: Robot, plant: Plant) -> ServoLine[Any]:
    """The servos that the robot file names, on their bus."""
    if robot.file.bus.protocol == "feetech":
        return VirtualBus.of(plant)
    return VirtualDynamixelBus.of(plant, {joint.servo_id: joint.model for joint in robot.joints})


def emulate(
    robot: Robot, link: Path, pictures: Path | None, stop: Callable[[], bool], on_ready: Callable[[], None]
) -> None:
    """Serve the bus at ``link`` until ``stop``, then draw. Raises PortBusy where ``link`` is taken."""
    world = World()
    feeder = Feeder()
    recorder = Recorder(world) if pictures else None

    def after_step(time_s: float) -> None:
        feeder.update(world, time_s)
        if recorder:
            recorder.update(time_s)

    plant = WorldPlant(world, couplings(robot), after_step)
    bus = virtual_bus(robot, plant)
    with WorldFeed(feed_path(link)) as feed:
        serve(
            bus,
            link,
            stop=stop,
            on_tick=lambda now_s: feed.tick(now_s, world, bus.dropped_s),
            on_ready=on_ready,
        )
    if recorder and pictures:
        recorder.save(pictures)
