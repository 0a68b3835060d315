"""Three joints with virtual servos on a test bench in simulated time, and the tuner of one of them.

Each shaft carries the inertia of a link. The first shaft also carries a load, which is supported while the torque is
off.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from commissioning.tune.tuner import Ending, Tuner
from drivers.bus.bus import Bus
from drivers.servos import sts
from drivers.servos.register import Register
from hal.joint import Joint
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant
from tests.hal.bench import JOINTS

LOAD_NM = 0.6
LINK_KG_M2 = 0.04
PARK = {"shoulder": -0.5, "elbow": 0.2}
RELEASED = Ending(relax=True, park=PARK)
HELD = Ending(relax=False, park=PARK)


class LoadedPort(VirtualPort):
    """A port that supports the load of a released shaft before each packet."""

    before: Callable[[bytes], None]

    def write(self, data: bytes) -> None:
        self.before(data)
        super().write(data)


@dataclass
class TuneBench:
    """A bench with three servos; ``gains`` are their stored values, by register."""

    gains: Mapping[Register, int] = field(default_factory=dict)
    load_nm: float = LOAD_NM
    joints: Sequence[Joint] = JOINTS
    inertia_kg_m2: float = LINK_KG_M2

    def __post_init__(self) -> None:
        self.clock = SimulatedClock()
        self.plant = BenchPlant([joint.servo_id for joint in self.joints], inertia_kg_m2=self.inertia_kg_m2)
        self.line = VirtualBus.of(self.plant)
        self.memories = [self.line.servo(joint.servo_id).memory for joint in self.joints]
        self.before: Callable[[bytes], None] = lambda data: None
        self.packets = 0
        self.port: LoadedPort | None = None
        for memory in self.memories:
            for register, value in self.gains.items():
                memory.save(register, value)

    def open(self, joints: Sequence[Joint]) -> dict[str, Bus]:
        """Open the bus again."""
        self.port = LoadedPort(self.line, self.clock)
        self.port.before = self._look
        return {"": Bus(self.port, self.clock, {joint.servo_id: joint.model for joint in joints})}

    def tuner(
        self, joint: str = "shoulder", ending: Ending = RELEASED, stopped: Callable[[], bool] = lambda: False
    ) -> Tuner:
        return Tuner(self.joints, joint, self.open, self.clock, ending, stopped)

    def _look(self, data: bytes) -> None:
        self.packets += 1
        self.plant.load_nm[0] = -self.load_nm if self.torque[0] else 0.0
        self.before(data)

    @property
    def torque(self) -> list[bool]:
        """Whether the torque of each servo is on."""
        return [memory.get(sts.torque_enable) == 1 for memory in self.memories]

    @property
    def positions(self) -> list[float]:
        """Joint positions, in rad or m."""
        counts = [memory.get(sts.present_position) for memory in self.memories]
        return [joint.position(at) for joint, at in zip(self.joints, counts, strict=True)]

    @property
    def saved(self) -> list[bytes]:
        """Contents of the EEPROM of each servo."""
        return [bytes(memory.read(4, 36)) for memory in self.memories]
