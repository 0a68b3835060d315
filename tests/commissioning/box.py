"""A virtual box of servos in simulated time, and hands that connect its servos on request."""

from collections.abc import Callable
from dataclasses import dataclass, field

from commissioning.set_up.flow import SetUp, SetUpTask
from commissioning.set_up.only_one import ServoPlace
from drivers.bus.bus import Bus
from drivers.servos import sts
from drivers.servos.register import Register, ServoModel
from sim_backend.box import VirtualBox
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.line.rig import Supply
from sim_backend.servos.sts.servo import VirtualServo

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
GRIPPER = (("position_p", 16), ("protection_current", 250), ("max_torque", 500))


def places(model: ServoModel = sts.STS3215) -> list[ServoPlace]:
    """Return the servos of an SO-101: the base has ID 1; the gripper has ID 6 and its own settings."""
    return [ServoPlace(name, i, model, GRIPPER if name == "gripper" else ()) for i, name in enumerate(JOINTS, 1)]


class Port(VirtualPort):
    """A port that calls ``before_write`` before each packet."""

    before_write: Callable[[bytes], None] = staticmethod(lambda data: None)

    def write(self, data: bytes) -> None:
        self.before_write(data)
        super().write(data)


class Bench:
    """A box of six servos, with a bus. Servo n of the box is meant for the n-th joint."""

    def __init__(self, seed: int = 0, model: ServoModel = sts.STS3215, supply_v: float | None = None) -> None:
        self.clock = SimulatedClock(10.0)
        supply = None if supply_v is None else Supply(supply_v)
        self.box = VirtualBox([model] * len(JOINTS), supply=supply, seed=seed)
        self.open()

    def open(self) -> None:
        """Open the bus; it can be opened again after the port was lost."""
        self.port = Port(self.box.line, self.clock)
        self.bus = Bus(self.port, self.clock)

    def servo(self, number: int) -> VirtualServo:
        servo = self.box.servos[number]
        assert isinstance(servo, VirtualServo)
        return servo

    def held(self, number: int, register: Register) -> int:
        """Return the value of a register after a power cycle."""
        servo = self.servo(number)
        servo.power_cycle()
        return servo.memory.get(register)

    def locked(self) -> bool:
        return all(self.servo(number).memory.get(sts.lock) == 1 for number in range(len(JOINTS)))

    def set_up(self, hands: "Hands") -> SetUp:
        return SetUp(self.bus, self.clock, places(), hands)


@dataclass
class Hands:
    """Hands that connect the requested servo, or the servos that ``instead`` returns instead."""

    bench: Bench
    asked: list[SetUpTask] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    instead: Callable[[SetUpTask], tuple[int, ...] | None] = lambda task: None

    def say(self, text: str) -> None:
        self.said.append(text)

    def connect(self, task: SetUpTask) -> None:
        self.asked.append(task)
        other = self.instead(task)
        right = range(len(JOINTS)) if task.kind == "chain" else (JOINTS.index(task.joint),)
        self.bench.box.connect(*(right if other is None else other))
        self.bench.clock.sleep_until(self.bench.clock.now() + 1.0)

    @property
    def problems(self) -> list[str]:
        """Problems that were reported when a task was repeated."""
        return [task.problem for task in self.asked if task.problem]
