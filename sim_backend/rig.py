"""Servos on a plant with one power supply, advanced together in fixed steps. Deterministic."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from sim_backend.firmware import Firmware
from sim_backend.plant import Plant


@dataclass(frozen=True, slots=True)
class Supply:
    """The power supply with its leads: the voltage sags by resistance times the current of all."""

    voltage_v: float = 12.0
    resistance_ohm: float = 0.1


class Stepped(Protocol):
    """What a rig needs of a servo."""

    @property
    def servo_id(self) -> int: ...

    @property
    def firmware(self) -> Firmware: ...

    def step(self, dt_s: float, angle_rad: float, velocity_rad_s: float) -> float: ...


AnyServo = TypeVar("AnyServo", bound=Stepped)


class Rig(Generic[AnyServo]):
    """Steps the firmware of all servos, the voltage between them, and the plant below."""

    def __init__(self, servos: Sequence[AnyServo], plant: Plant, supply: Supply | None = None) -> None:
        if [s.servo_id for s in servos] != [c.servo_id for c in plant.couplings]:
            raise ValueError("servos and the plant's couplings must name the same IDs in one order")
        self.servos = tuple(servos)
        self.plant = plant
        self.supply = supply or Supply()
        self.timestep_s = plant.timestep_s
        self._steps = [servo.step for servo in servos]
        self._firmware = [servo.firmware for servo in servos]
        for firmware, angle in zip(self._firmware, plant.angles(), strict=True):
            firmware.observe(angle)

    def step(self) -> None:
        """One timestep of everything."""
        dt_s, plant, firmware = self.timestep_s, self.plant, self._firmware
        total_a = 0.0
        for servo in firmware:
            total_a += servo.supply_current_a
        voltage_v = max(0.0, self.supply.voltage_v - total_a * self.supply.resistance_ohm)
        torques = []
        state = zip(self._steps, firmware, plant.angles(), plant.velocities(), strict=True)
        for step, servo, angle, velocity in state:
            servo.voltage_v = voltage_v
            torques.append(step(dt_s, angle, velocity))
        plant.step(torques)
