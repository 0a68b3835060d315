"""Lines of virtual servos as people have them before they are set up, on simulated time."""

from collections.abc import Mapping
from typing import Any

from commissioning.scan.scan import ScanReport, scan
from drivers.servos import x
from drivers.servos.catalog import series_of
from drivers.servos.register import ServoModel
from sim_backend.bus import VirtualBus, servo_of
from sim_backend.clock import SimulatedClock
from sim_backend.dynamixel_bus import VirtualDynamixelBus
from sim_backend.line import ServoLine
from sim_backend.plant import BenchPlant
from sim_backend.port import VirtualPort
from sim_backend.rig import Rig, Supply


class ToolLine:
    """Virtual servos, by ID, and a port to them. It notes every packet that is sent."""

    def __init__(self, models: Mapping[int, ServoModel], port: type[VirtualPort] = VirtualPort) -> None:
        self.clock = SimulatedClock(20.0)
        of = VirtualDynamixelBus.of if isinstance(next(iter(models.values())), x.Model) else VirtualBus.of
        self.servos: ServoLine[Any] = of(BenchPlant(tuple(models), timestep_s=0.005), models)
        self._noted(port)

    def _noted(self, kind: type[VirtualPort]) -> None:
        sent: list[bytes] = []

        class Noting(kind):  # type: ignore[valid-type,misc]
            def write(self, data: bytes) -> None:
                sent.append(data)
                super().write(data)

        self.sent = sent
        self.port: VirtualPort = Noting(self.servos, self.clock)

    @classmethod
    def twins(cls, model: ServoModel, servo_id: int = 2) -> "ToolLine":
        """Three servos, of which two have one ID and stand at different angles."""
        line = cls({1: model, servo_id: model, 9: model})
        plant = BenchPlant((1, servo_id, 9), timestep_s=0.005)
        plant.place([0.0, 0.3, 1.0])
        servos = [servo_of(model, coupling.servo_id) for coupling in plant.couplings]
        line.servos = VirtualBus(Rig(servos, plant, Supply(model.rated_voltage_v)))
        servos[-1].memory.put(series_of(model).servo_id, servo_id)
        line._noted(VirtualPort)
        return line

    def put(self, servo_id: int, register: Any, value: int) -> None:
        """As if it had been set up so; a servo's flash has it too."""
        memory = self.servos.servo(servo_id).memory
        (memory.save if hasattr(memory, "save") else memory.put)(register, value)

    def held(self, servo_id: int, register: Any) -> int:
        """What the servo's memory has."""
        value: int = self.servos.servo(servo_id).memory.get(register)
        return value

    def scan(self, **options: Any) -> ScanReport:
        """Scan it."""
        return scan(self.port, self.clock, **options)
