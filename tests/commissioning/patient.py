"""A virtual arm in simulated time for the doctor, which is healthy and calibrated until a test adds a problem."""

from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from commissioning.doctor.doctor import ExaminedArm, doctor
from commissioning.doctor.findings import Finding
from commissioning.doctor.motion import Move, no_move
from commissioning.doctor.report import DoctorReport
from commissioning.ports.machine import Machine
from drivers.bus.bus import Bus
from drivers.driver_errors import PortError
from drivers.servos.register import Register
from hal.joint import Joint
from hal.robot_file.calibration_file import CalibratedJoint, CalibrationFile
from hal.servos.servo_hardware import ServoHardware
from servoloop.stack.arm_folders import find_arm, read_arm_files
from servoloop.stack.emulator import couplings, virtual_lines
from servoloop.stack.robot_files import Files, read_files
from servoloop.stack.shipped_files import CONFIG
from sim_backend.buses.build import Build
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.line.line import ServoLine
from sim_backend.mechanics.plant import WorldPlant
from sim_backend.scene.world import World

NOBODYS_MACHINE = Machine(Path("/nowhere"), list)
"""A machine without adapters and udev rules."""


@cache
def files_of(arm: str) -> Files:
    """Read the files of an arm in config/arms, or of a robot file in config."""
    return read_files(robot=CONFIG / arm) if arm.endswith(".yaml") else read_arm_files(find_arm(arm))


@dataclass
class Patient:
    """A virtual arm, named as in config/arms, that the doctor examines."""

    arm: str = "robot_arm"
    build: Build = field(default_factory=Build)
    calibrated: bool = True
    machine: Machine = NOBODYS_MACHINE
    open_error: PortError | None = None
    port: type[VirtualPort] = VirtualPort
    device: str = "/dev/ttyACM0"

    def __post_init__(self) -> None:
        self.files = files_of(self.arm)
        self.robot = self.files.robot
        self.clock = SimulatedClock()
        ways = couplings(self.robot)
        self.world = World(self.files.scene, spread=self.build.spread, backlash=self.build.gaps(ways))
        self.world.model.geom_contype[:] = 0  # no contacts, so that no object blocks the arm
        self.plant = WorldPlant(self.world, ways)
        self.lines = virtual_lines(self.robot, self.plant, self.build.spread)
        self.line: ServoLine[Any] = next(iter(self.lines.values()))
        self.wait(0.0)  # its time begins
        self.calibration = perfect(self.robot.joints) if self.calibrated else None

    def open(self, device: str, baud: int) -> VirtualPort:
        """Open the port of a bus, or raise ``open_error``."""
        if self.open_error:
            raise self.open_error
        line = self.lines.get(device.rpartition("-")[2], self.line)
        return self.port(line, self.clock, baud=baud, name=device)

    def bus(self) -> Bus:
        """Return a second bus object, like that of another program."""
        models = {joint.servo_id: joint.model for joint in self.robot.joints}
        return Bus(VirtualPort(self.line, self.clock), self.clock, models)

    def _buses(self) -> dict[str, Bus]:
        return {name: self._bus(name) for name in self.lines}

    def _bus(self, name: str) -> Bus:
        models = {joint.servo_id: joint.model for joint in self.robot.joints if joint.bus == name}
        return Bus(VirtualPort(self.lines[name], self.clock), self.clock, models)

    def hold(self) -> None:
        """Enable the torque and leave it on, like a program with ``on_exit: hold``."""
        hardware = ServoHardware("arm", self.robot.joints, self._buses, self.clock)
        hardware.configure()
        hardware.activate()
        self.wait(1.0)

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now() + seconds)
        for line in self.lines.values():
            line.advance(self.clock.now())

    def put(self, servo_id: int, register: Register, value: int) -> None:
        """Set a register, as another program would."""
        memory = self.line.servo(servo_id).memory
        (memory.save if hasattr(memory, "save") and register.persistent else memory.put)(register, value)

    def examine(self, move: Move = no_move) -> DoctorReport:
        devices = {name: f"{self.device}-{name}" if name else self.device for name in self.lines}
        return doctor(
            ExaminedArm(self.robot, calibration=self.calibration),
            devices,
            self.clock,
            machine=self.machine,
            open_port=self.open,
            move=move,
        )

    def findings(self) -> dict[str, Finding]:
        """Return the first finding of each kind, by its ID."""
        found: dict[str, Finding] = {}
        for finding in self.examine().findings:
            found.setdefault(finding.id, finding)
        return found


def perfect(joints: tuple[Joint, ...]) -> CalibrationFile:
    """Return a calibration whose stops match the URDF exactly."""
    return CalibrationFile(joints={joint.name: _perfect(joint) for joint in joints})


def _perfect(joint: Joint) -> CalibratedJoint:
    lower, upper = joint.counts_range()
    return CalibratedJoint(
        servo_id=joint.servo_id,
        sign=1 if joint.sign > 0 else -1,
        zero_counts=joint.zero_counts,
        homing_offset=joint.homing_offset,
        lower_counts=lower,
        upper_counts=upper,
    )
