"""Test bench: three joints on virtual servos, with a port that a test can watch and disturb."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drivers.bus.bus import Bus
from drivers.servos import sts
from drivers.servos.register import Register
from hal.joint import Joint
from hal.servos.servo_hardware import ServoHardware
from hal.types import FloatArray, JointCommand, JointLimits, JointState
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.line.line import ServoLine
from sim_backend.mechanics.plant import BenchPlant
from sim_backend.packets.instructions import Instruction
from sim_backend.packets.sts import InstructionParser
from sim_backend.servos.sts.firmware import AS_REIMPLEMENTED, StsVariant
from sim_backend.servos.sts.servo import VirtualServo

PERIOD_S = 0.05
IDS = (1, 2, 7)
JOINTS = (
    Joint("shoulder", 1, sts.STS3215, JointLimits(-2.0, 2.0, 4.0, 12.0, 120.0)),
    Joint("elbow", 2, sts.STS3215, JointLimits(-1.5, 1.5, 4.0, 12.0, 120.0), sign=-1, zero_counts=2000),
    Joint(
        "finger",
        7,
        sts.STS3215,
        JointLimits(0.0, 0.05, 0.09, 1.0, 20.0),
        zero_counts=1024,
        transmission=0.03,
        torque_limit=0.5,
    ),
)
NAMES = tuple(joint.name for joint in JOINTS)


def joint_of(servo_id: int) -> Joint:
    return next(joint for joint in JOINTS if joint.servo_id == servo_id)


@dataclass
class WatchedPort:
    """Port that records every instruction. A test can run code before instructions are sent and before replies are
    read."""

    port: VirtualPort
    sent: list[Instruction] = field(default_factory=list)
    before_write: Callable[[int, Instruction], None] = lambda number, instruction: None
    before_read: Callable[[], None] = lambda: None
    _parser: InstructionParser = field(default_factory=InstructionParser)

    @property
    def name(self) -> str:
        return self.port.name

    @property
    def baud(self) -> int:
        return self.port.baud

    def write(self, data: bytes) -> None:
        for instruction in self._parser.feed(data):
            self.before_write(len(self.sent), instruction)
            self.sent.append(instruction)
        self.port.write(data)

    def read(self, size: int, deadline_s: float) -> bytes:
        self.before_read()
        return self.port.read(size, deadline_s)

    def discard_input(self) -> None:
        self.port.discard_input()

    def set_baud(self, baud: int) -> None:
        self.port.set_baud(baud)

    def close(self) -> None:
        self.port.close()


class Bench:
    """A ``ServoHardware`` with virtual servos and a simulated clock."""

    def __init__(
        self,
        counts: Sequence[int] = (2048, 2000, 1500),
        joints: Sequence[Joint] = JOINTS,
        clock: SimulatedClock | None = None,
        *,
        variant: StsVariant = AS_REIMPLEMENTED,
    ) -> None:
        self.clock = clock or SimulatedClock(1000.0)
        self.plant = BenchPlant([joint.servo_id for joint in joints])
        self.servos: ServoLine[Any] = VirtualBus.of(self.plant, variant=variant)
        self.place(counts)
        self.opened = 0
        self.watch_next_port: Callable[[int, Instruction], None] = lambda number, instruction: None
        self.port = self._new_port()
        self.hardware = ServoHardware("arm", joints, self.open_bus, self.clock)

    def _new_port(self) -> WatchedPort:
        return WatchedPort(VirtualPort(self.servos, self.clock))

    def open_bus(self) -> Bus:
        if self.opened:
            self.port = self._new_port()
            self.port.before_write = self.watch_next_port
        self.opened += 1
        return Bus(self.port, self.clock)

    def place(self, counts: Sequence[int]) -> None:
        """Set the positions of the shafts, in counts, as if the shafts had been turned by hand."""
        angles = [(c + 0.5) * 2.0 * math.pi / 4096 for c in counts]
        self.plant.place(angles)
        for servo, angle in zip(self.servos.servos, angles, strict=True):
            if isinstance(servo, VirtualServo):
                servo.firmware.observe(angle)  # otherwise the sensor follows after some milliseconds
        self.clock.sleep_until(self.clock.now() + self.plant.timestep_s)  # servos measure once per simulation step

    def configured(self) -> "Bench":
        self.hardware.configure()
        return self

    def active(self) -> "Bench":
        self.configured().hardware.activate()
        return self

    def held(self, servo_id: int, register: Register) -> int:
        """Return the value of a register in a servo."""
        return self.servos.servo(servo_id).memory.get(register)

    def measured(self, servo_id: int) -> int:
        """Return the position of a shaft, in counts."""
        return int(self.servos.servo(servo_id).firmware.position)

    def torque(self) -> list[int]:
        """Return the IDs of the servos that have torque enabled."""
        return [servo.servo_id for servo in self.servos.servos if servo.memory.get(sts.torque_enable)]

    def cycle(self, position: FloatArray) -> JointState:
        """Run one cycle: write, wait one period, read."""
        self.hardware.write(JointCommand(position, PERIOD_S))
        self.clock.sleep_until(self.clock.now() + PERIOD_S)
        return self.hardware.read()

    def wait(self) -> JointState:
        """Wait one period and read, without a command."""
        self.clock.sleep_until(self.clock.now() + PERIOD_S)
        return self.hardware.read()


def at(*position: float) -> FloatArray:
    return np.array(position)


def switches_torque(instruction: Instruction) -> bool:
    """Return whether an instruction writes the torque register of one servo."""
    return instruction.code == 3 and instruction.parameters[0] == sts.torque_enable.address


def switches_torque_on(instruction: Instruction) -> bool:
    return switches_torque(instruction) and instruction.parameters[1] == 1
