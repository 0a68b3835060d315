"""Three servos in simulated time, one of which is silent for a moment."""

from typing import Any, Final

from drivers.bus.bus import Bus
from drivers.servos.catalog import series_of
from drivers.servos.dynamixel import PROTOCOL_2
from drivers.servos.register import ServoModel
from hal.joint import Joint
from hal.types import JointLimits
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.mechanics.plant import BenchPlant

LIMITS: Final = JointLimits(-1.0, 1.0, 2.0, 10.0, 100.0)
IDS: Final = (1, 2, 3)
SILENT: Final = 2
"""ID of the servo that falls silent."""
SILENT_S: Final = 0.2


class Interrupted:
    """Servos on shafts, and the bus that drives them."""

    def __init__(self, model: ServoModel) -> None:
        self.clock = SimulatedClock()
        models = dict.fromkeys(IDS, model)
        maker: Any = VirtualDynamixelBus if series_of(model).protocol is PROTOCOL_2 else VirtualBus
        self.line = maker.of(BenchPlant(IDS), models)
        self.bus = Bus(VirtualPort(self.line, self.clock), self.clock, models)
        self.joints = [Joint(f"joint{i}", i, model, LIMITS) for i in IDS]
        self.packets = 0
        """Number of packets since ``silence_at``."""
        self._silent_s = (0.0, 0.0)
        self.line.faults.on_instruction.append(self._reaches)

    def _reaches(self, servo_id: int) -> bool:
        from_s, to_s = self._silent_s
        return servo_id != SILENT or not from_s <= self.clock.now() < to_s

    def silence(self, after_s: float, silent_s: float) -> None:
        """Silence the servo for a time."""
        from_s = self.clock.now() + after_s
        self._silent_s = from_s, from_s + silent_s

    def silence_at(self, packet: int) -> None:
        """Silence the servo for 0.2 s when the packet with this number is sent."""
        receive = self.line.receive

        def count(*sent: Any) -> Any:
            if self.packets == packet:
                self.silence(0.0, SILENT_S)
            self.packets += 1
            return receive(*sent)

        self.line.receive = count
