"""Implementation of ``servoloop emulate``: virtual servos on virtual buses, in a simulated world."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from commissioning.calibrate.seam import joint_counting
from commissioning.provision import persistent_registers
from commissioning.registers.tables import rates_of
from drivers.servos import sts, x
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import PROTOCOL_2
from hal.hal_errors import RobotFileError
from hal.joint import Joint
from hal.robot_file.robot import Robot
from servoloop.stack.devices import device_paths
from servoloop.stack.emulator_options import EmulatorOptions
from servoloop.stack.processes import realtime_priority
from servoloop.stack.robot_files import ServoFiles
from sim_backend.box import FACTORY_ID, VirtualBox, plugged
from sim_backend.buses.build import Build
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.pty_link import PtyAdapter
from sim_backend.control import ControlServer, Handler, control_path
from sim_backend.eeprom import keep_eeprom
from sim_backend.emulator import serve_all
from sim_backend.faults.control import handle_fault_command
from sim_backend.faults.events import FaultEvent
from sim_backend.faults.player import FaultPlayer, require_possible
from sim_backend.faults.targets import FaultTargets
from sim_backend.line.common_plant import CommonPlant
from sim_backend.line.line import ServoLine
from sim_backend.line.rig import Supply
from sim_backend.line.spread import NOMINAL, Spread
from sim_backend.mechanics.plant import Coupling, Plant, WorldPlant
from sim_backend.scene.feeder import Feeder
from sim_backend.scene.hand import SceneHand, handle_hand_command
from sim_backend.scene.picture import FilmRecorder
from sim_backend.scene.scene_check import require_scene
from sim_backend.scene.world import World
from sim_backend.scene.world_feed import WorldFeed, feed_path
from sim_backend.servos.dynamixel.servo import VirtualXServo
from sim_backend.servos.sts.servo import VirtualServo

_Wiring = tuple[dict[str, ServoLine[Any]], Handler]
"""Virtual buses, keyed by bus name, and the handler for commands from the control socket."""


def couplings(robot: Robot) -> list[Coupling]:
    """Return the couplings between the virtual servos and the joints of the robot file."""
    return [
        Coupling(
            servo_id=joint.servo_id,
            joint=joint.name,
            sign=joint.sign,
            zero_counts=joint.zero_counts + (joint_counting(joint).seam(joint.model) or 0),
            transmission=joint.transmission,
            counts_per_turn=joint.model.counts_per_turn,
        )
        for joint in robot.joints
    ]


def virtual_bus(robot: Robot, plant: Plant, bus: str = "", spread: Spread = NOMINAL) -> ServoLine[Any]:
    """Return a virtual bus with the servos, the baud rate and the servo settings of the robot file.

    Args:
        robot: The robot file.
        plant: Mechanical model that the servos move.
        bus: Name of the bus.
        spread: Manufacturing spread of STS servos and their supply.

    Raises:
        RobotFileError: A servo does not support the baud rate.
    """
    line = _line(robot, plant, bus, spread)
    baud = robot.file.lines()[bus].baud
    for joint in robot.joints:
        if joint.bus == bus:
            values = {rate: value for value, rate in rates_of(joint.model).items()}
            if baud not in values:
                known = ", ".join(map(str, sorted(values)))
                raise RobotFileError(
                    f"{joint.name}: an {joint.model.name} supports {known} baud, not {baud}: change `baud`"
                )
            registers, servo = persistent_registers(joint.model), line.servo(joint.servo_id)
            for name, value in {"baud_rate": values[baud], **dict(joint.settings)}.items():
                servo.memory.save(registers[name], value)
            if joint.settings:
                servo.power_cycle()  # A servo copies its limits into RAM at power-on.
    return line


def _line(robot: Robot, plant: Plant, bus: str, spread: Spread) -> ServoLine[Any]:
    joints = [joint for joint in robot.joints if joint.bus == bus]
    models = {joint.servo_id: joint.model for joint in joints}
    if any(series_of(model).protocol is PROTOCOL_2 for model in models.values()):
        versions = {joint.servo_id: joint.firmware for joint in joints if joint.firmware is not None}
        line: ServoLine[Any] = VirtualDynamixelBus.of(plant, models, firmware=versions)
    else:
        line = VirtualBus.of(plant, models, spread=spread)
    for joint in joints:
        _count_as_calibrated(line.servo(joint.servo_id), joint)
    return line


def _count_as_calibrated(servo: Any, joint: Joint) -> None:
    """Write the calibrated homing offset and the operating mode of a joint to its virtual servo."""
    if joint.homing_offset and isinstance(servo, VirtualServo):
        servo.memory.save(sts.homing_offset, joint.homing_offset)
    if isinstance(servo, VirtualXServo):
        servo.memory.save(x.homing_offset, joint.homing_offset or 0)
        servo.memory.save(x.operating_mode, x.EXTENDED_POSITION_MODE if joint.extended else x.POSITION_MODE)
        servo.power_cycle()


def virtual_lines(robot: Robot, plant: Plant, spread: Spread = NOMINAL) -> dict[str, ServoLine[Any]]:
    """Return the virtual buses of the robot file, keyed by name. All buses share one plant."""
    names = list(robot.file.lines())
    if len(names) == 1:
        return {names[0]: virtual_bus(robot, plant, names[0], spread)}
    common = CommonPlant(plant)
    lines: dict[str, ServoLine[Any]] = {}
    for name in names:
        part = common.part([joint.name for joint in robot.joints if joint.bus == name])
        lines[name] = virtual_bus(robot, part, name, spread)
        common.join(lines[name])
    return lines


def virtual_box(robot: Robot, plant: Plant, spread: Spread = NOMINAL) -> VirtualBox:
    """Return factory-new servos for the arm, already mounted on its joints. Raises RobotFileError."""
    models = [joint.model for joint in robot.joints]
    if len(robot.file.lines()) > 1 or any(series_of(model).protocol is PROTOCOL_2 for model in models):
        raise RobotFileError("a virtual box supports only one bus, and no Dynamixel protocol 2.0 servos yet")
    return VirtualBox(models, plant, spread.supply(Supply(min(model.rated_voltage_v for model in models))))


def as_delivered(ways: Sequence[Coupling]) -> list[Coupling]:
    """Return the joint couplings with every servo set to its factory ID."""
    return [replace(one, servo_id=FACTORY_ID) for one in ways]


class EmulatedArm:
    """Virtual arm: simulated world, virtual servos on pseudo-terminals, fault injection and images."""

    def __init__(self, files: ServoFiles, link: Path, build: Build, pictured: bool) -> None:
        """Build the virtual arm. Raises ArmFileError if the scene lacks joints of the servos."""
        ways = build.mounted(couplings(files.robot))
        require_scene(files.scene, [one.joint for one in ways])
        self.world = World(files.scene, spread=build.spread, backlash=build.gaps(ways), apples=build.apples)
        self.world.hold_until_driven()
        if build.practice_seed is not None:
            self.world.clear_table()
        self._feeder = Feeder()
        self._hand = SceneHand(self.world, {one.joint: one.transmission for one in ways})
        self.recorder = FilmRecorder(self.world) if pictured else None
        self.lines, handle = self._boxed(files, build, ways) if build.in_box else self._wired(files, build, ways)
        self._adapters = {name: PtyAdapter(path) for name, path in device_paths(link, self.lines).items()}
        # Servos with factory settings share one ID, so a fault cannot target a single servo.
        self.player = FaultPlayer(FaultTargets({} if build.in_box else self.lines, self.world, self._adapters))
        self.handle: Handler = partial(handle_fault_command, self.player, lambda: self.world.time_s, handle)
        """Function that handles requests from clients of the control socket."""

    def serve(
        self, feed: WorldFeed, control: ControlServer, stop: Callable[[], bool], on_ready: Callable[[], None]
    ) -> None:
        """Serve every bus, the world feed and the control socket until ``stop`` returns true."""

        def on_tick(now_s: float) -> None:
            feed.tick(now_s, self.world, max(line.dropped_s for line in self.lines.values()))
            control.tick()

        buses = {self._adapters[name]: line for name, line in self.lines.items()}
        serve_all(buses, stop=stop, on_tick=on_tick, on_ready=on_ready)

    def _wired(self, files: ServoFiles, build: Build, ways: Sequence[Coupling]) -> _Wiring:
        """Return the virtual buses with configured servos, and the handler of control commands."""
        lines = virtual_lines(files.robot, WorldPlant(self.world, ways, self._after_step), build.spread)
        return lines, self._obeyed

    def _boxed(self, files: ServoFiles, build: Build, ways: Sequence[Coupling]) -> _Wiring:
        """Return the virtual bus with factory-new servos, and a handler that can also connect and disconnect these
        servos."""
        box = virtual_box(files.robot, WorldPlant(self.world, as_delivered(ways), self._after_step), build.spread)
        lines: dict[str, ServoLine[Any]] = {next(iter(files.robot.file.lines())): box.line}
        return lines, partial(plugged, box, [one.joint for one in ways], self._obeyed)

    @property
    def _obeyed(self) -> Handler:
        return partial(handle_hand_command, self._hand, self.world.lay_table)

    def _after_step(self, time_s: float) -> None:
        self.player.update(time_s)
        self._feeder.update(self.world, time_s)
        self._hand.update()
        if self.recorder:
            self.recorder.update(time_s)


def emulate(
    files: ServoFiles,
    link: Path,
    options: EmulatorOptions,
    faults: Sequence[FaultEvent],
    stop: Callable[[], bool],
    on_ready: Callable[[], None],
) -> None:
    """Serve every bus until ``stop`` returns true. If there is one bus, its path is ``link``; otherwise, the path of
    each bus is ``link``.NAME.

    Args:
        files: Files of the robot.
        link: Path of the bus.
        options: Options of the virtual arm.
        faults: Faults to inject; their times are relative to when the emulator is ready.
        stop: Function that returns whether to stop.
        on_ready: Function called when clients can open the buses.

    Raises:
        PortBusy: Another program uses one of the paths.
        EepromError: The EEPROM file does not match the servos.
        FaultError: The servos do not support one of the faults.
        ArmFileError: The scene lacks joints of the servos.
    """
    arm = EmulatedArm(files, link, options.build(), pictured=options.pictures is not None)
    if options.eeprom is not None:
        keep_eeprom(options.eeprom, arm.lines.values())
    require_possible(faults, arm.player.targets.inventory)

    def begin() -> None:
        arm.player.play(faults, arm.world.time_s)
        on_ready()

    with (
        WorldFeed(feed_path(link)) as feed,
        ControlServer(control_path(link), arm.handle) as control,
        realtime_priority(),
    ):
        arm.serve(feed, control, stop, begin)
    if arm.recorder and options.pictures:
        arm.recorder.save(options.pictures)
