"""Buses of virtual servos before their set-up, in simulated time."""

import random
from collections.abc import Mapping
from typing import Any

from commissioning.scan.scan import Progress, ScanReport, ScanScope, scan
from drivers.servos import x
from drivers.servos.catalog import series_of
from drivers.servos.register import ServoModel
from sim_backend.buses.dynamixel import VirtualDynamixelBus
from sim_backend.buses.feetech import VirtualBus
from sim_backend.buses.port import VirtualPort
from sim_backend.clock import SimulatedClock
from sim_backend.line.line import ServoLine
from sim_backend.line.rig import Rig, Supply
from sim_backend.mechanics.plant import BenchPlant


class ToolLine:
    """Virtual servos, by ID, with a port that records every packet sent."""

    def __init__(self, models: Mapping[int, ServoModel], port: type[VirtualPort] = VirtualPort) -> None:
        self.clock = SimulatedClock(20.0)
        of = VirtualDynamixelBus.of if isinstance(next(iter(models.values())), x.XModel) else VirtualBus.of
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
    def twins(
        cls, model: ServoModel, servo_id: int = 2, count: int = 2, seed: int = 0, apart: bool = True
    ) -> "ToolLine":
        """Return a bus with one servo with ID 1 and ``count`` servos with ID 2.

        With ``apart``, the servos with ID 2 have different positions, which is their only difference.
        """
        places = (1, *range(100, 100 + count))
        line, chance = cls(dict.fromkeys(places, model)), random.Random(seed)
        plant = BenchPlant(places, timestep_s=0.005)
        plant.place([chance.uniform(0.5, 3.5) if apart else 1.0 for _ in places])
        servos: list[Any] = list(line.servos.servos)
        line.servos = type(line.servos)(Rig(servos, plant, Supply(model.rated_voltage_v)))  # type: ignore[call-arg,arg-type]
        for servo in servos[1:]:
            servo.memory.put(series_of(model).servo_id, 2)
        line._noted(VirtualPort)
        return line

    def put(self, servo_id: int, register: Any, value: int) -> None:
        """Set a register of a servo persistently."""
        memory = self.servos.servo(servo_id).memory
        (memory.save if hasattr(memory, "save") else memory.put)(register, value)

    def held(self, servo_id: int, register: Any) -> int:
        """Return the value of a register in the servo's memory."""
        value: int = self.servos.servo(servo_id).memory.get(register)
        return value

    def scan(
        self, models: Mapping[int, ServoModel] | None = None, progress: Progress | None = None, **scope: Any
    ) -> ScanReport:
        """Scan the bus. ``scope`` contains the fields of a ScanScope."""
        seen: dict[str, Any] = {"progress": progress} if progress else {}
        return scan(self.port, self.clock, ScanScope(**scope), models=models, **seen)
